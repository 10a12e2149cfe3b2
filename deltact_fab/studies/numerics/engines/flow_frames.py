"""Frames for the flow: known motions rendered by the virtual camera, once per scratch folder.

All synthetic. The truth is the displacement that the frames were drawn from.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Field, Image, whole_file
from deltact_fab.fabricate import PatternRecipe, load_recipe, pattern_albedo
from deltact_fab.physics import print_colours
from deltact_fab.sensor import (
    GelMaterial,
    ImageSensor,
    Pinhole,
    Printer,
    SensorDimensions,
    SurfaceLattice,
    axes_mm,
)
from deltact_fab.simulate import FrameRenderer, LatticeCrop, PictureGeometry

Vectors = NDArray[np.float32]
Motion = Callable[[Field, Field], Field]

DEFAULT_SENSOR = SensorDimensions()
DEFAULT_CAMERA = Pinhole.from_sensor(DEFAULT_SENSOR)
VIEW_MM_PER_PX = DEFAULT_CAMERA.mm_per_px
PICTURE_MARGIN_PX = PictureGeometry.MARGIN_PX
MIN_MOTION_MM = 0.1  # definition: as in the tracking error
FRAMES_SEED = 11  # by hand: any fixed seed
DOTS_RECIPE = load_recipe("dense-with-dots")
# Seeds other than that of the dots pattern, on which the tracker's thresholds were set.
COARSE_RECIPE = PatternRecipe(law="algorithm1", seed=23, patch_mm=0.15, r=0.1)
FINE_RECIPE = PatternRecipe(law="algorithm1", seed=101, patch_mm=0.075, r=0.6)


class FlowSequence(NamedTuple):
    """A sequence and its truth.

    images: (n, h, w, 3) BGR or (n, h, w) grey, the first at rest, the others equal parts of the
    motion. truth_px: (h, w, 2) of the last.
    """

    images: Image
    truth_px: Vectors

    @property
    def last(self) -> Image:
        return self.images[-1]

    def in_view(self) -> NDArray[np.bool_]:
        """Mask (h, w) of pixels still in view in the last frame."""
        h, w = self.truth_px.shape[:2]
        x, y = np.moveaxis(self.truth_px, -1, 0) + np.meshgrid(np.arange(w), np.arange(h))
        return np.asarray((x >= 0) & (x <= w - 1) & (y >= 0) & (y <= h - 1))

    def moving(self) -> NDArray[np.bool_]:
        """Mask (h, w) of evaluated pixels: true motion of at least 0.1 mm that stays in view."""
        size = np.hypot(*np.moveaxis(self.truth_px, -1, 0)) * VIEW_MM_PER_PX
        return np.asarray(self.in_view() & (size >= MIN_MOTION_MM))

    def error_px(self, flow_px: Vectors) -> Vectors:
        """Endpoint error (h, w) of the last frame's flow."""
        return np.hypot(*np.moveaxis(flow_px - self.truth_px, -1, 0))

    def mean_error_mm(self, flow_px: Vectors) -> float:
        """Mean endpoint error over the moving pixels, mm at rest."""
        return float(self.error_px(flow_px)[self.moving()].mean(dtype=np.float64) * VIEW_MM_PER_PX)


def scene(scratch: Path, name: str) -> FlowSequence:
    """Load a scene of `FLOW_SCENES`; rendered once per scratch folder."""
    path = scratch / f"flow-{name}.npz"
    if not path.exists():
        cv2.setNumThreads(1)
        with whole_file(path, sync=False) as part, part.open("wb") as out:
            np.savez(out, **FLOW_SCENES[name]()._asdict())
    with np.load(path) as data:
        return FlowSequence(**{field: data[field] for field in FlowSequence._fields})


def render_sequence(
    recipe: PatternRecipe,
    lattice: SurfaceLattice,
    displacement_mm: Field,
    n_frames: int = 1,
    sensor: ImageSensor | None = None,
) -> FlowSequence:
    """Render rest and `n_frames` equal steps of a displacement (ny, nx, 3) on a face lattice."""
    rng = np.random.default_rng(FRAMES_SEED)
    printer = Printer()
    printed = print_colours(printer, pattern_albedo(recipe, printer.mm_per_dot), rng)
    geometry = PictureGeometry(DEFAULT_CAMERA, lattice)
    picture = FrameRenderer(geometry, printed, printer.mm_per_dot, sensor or ImageSensor())
    inner = slice(PICTURE_MARGIN_PX, -PICTURE_MARGIN_PX)
    truth = np.ascontiguousarray(geometry.forward_px(displacement_mm)[inner, inner])
    images = [picture.render(displacement_mm * (k / n_frames) if k else None, rng)
              for k in range(n_frames + 1)]  # fmt: skip
    return FlowSequence(np.stack(images), truth)


