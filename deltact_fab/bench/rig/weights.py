"""Dead weights instead of a force sensor: placed by hand, filmed by the camera, masses known.

For a bench without a stage and a force sensor.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.common import Note, Progress, Stopped, to_ns

from ..protocols.plan import Step
from ..record.streams import FORCE_COLUMNS, Chunk
from ..record.writer import RunWriter
from .camera.model import open_camera
from .config import GrblConfig
from .interface import Camera, CameraFrame, OpenBench, RigSetup, WallClock
from .tool.tooling import TerminalOperator


class WeightsBench(OpenBench):
    """Asks the operator to place one weight after the other, and records images and forces.

    The owner closes it.
    """

    def __init__(self, config: GrblConfig, folder: Path, job: RigSetup) -> None:
        """folder: of the rig file."""
        assert job.protocol.weights is not None, "of a protocol with weights"
        self._job, self._weights = job, job.protocol.weights
        self._monitored = bool(config.monitor)
        self._operator = TerminalOperator()
        self.clock = WallClock()
        self.camera: Camera | None = None
        self.force = None
        if "image" in job.protocol.channels:
            assert config.camera is not None, "refused without one"
            self.camera = open_camera(config.camera, folder, self.clock)

    def run(
        self, steps: Sequence[Step], writer: RunWriter, progress: Progress | None = None
    ) -> None:
        """Record all presses that the writer lacks. Raises RunFailed, SensorError, Stopped."""
        total, frames_done = sum(step.frames for step in steps), 0
        step = steps[0]
        try:
            for press, group in groupby(steps, lambda step: step.press):
                part = list(group)
                if press in writer.kept_presses:
                    frames_done += sum(step.frames for step in part)
                    continue
                began_s, masses_g = self.clock.now_s(), iter(self._weights.masses_g)
                frames: dict[str, float] = {}
                for step in part:
                    if progress is not None:
                        progress(frames_done, total, step.id)
                    mass_g = next(masses_g) if step.kind == "press" else 0.0
                    frames |= self._step(step, mass_g, writer, began_s)
                    frames_done += step.frames
                if self.camera is not None and frames:
                    self.camera.end(frames)
                writer.flush()
        except KeyboardInterrupt as error:
            raise Stopped(
                f"stopped by the operator in {step.id}; complete presses are kept: continue "
                "with --resume"
            ) from error

    def _step(
        self, step: Step, mass_g: float, writer: RunWriter, began_s: float
    ) -> dict[str, float]:
        """Prompt, wait, record frame and force; return frame ids and times. mass_g: 0 for none."""
        start_s = self.clock.now_s()
        x_mm, y_mm, _ = step.target_mm
        if step.kind == "change":
            self._operator.ask(f"take {step.indenter}; press Enter when ready")
        elif not mass_g:
            self._operator.ask(
                f"clear the face, next is ({x_mm:g}, {y_mm:g}) mm; press Enter when nothing "
                "touches it"
            )
        else:
            self._operator.ask(
                f"place {mass_g:g} g on {step.indenter} at ({x_mm:g}, {y_mm:g}) mm; press Enter "
                "when it rests"
            )
        frames: dict[str, float] = {}
        chunks: list[Chunk] = []
        if step.frames:
            if step.id.endswith("/rest") and self.camera is not None:
                self.camera.begin(step.press)
            self._operator.tell(f"  {step.settle_s:g} s: do not touch the table")
            frame, t_s = self._settled(step.settle_s)
            wrench = self._weights.wrench(mass_g, (x_mm, y_mm))
            columns = {"t_ns": np.array([to_ns(t_s - began_s)]),
                       **{n: np.array([v]) for n, v in zip(FORCE_COLUMNS, wrench, strict=True)},
                       "saturated": np.zeros(1, bool)}  # fmt: skip
            chunks = [Chunk("force", began_s, columns)]
            frame_id = writer.frame(
                step, 1, None if frame is None else frame.image, t_s, t_s - start_s, t_s - began_s,
                dropped=0 if frame is None else frame.dropped,
            )  # fmt: skip
            assert frame_id is not None, "it waits for room"
            frames[frame_id] = t_s
            if mass_g:
                text = f"{mass_g:g} g, Fz {wrench[2]:.4f} N"
                writer.event("weight", text, self.clock.now_s(), step)
        writer.step(step, self.clock.now_s() - start_s, start_s, self.clock.now_s(), chunks)
        return frames

    def _settled(self, settle_s: float) -> tuple[CameraFrame | None, float]:
        """Return the first frame exposed after settling, and its time."""
        due_s = self.clock.now_s() + settle_s
        self.clock.sleep_s(settle_s)
        while self.camera is not None:
            frame = self.camera.capture()
            if frame.t_s >= due_s:
                return frame, frame.t_s
        return None, self.clock.now_s()

    def omissions(self) -> Iterator[Note]:
        yield Note("stage, force sensor and guard", "weights are placed by hand")
        if self._monitored:
            yield Note("monitors", "not read: weights are placed by hand")
        yield from super().omissions()

    def notes(self) -> Iterator[Note]:
        """Note the uncertainty of the weights."""
        normal_n, shear_n = self._weights.error_n()
        text = f"weights: uncertainty {normal_n:.3f} N normal, {shear_n:.3f} N shear"
        yield Note("weights", text)

    def identity(self) -> dict[str, Any]:
        return {
            "stage": None,
            "camera": self.camera.identity() if self.camera is not None else None,
            "force": None,
        }

    def close(self) -> None:
        if self.camera is not None:
            self.camera.close()
