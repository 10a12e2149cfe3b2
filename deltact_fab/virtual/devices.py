"""The simulated camera: one frame of the scene at the present virtual time, and its truth."""

from __future__ import annotations

import io
import json
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..optics import SurfaceLattice
from ..record import write_whole
from ..rig.interface import Clock, Frame
from .picture import Picture
from .scene import GelScene


def stream_number(stream: str) -> int:
    """A number for a stream's name that is the same in every process."""
    return zlib.crc32(stream.encode())


@dataclass
class Truth:
    """Where each drawn frame stands between which knots, press by press."""

    lattice: SurfaceLattice
    frames: dict[str, list[tuple[int, int, float]]] = field(default_factory=dict)
    knots: dict[str, int] = field(default_factory=dict)

    def write_press(self, folder: Path, press: str, scene: GelScene) -> None:
        """Store the knots of a finished press."""
        folder.mkdir(exist_ok=True)
        stacked = np.stack(
            [k.displacement_mm for k in scene.knots if k.displacement_mm is not None]
        )
        self.knots[press] = len(stacked)
        out = io.BytesIO()
        np.savez(out, displacement_mm=stacked)
        write_whole(folder / f"{press.replace('/', '_')}.npz", out.getvalue())

    def write_index(self, folder: Path, frame_ids: dict[str, list[str]]) -> None:
        """Match drawn frames with the journal's, which lists them in the same order."""
        index: dict[str, Any] = {}
        for press, ids in frame_ids.items():
            for frame_id, (a, b, fraction) in zip(ids, self.frames[press], strict=True):
                index[frame_id] = [f"{press}:{a}:{b}", fraction]
        data = {"lattice": self.lattice.as_dict(), "frames": index}
        write_whole(folder / "index.json", (json.dumps(data, indent=0) + "\n").encode())


class VirtualCamera:
    """Implements rig.interface.Camera."""

    def __init__(
        self, picture: Picture, scene: GelScene, clock: Clock, seed: int, truth: Truth, folder: Path
    ) -> None:
        self._picture = picture
        self._scene = scene
        self._clock = clock
        self._seed = seed
        self.truth = truth
        self._folder = folder
        self._press: str | None = None
        self._rng = np.random.default_rng(0)

    def begin(self, stream: str) -> None:
        """A new press: its noise depends on the seed and its name, not on what came before."""
        self.finish()
        self._press = stream
        self.truth.frames[stream] = []
        self._scene.begin()
        seeds = np.random.SeedSequence([self._seed, 2, stream_number(stream)])
        self._rng = np.random.default_rng(seeds)

    def capture(self) -> Frame:
        """Draw the scene as it is now."""
        assert self._press is not None, "begin() comes before the first frame"
        seen = self._scene.observe()
        self.truth.frames[self._press].append((seen.a.index, seen.b.index, seen.fraction))
        return Frame(self._picture.render(seen.displacement_mm(), self._rng), self._clock.now_s())

    def finish(self) -> None:
        """Store the truth of the press that ends."""
        if self._press is not None:
            self.truth.write_press(self._folder / "truth", self._press, self._scene)
            self._press = None

    def identity(self) -> dict[str, Any]:
        """What the record keeps."""
        return {"kind": "virtual", "projection": "pinhole"}

    def close(self) -> None:
        """Nothing is held open."""
