"""The simulated camera: one frame of the scene at the present virtual time, and its truth."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import RunFailed
from ..files import write_whole
from ..optics import Fisheye, SurfaceLattice
from ..record import lattice_file, lens_file, truth_file
from ..rig.interface import CameraFrame, Clock
from .drawing import noise_of
from .picture import FrameRenderer
from .scene import GelScene
from .seeds import stream_number

Seen = tuple[int, int, float]  # between which knots, and how far from the first


class VirtualCamera:
    """Implements rig.interface.Camera; at the end of a press it stores the truth of its frames."""

    def __init__(
        self,
        picture: FrameRenderer,
        scene: GelScene,
        clock: Clock,
        seed: int,
        lattice: SurfaceLattice,
        folder: Path,
        lens: Fisheye | None = None,
    ) -> None:
        """lattice: where the scene's knots have their displacements. folder: of the run.

        lens: what the picture is drawn through, for the truth.
        """
        self._picture = picture
        self._scene = scene
        self._clock = clock
        self._seed = seed
        self._lattice = lattice
        self._folder = folder
        self._lens = lens
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
        """Draw the scene as it is now."""
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
        write_truth(
            self._folder,
            self._stream,
            list(frames),
            self._seen,
            self._scene,
            self._lattice,
            self._lens,
        )
        self._stream = None

    def identity(self) -> dict[str, Any]:
        """What the record keeps."""
        projection = "pinhole" if self._lens is None else "fisheye"
        return {"kind": "virtual", "projection": projection}

    def close(self) -> None:
        """Nothing is held open."""


def write_truth(
    folder: Path,
    press: str,
    frame_ids: Sequence[str],
    seen: Sequence[Seen],
    scene: GelScene,
    lattice: SurfaceLattice,
    lens: Fisheye | None,
) -> None:
    """The knots of the scene's press and where each of these frames stands between which of them.

    folder: of the run. Raises RunFailed.
    """
    path = truth_file(folder, press)
    try:
        path.parent.mkdir(exist_ok=True)
    except OSError as why:
        raise RunFailed(f"{path.parent}: cannot be made: {why.strerror}") from why
    about: dict[Path, SurfaceLattice | Fisheye] = {lattice_file(folder): lattice}
    if lens is not None:
        about[lens_file(folder)] = lens
    for where, what in about.items():
        write_whole(where, (json.dumps(what.as_dict()) + "\n").encode())
    knots = [k.displacement_mm for k in scene.knots if k.displacement_mm is not None]
    tractions = [k.traction_mpa for k in scene.knots if k.traction_mpa is not None]
    asked: dict[str, Any] = {}
    if tractions:
        x_mm, y_mm = scene.axes_mm
        asked = {"traction_mpa": np.stack(tractions), "x_mm": x_mm, "y_mm": y_mm}
    packed = io.BytesIO()
    np.savez(
        packed,
        displacement_mm=np.stack(knots),
        frame_id=np.asarray(frame_ids, dtype=np.str_),
        knots=np.asarray([(a, b) for a, b, _ in seen], dtype=np.int64).reshape(-1, 2),
        fraction=np.asarray([f for _, _, f in seen], dtype=float),
        **asked,
    )
    write_whole(path, packed.getvalue())