def in_plane(
    recipe: PatternRecipe, motion: Motion, n_frames: int = 1, sensor: ImageSensor | None = None
) -> FlowSequence:
    """Render a motion in the plane of the face, given in px at pixel positions."""
    reach = PICTURE_MARGIN_PX + 2
    x_mm, y_mm = axes_mm(DEFAULT_CAMERA, reach)
    lattice = SurfaceLattice(float(x_mm[0]), float(y_mm[0]), VIEW_MM_PER_PX, len(x_mm), len(y_mm))
    grid_px = np.meshgrid(np.arange(len(x_mm)) - float(reach), np.arange(len(y_mm)) - float(reach))
    shift_mm = motion(*grid_px) * VIEW_MM_PER_PX
    flat = np.dstack((shift_mm, np.zeros(shift_mm.shape[:2])))
    return render_sequence(recipe, lattice, flat, n_frames, sensor)


def bump(peak_px: float, front_px: float, back_px: float, x: Field, y: Field) -> Field:
    """A shift of peak_px to the right and down with Gaussian flanks of two widths, (h, w, 2).

    It moves along the direction in which the flanks differ, so det F = 1 + its slope there: from
    1 - 0.607 peak / front to 1 + 0.607 peak / back.
    """
    along = np.array([2.0, 1.0]) / np.sqrt(5)
    x, y = x - DEFAULT_CAMERA.centre_px[0], y - DEFAULT_CAMERA.centre_px[1]
    s, across = along[0] * x + along[1] * y, along[0] * y - along[1] * x
    width = np.where(s > 0, front_px, back_px)
    size = np.exp(-((s / width) ** 2) / 2 - (across / 110.0) ** 2 / 2)
    return np.asarray(peak_px * size[..., None] * along)


far_bump: Motion = partial(bump, 121.0, 105.0, 73.5)
"""121 px, det F from 0.3 to 2."""
near_bump: Motion = partial(bump, 12.0, 90.0, 90.0)


@cache
def _press() -> tuple[SurfaceLattice, Field]:
    """The face under a press with shear on the linear gel, and its displacement (ny, nx, 3)."""
    from deltact_fab.physics import LinearContact, follow_path
    from deltact_fab.sensor import FreeBlock, parse_indenter

    face = FreeBlock(DEFAULT_SENSOR.skin, GelMaterial(), spacing_mm=0.25)
    contact = LinearContact(face, parse_indenter("sphere:10"))
    *_, down = follow_path(contact, contact.rest(), (0.0, 0.0, 1.2), 0.3)
    *_, sheared = follow_path(contact, down, (1.5, 0.0, 1.2), 0.3)
    view, margin_mm = DEFAULT_SENSOR.optics.view_mm, PICTURE_MARGIN_PX * VIEW_MM_PER_PX
    crop = LatticeCrop(face.x_mm, face.y_mm, (view[0] / 2 + margin_mm, view[1] / 2 + margin_mm))
    return crop.lattice, crop(sheared.displacement_mm).astype(np.float64)


def pressed(recipe: PatternRecipe = DOTS_RECIPE, sensor: ImageSensor | None = None) -> FlowSequence:
    """A press with shear on the linear gel, as a camera sees it."""
    return render_sequence(recipe, *_press(), sensor=sensor)


FLOW_SCENES: dict[str, Callable[[], FlowSequence]] = {
    "press": pressed,
    "far": partial(in_plane, COARSE_RECIPE, far_bump, 10),
    "near": partial(in_plane, COARSE_RECIPE, near_bump, 4),
    "near, fine": partial(in_plane, FINE_RECIPE, near_bump, 4),
    "other seed": partial(in_plane, COARSE_RECIPE.model_copy(update={"seed": 24}), near_bump),
    "other seed, fine": partial(in_plane, FINE_RECIPE.model_copy(update={"seed": 102}), near_bump),
}
