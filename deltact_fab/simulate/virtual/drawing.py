"""The simulated camera: what it sees of the face, its geometry, and its truth."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.bench import CameraFrame, Clock, RunTruth, VirtualConfig
from deltact_fab.common import Field, RunFailed, write_whole
from deltact_fab.sensor import Fisheye, Pinhole, Rectified, SensorDimensions, SurfaceLattice

from .drift import Drift
from .picture import BAND_PX, FrameRenderer, PictureGeometry, RawView
from .population import NOMINAL_SENSOR, SensorDraw
from .scene import GelScene, LatticeCrop

FrameKnots = tuple[int, int, float]  # keys of the knots around it, and how far it is from the first


def crop_lattice(
    config: VirtualConfig,
    sensor: SensorDimensions,
    axes_mm: tuple[Field, Field],
    draw: SensorDraw = NOMINAL_SENSOR,
) -> LatticeCrop:
    """Crop a gel's lattice, with nodes (nx,) and (ny,), to what the rig's camera can see."""
    optics = sensor.optics
    view = optics.view_mm
    wider = config.virtual.lens is not None or draw.number is not None
    margin_px = PictureGeometry.MARGIN_PX + (BAND_PX if wider else 0)
    margin_mm = margin_px * optics.mm_per_px
    return LatticeCrop(*axes_mm, (view[0] / 2 + margin_mm, view[1] / 2 + margin_mm))


def picture_geometry(
    config: VirtualConfig,
    sensor: SensorDimensions,
    view: Pinhole | Rectified,
    lattice: SurfaceLattice,
    draw: SensorDraw = NOMINAL_SENSOR,
) -> tuple[PictureGeometry, Fisheye | Pinhole | None]:
    """The geometry of the rig's picture, and its true camera; None: the view itself.

    view: of the images that are tracked.
    """
    if draw.number is None and not isinstance(view, Rectified):
        return PictureGeometry(view, lattice), None
    from .lens import true_camera

    lens = true_camera(config, sensor, view, draw)
    return PictureGeometry(view if lens is None else RawView(lens, view), lattice), lens


@dataclass
class VirtualCamera:
    """Implements rig.interface.Camera; at the end of a press it stores the truth of its frames.

    scene: what is drawn. lattice: where its knots have their displacements. lens: what the picture
    is drawn through; None: the recorded pinhole. folder: of the run. drift: of the light.
    """

    picture: FrameRenderer
    clock: Clock
    seed: int
    scene: GelScene
    lattice: SurfaceLattice
    lens: Fisheye | Pinhole | None
    folder: Path
    drift: Drift | None = None

    def __post_init__(self) -> None:
        self._stream: str | None = None
        self._frames: list[FrameKnots] = []
        self._rng = np.random.default_rng(0)

    def begin(self, stream: str) -> None:
        """A new press: its noise depends on the seed and its name, not on what came before."""
        self._stream = stream
        self._frames = []
        self.scene.begin(stream)
        self._rng = FrameRenderer.noise(self.seed, stream)

    def capture(self) -> CameraFrame:
        assert self._stream is not None, "begin() comes before the first frame"
        observation = self.scene.observe()
        self._frames.append((observation.a.key, observation.b.key, observation.fraction))
        if self.drift is not None:
            self.picture.set_light(self.drift.light())
        return CameraFrame(
            self.picture.render(observation.displacement_mm(), self._rng), self.clock.now_s()
        )

    def end(self, frames: Mapping[str, float]) -> None:
        """Store the press's knots and where each of its frames stands between which of them."""
        assert self._stream is not None, "begin() comes before end()"
        assert len(frames) == len(self._frames), "one id per frame"
        path = self.folder / RunTruth.file(self._stream)
        try:
            path.parent.mkdir(exist_ok=True)
        except OSError as error:
            raise RunFailed(f"{path.parent}: cannot be created: {error.strerror}") from error
        models: dict[str, SurfaceLattice | Fisheye | Pinhole] = {"lattice": self.lattice}
        if self.lens is not None:
            models["lens"] = self.lens
        for name, model in models.items():
            file = self.folder / RunTruth.file(name, "json")
            write_whole(file, (json.dumps(model.as_dict()) + "\n").encode())
        knots = self.scene.knots
        row = {knot.key: k for k, knot in enumerate(knots)}
        fields = [k.displacement_mm for k in knots if k.displacement_mm is not None]
        tractions = [k.traction_mpa for k in knots if k.traction_mpa is not None]
        x_mm, y_mm = self.scene.axes_mm
        arrays: dict[str, Any] = {"traction_mpa": np.stack(tractions)} if tractions else {}
        arrays["zone_map"] = np.stack([k.zone_map for k in knots if k.zone_map is not None])
        for name in vars(knots[0].zones):
            arrays[name] = [vars(k.zones)[name] for k in knots]
        packed = io.BytesIO()
        np.savez(
            packed,
            displacement_mm=np.stack(fields),
            frame_id=np.asarray(list(frames), dtype=np.str_),
            knots=np.array([(row[a], row[b]) for a, b, _ in self._frames], np.int64).reshape(-1, 2),
            fraction=np.asarray([f for _, _, f in self._frames], dtype=float),
            x_mm=x_mm,
            y_mm=y_mm,
            **arrays,
        )
        write_whole(path, packed.getvalue())
        self._stream = None

    def identity(self) -> dict[str, Any]:
        projection = "fisheye" if isinstance(self.lens, Fisheye) else "pinhole"
        return {"kind": "virtual", "projection": projection}

    def close(self) -> None:
        """Nothing is held open."""
