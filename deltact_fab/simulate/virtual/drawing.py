"""The simulated camera: what it sees of the face, its geometry, a printed gel, and its truth."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.bench import (
    CameraFrame,
    Clock,
    SimulatorConfig,
    TruthFiles,
    VirtualConfig,
)
from deltact_fab.common import Field, RunFailed, stream_number, write_whole
from deltact_fab.fabricate import PatternRecipe, pattern_albedo
from deltact_fab.physics import print_colours
from deltact_fab.sensor import Fisheye, Pinhole, Rectified, SensorDimensions, SurfaceLattice

from .picture import BAND_PX, PICTURE_MARGIN_PX, FrameRenderer, PictureGeometry, RawView, Texture
from .scene import GelScene, LatticeCrop

RESTING_MM = 1.0  # between the nodes of a face that does not move
Seen = tuple[int, int, float]  # keys of the knots around it, and how far it is from the first


def crop_of(
    config: VirtualConfig, sensor: SensorDimensions, axes_mm: tuple[Field, Field]
) -> LatticeCrop:
    """The part of a gel's lattice, with nodes (nx,) and (ny,), that the rig's camera can see."""
    optics = sensor.optics
    view = optics.view_mm
    margin_px = PICTURE_MARGIN_PX + (BAND_PX if config.virtual.lens is not None else 0)
    margin_mm = margin_px * optics.mm_per_px
    return LatticeCrop(*axes_mm, (view[0] / 2 + margin_mm, view[1] / 2 + margin_mm))


def geometry_of(
    config: VirtualConfig,
    sensor: SensorDimensions,
    view: Pinhole | Rectified,
    lattice: SurfaceLattice,
) -> tuple[PictureGeometry, Fisheye | None]:
    """What each pixel sees, and the true lens it sees through; None: a pinhole.

    view: of the images that are tracked.
    """
    if not isinstance(view, Rectified):
        return PictureGeometry(view, lattice), None
    from .lens import true_lens

    lens = true_lens(config, sensor)
    return PictureGeometry(RawView(lens, view), lattice), lens


def resting_geometry(sensor: SensorDimensions) -> PictureGeometry:
    """What each pixel of the design's own pinhole sees of a face that nothing touches."""
    camera = Pinhole.of(sensor)
    half_mm = [side / 2 + PICTURE_MARGIN_PX * camera.mm_per_px for side in sensor.optics.view_mm]
    nx, ny = (2 * math.ceil(half / RESTING_MM) + 1 for half in half_mm)
    x_mm, y_mm = (-(n - 1) / 2 * RESTING_MM for n in (nx, ny))
    return PictureGeometry(camera, SurfaceLattice(x_mm, y_mm, RESTING_MM, nx, ny))


def printed_renderer(
    simulator: SimulatorConfig, recipe: PatternRecipe, geometry: PictureGeometry, seed: int
) -> FrameRenderer:
    """The gel with that pattern as the rig's printer made it, before the rig's camera.

    Where a sticker is smaller than the view the camera sees bare film beside it.
    """
    printer = simulator.printer
    camera = geometry.camera
    view_mm = max(camera.width_px, camera.height_px) * camera.mm_per_px
    side_px = math.ceil(max(recipe.printed_mm, view_mm) / printer.mm_per_dot - 1e-9)
    rng = np.random.default_rng(np.random.SeedSequence([seed, 3]))
    values = print_colours(
        printer, pattern_albedo(recipe, printer.mm_per_dot, (side_px, side_px)), rng
    )
    return FrameRenderer(geometry, Texture(values, printer.mm_per_dot), simulator.camera)


def noise_of(seed: int, stream: int) -> np.random.Generator:
    """The camera's noise in one press, by the number of its name: it does not know the others."""
    return np.random.default_rng(np.random.SeedSequence([seed, 2, stream]))


@dataclass
class VirtualCamera:
    """Implements rig.interface.Camera; at the end of a press it stores the truth of its frames.

    scene: what is drawn. lattice: where its knots have their displacements. lens: what the picture
    is drawn through; None: a pinhole. folder: of the run.
    """

    picture: FrameRenderer
    clock: Clock
    seed: int
    scene: GelScene
    lattice: SurfaceLattice
    lens: Fisheye | None
    folder: Path

    def __post_init__(self) -> None:
        self._stream: str | None = None
        self._seen: list[Seen] = []
        self._rng = np.random.default_rng(0)

    def begin(self, stream: str) -> None:
        """A new press: its noise depends on the seed and its name, not on what came before."""
        self._stream = stream
        self._seen = []
        self.scene.begin()
        self._rng = noise_of(self.seed, stream_number(stream))

    def capture(self) -> CameraFrame:
        assert self._stream is not None, "begin() comes before the first frame"
        seen = self.scene.observe()
        self._seen.append((seen.a.key, seen.b.key, seen.fraction))
        return CameraFrame(
            self.picture.render(seen.displacement_mm(), self._rng), self.clock.now_s()
        )

    def end(self, frames: Mapping[str, float]) -> None:
        """Store the press's knots and where each of its frames stands between which of them."""
        assert self._stream is not None, "begin() comes before end()"
        assert len(frames) == len(self._seen), "one id a frame"
        files = TruthFiles(self.folder)
        path = files.press(self._stream)
        try:
            path.parent.mkdir(exist_ok=True)
        except OSError as why:
            raise RunFailed(f"{path.parent}: cannot be made: {why.strerror}") from why
        about: dict[Path, SurfaceLattice | Fisheye] = {files.lattice: self.lattice}
        if self.lens is not None:
            about[files.lens] = self.lens
        for where, what in about.items():
            write_whole(where, (json.dumps(what.as_dict()) + "\n").encode())
        knots = self.scene.knots
        row = {knot.key: k for k, knot in enumerate(knots)}
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
            frame_id=np.asarray(list(frames), dtype=np.str_),
            knots=np.asarray([(row[a], row[b]) for a, b, _ in self._seen], np.int64).reshape(-1, 2),
            fraction=np.asarray([f for _, _, f in self._seen], dtype=float),
            x_mm=x_mm,
            y_mm=y_mm,
            **more,
        )
        write_whole(path, packed.getvalue())
        self._stream = None

    def identity(self) -> dict[str, Any]:
        projection = "pinhole" if self.lens is None else "fisheye"
        return {"kind": "virtual", "projection": projection}

    def close(self) -> None:
        """Nothing is held open."""
