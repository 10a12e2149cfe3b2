"""The simulated camera: one frame of the scene at the present virtual time, and its truth."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import RunFailed
from ..files import write_whole
from ..optics import Fisheye, SurfaceLattice
from ..record import LATTICE, LENS, truth_file
from ..rig.interface import CameraFrame, Clock
from ..units import stream_number
from .drawing import noise_of
from .picture import FrameRenderer
from .scene import GelScene

Seen = tuple[int, int, float]  # between which knots, and how far from the first


@dataclass(frozen=True)
class TruthWriter:
    """Writes the truth of a run. lattice: where the scene's knots have their displacements.

    lens: what the picture is drawn through; None: a pinhole.
    """

    folder: Path
    scene: GelScene
    lattice: SurfaceLattice
    lens: Fisheye | None = None

    def write(self, press: str, frame_ids: Sequence[str], seen: Sequence[Seen]) -> None:
        """The knots of the scene's press, and where each of these frames stands between which.

        Raises RunFailed.
        """
        path = truth_file(self.folder, press)
        try:
            path.parent.mkdir(exist_ok=True)
        except OSError as why:
            raise RunFailed(f"{path.parent}: cannot be made: {why.strerror}") from why
        about: dict[Path, SurfaceLattice | Fisheye] = {self.folder / LATTICE: self.lattice}
        if self.lens is not None:
            about[self.folder / LENS] = self.lens
        for where, what in about.items():
            write_whole(where, (json.dumps(what.as_dict()) + "\n").encode())
        knots = self.scene.knots
        fields = [k.displacement_mm for k in knots if k.displacement_mm is not None]
        tractions = [k.traction_mpa for k in knots if k.traction_mpa is not None]
        x_mm, y_mm = self.scene.axes_mm
        more: dict[str, Any] = {"traction_mpa": np.stack(tractions)} if tractions else {}
        more["zone_map"] = np.stack([k.zone_map for k in knots if k.zone_map is not None])
        for name in vars(knots[0].zones):
            more[name] = [vars(k.zones)[name] for k in knots]
        packed = io.BytesIO()
        np.savez(
            packed,
            displacement_mm=np.stack(fields),
            frame_id=np.asarray(frame_ids, dtype=np.str_),
            knots=np.asarray([(a, b) for a, b, _ in seen], dtype=np.int64).reshape(-1, 2),
            fraction=np.asarray([f for _, _, f in seen], dtype=float),
            x_mm=x_mm,
            y_mm=y_mm,
            **more,
        )
        write_whole(path, packed.getvalue())


class VirtualCamera:
    """Implements rig.interface.Camera; at the end of a press it stores the truth of its frames."""

    def __init__(self, picture: FrameRenderer, clock: Clock, seed: int, truth: TruthWriter) -> None:
        """truth: its scene is what is drawn."""
        self._picture, self._clock, self._seed = picture, clock, seed
        self._truth, self._scene = truth, truth.scene
        self._stream: str | None = None
        self._seen: list[Seen] = []
        self._rng = np.random.default_rng(0)

    def begin(self, stream: str) -> None:
        """A new press: its noise depends on the seed and its name, not on what came before."""
        self._stream = stream
        self._seen = []
        self._scene.begin()
        self._rng = noise_of(self._seed, stream_number(stream))

    def capture(self) -> CameraFrame:
        assert self._stream is not None, "begin() comes before the first frame"
        seen = self._scene.observe()
        self._seen.append((seen.a.index, seen.b.index, seen.fraction))
        return CameraFrame(
            self._picture.render(seen.displacement_mm(), self._rng), self._clock.now_s()
        )

    def end(self, frames: Mapping[str, float]) -> None:
        """Store the press's knots and where each of its frames stands between which of them."""
        assert self._stream is not None, "begin() comes before end()"
        assert len(frames) == len(self._seen), "one id a frame"
        self._truth.write(self._stream, list(frames), self._seen)
        self._stream = None

    def identity(self) -> dict[str, Any]:
        projection = "pinhole" if self._truth.lens is None else "fisheye"
        return {"kind": "virtual", "projection": projection}

    def close(self) -> None:
        """Nothing is held open."""
