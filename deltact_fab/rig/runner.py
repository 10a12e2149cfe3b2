"""Runs the steps of a protocol on whatever rig it is given, and journals each of them.

An operator's interrupt (Ctrl-C, SIGTERM, SIGHUP) or any failure but the stage's own stops the
motion and lifts the tip; an error of the stage leaves it alone, for its position may be lost.
Forces are read with the frames, so this is no force guard: between two frames nobody looks.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

from ..errors import DeltactFabError, RunFailed, SensorError, StageError
from ..protocols.plan import Step
from ..record import RunWriter
from .interface import Camera, Clock, ForceSensor, Stage

Progress = Callable[[int, int, str], None]
LIFT_FEED_MM_MIN = 120.0


@dataclass
class Devices:
    """What a run drives. A camera or force sensor that the protocol does not ask for is None."""

    clock: Clock
    stage: Stage
    camera: Camera | None
    force: ForceSensor | None
    change_indenter: Callable[[str], None]
    force_limit_n: float | None = None


class Runner:
    """One run of one protocol: connect, home, then every step in order."""

    def __init__(self, devices: Devices, writer: RunWriter, progress: Progress | None = None):
        self._d = devices
        self._writer = writer
        self._progress = progress or (lambda done, total, what: None)

    def run(self, steps: Sequence[Step]) -> int:
        """Carry out all steps; return the number of frames. Raises RunFailed and its kin."""
        total = sum(s.frames for s in steps)
        lift_to_mm = min(s.target_mm[2] for s in steps if s.kind == "travel")
        done = 0
        stage = self._d.stage
        with _signals_interrupt():
            try:
                stage.connect()
                stage.home()
            except KeyboardInterrupt as why:
                stage.stop()
                raise RunFailed("stopped by the operator before the first step") from why
            for step in steps:
                try:
                    done += self._step(step, done, total)
                except StageError:
                    raise
                except BaseException as why:
                    # The tip may be in the gel: whatever went wrong, it is not left there.
                    lifted = self._lift(lift_to_mm)
                    if isinstance(why, KeyboardInterrupt):
                        raise RunFailed(
                            f"stopped by the operator in {step.id}; {lifted}; the frames before "
                            "it are kept"
                        ) from why
                    if isinstance(why, DeltactFabError):
                        raise type(why)(f"{why} ({lifted})") from why
                    raise
        return done

    def _step(self, step: Step, done: int, total: int) -> int:
        d = self._d
        start_s = d.clock.now_s()
        start_ns = _ns(start_s)
        planned_s = d.stage.start_move(step.target_mm, step.feed_mm_min)
        if step.kind in ("press", "shear") and step.frames and not step.settle_s:
            for k in range(1, step.frames + 1):
                # Whole nanoseconds from the start of the move, so that a frame is taken at the
                # same pose at any time of day.
                wait_ns = start_ns + _ns(planned_s * k / step.frames) - _ns(d.clock.now_s())
                if k == step.frames:
                    d.stage.wait()
                elif wait_ns > 0:
                    d.clock.sleep_s(wait_ns / 1e9)
                self._frame(step, k, start_s)
                self._progress(done + k, total, step.id)
        else:
            d.stage.wait()
            if step.kind == "change":
                d.change_indenter(step.indenter)
            if step.id.endswith("/rest"):
                self._begin(step.press)
            if step.frames:
                d.clock.sleep_s(step.settle_s)
                self._frame(step, 1, start_s)
                self._progress(done + 1, total, step.id)
        self._writer.step(step, planned_s, start_s, d.clock.now_s())
        return step.frames

    def _begin(self, press: str) -> None:
        """Nothing touches: tare, flush, and start the streams of this press."""
        if self._d.camera is not None:
            self._d.camera.begin(press)
        if self._d.force is not None:
            self._d.force.begin(press)

    def _frame(self, step: Step, k: int, start_s: float) -> None:
        d = self._d
        t_s = d.clock.now_s()
        frame = d.camera.capture() if d.camera is not None else None
        reading = d.force.read() if d.force is not None else None
        position_mm = d.stage.position_mm()
        t_s = frame.t_s if frame is not None else t_s
        self._writer.frame(
            step,
            k,
            frame.image if frame is not None else None,
            t_s,
            (_ns(t_s) - _ns(start_s)) / 1e9,
            position_mm,
            reading.force_n if reading is not None else None,
            reading.torque_nmm if reading is not None else None,
        )
        if reading is None:
            return
        if reading.saturated:
            raise SensorError(f"{step.id}: the force sensor is saturated at {reading.force_n} N")
        limit_n = d.force_limit_n
        peak_n = max(abs(f) for f in reading.force_n)
        if limit_n is not None and peak_n > limit_n:
            raise SensorError(f"{step.id}: force {peak_n:.2f} N over the rig's limit {limit_n} N")

    def _lift(self, height_mm: float) -> str:
        """Stop, then straight up to the clearance plane; says what came of it."""
        stage = self._d.stage
        try:
            stage.stop()
            x, y, z = stage.position_mm()
            stage.start_move((x, y, max(z, height_mm)), LIFT_FEED_MM_MIN)
            stage.wait()
        except DeltactFabError as why:
            return f"the tip could NOT be lifted: {why}"
        return "the tip was lifted"


def _ns(seconds: float) -> int:
    return round(seconds * 1e9)


@contextmanager
def _signals_interrupt() -> Iterator[None]:
    """SIGTERM and SIGHUP end a run as Ctrl-C does; only the main thread may say so."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = {n: signal.signal(n, interrupt) for n in (signal.SIGTERM, signal.SIGHUP)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
