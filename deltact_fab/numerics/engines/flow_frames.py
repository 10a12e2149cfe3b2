"""Frames for the flow: what the virtual camera sees of known motions, drawn once a scratch folder.

All of it is synthetic. The truth is the displacement that the frames were drawn from.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ...aliases import Field, Image
from ...elasticity.material import GelMaterial
from ...files import whole
from ...imaging import ImageSensor, Printer
from ...optics import Pinhole, SurfaceLattice, axes_mm
from ...patterns.raster import albedo
from ...patterns.recipe import PatternRecipe, load_recipe
from ...shapes import SensorDimensions
from ...study.star import Star
from ...virtual.picture import MARGIN_PX, FrameRenderer, Geometry, Texture
from ...virtual.scene import LatticeCrop

Vectors = NDArray[np.float32]
Motion = Callable[[Field, Field], Field]

SENSOR = SensorDimensions()
CAMERA = Pinhole.of(SENSOR)
MM_PER_PX = CAMERA.mm_per_px
STAR = Star(CAMERA.width_px, CAMERA.height_px)
"""v = 0.5 cos(2 pi y / p(x)) px, p from 10 to 300 px, as of the DIC Challenge 2.0."""
MOVING_MM = 0.1  # as in the tracking error
SEED = 11
DOTS = load_recipe("dense-with-dots")
# The tracker's thresholds were set on the pattern with dots: these have other seeds.
COARSE = PatternRecipe(law="algorithm1", seed=23, patch_mm=0.15, r=0.1)
FINE = PatternRecipe(law="algorithm1", seed=101, patch_mm=0.075, r=0.6)


class FlowSequence(NamedTuple):
    """A sequence and its truth.

    images: (n, h, w, 3) BGR or (n, h, w) grey, the first at rest. truth_px: (h, w, 2) of the last.
    parts: (n,) the shares of it that the frames have.
    """

    images: Image
    truth_px: Vectors
    parts: Field

    @property
    def last(self) -> Image:
        """The frame with all of the motion."""
        return self.images[-1]

    def every(self, step: int) -> FlowSequence:
        """The same motion in fewer frames."""
        return self._replace(images=self.images[::step], parts=self.parts[::step])

    def nodes(self, step: int = 1) -> FlowSequence:
        """The truth of every step-th node of the half grid, the middle of four pixels."""
        half = cv2.resize(self.truth_px, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        return self._replace(truth_px=np.asarray(half[::step, ::step], np.float32))

    def seen(self) -> NDArray[np.bool_]:
        """Points (h, w) that are still in view in the last frame."""
        rows, columns = self.images.shape[1:3]
        h, w = self.truth_px.shape[:2]
        step = columns // w
        first = 0.0 if step == 1 else 0.5
        at = np.meshgrid(first + step * np.arange(w), first + step * np.arange(h))
        x, y = (g + self.truth_px[..., i] for i, g in enumerate(at))
        return np.asarray((x >= 0) & (x <= columns - 1) & (y >= 0) & (y <= rows - 1))

    def moving(self) -> NDArray[np.bool_]:
        """Points that are judged: a true motion of at least 0.1 mm that stays in view."""
        size = np.hypot(*np.moveaxis(self.truth_px, -1, 0)) * MM_PER_PX
        return np.asarray(self.seen() & (size >= MOVING_MM))

    def error_px(self, flow_px: Vectors) -> Vectors:
        """Endpoint error (h, w) of the last frame's flow."""
        return np.hypot(*np.moveaxis(flow_px - self.truth_px, -1, 0))

    def mean_error_mm(self, flow_px: Vectors) -> float:
        """Mean endpoint error over the moving points, mm at rest."""
        return float(self.error_px(flow_px)[self.moving()].mean(dtype=np.float64) * MM_PER_PX)


def scene(scratch: Path, name: str) -> FlowSequence:
    """A scene by a name of `SCENES`, drawn once a scratch folder."""
    path = scratch / f"flow-{name}.npz"
    if not path.exists():
        cv2.setNumThreads(1)
        with whole(path, sync=False) as part, part.open("wb") as out:
            np.savez(out, **SCENES[name]()._asdict())
    with np.load(path) as data:
        return FlowSequence(**{field: data[field] for field in FlowSequence._fields})


def drawn(
    recipe: PatternRecipe,
    lattice: SurfaceLattice,
    displacement_mm: Field,
    n_frames: int = 1,
    sensor: ImageSensor | None = None,
) -> FlowSequence:
    """Rest and `n_frames` equal parts of a displacement (ny, nx, 3) on a lattice of the face."""
    rng = np.random.default_rng(SEED)
    printer = Printer()
    printed = printer.print_(albedo(recipe, printer.mm_per_dot), rng)
    texture = Texture(printed, printer.mm_per_dot)
    picture = FrameRenderer(Geometry(CAMERA, lattice), texture, sensor or ImageSensor())
    inner = slice(MARGIN_PX, -MARGIN_PX)
    truth = np.ascontiguousarray(picture.geometry.forward_px(displacement_mm)[inner, inner])
    parts = np.arange(n_frames + 1) / n_frames
    images = [picture.render(displacement_mm * part if part else None, rng) for part in parts]
    return FlowSequence(np.stack(images), truth, parts)


def in_plane(
    recipe: PatternRecipe, motion: Motion, n_frames: int = 1, mosaic: bool = True
) -> FlowSequence:
    """A motion in the plane of the face, given in pixels at the pixels' places."""
    reach = MARGIN_PX + 2
    x_mm, y_mm = axes_mm(CAMERA, reach)
    lattice = SurfaceLattice(float(x_mm[0]), float(y_mm[0]), MM_PER_PX, len(x_mm), len(y_mm))
    at = np.meshgrid(np.arange(len(x_mm)) - float(reach), np.arange(len(y_mm)) - float(reach))
    moved = motion(*at) * MM_PER_PX
    return drawn(recipe, lattice, np.dstack((moved, np.zeros(moved.shape[:2]))), n_frames,
                 ImageSensor(mosaic=mosaic))  # fmt: skip


def bump(peak_px: float, front_px: float, back_px: float, x: Field, y: Field) -> Field:
    """A shift of peak_px to the right and down with Gaussian flanks of two widths, (h, w, 2).

    It moves along the direction in which the flanks differ, so det F = 1 + its slope there: from
    1 - .607 peak / front to 1 + .607 peak / back.
    """
    along = np.array([2.0, 1.0]) / np.sqrt(5)
    x, y = x - CAMERA.centre_px[0], y - CAMERA.centre_px[1]
    s, across = along[0] * x + along[1] * y, along[0] * y - along[1] * x
    width = np.where(s > 0, front_px, back_px)
    size = np.exp(-((s / width) ** 2) / 2 - (across / 110.0) ** 2 / 2)
    return np.asarray(peak_px * size[..., None] * along)


far: Motion = partial(bump, 121.0, 105.0, 73.5)
"""121 px, det F from .3 to 2."""
near: Motion = partial(bump, 12.0, 90.0, 90.0)


def speckle_star() -> FlowSequence:
    """The star on grey speckle, without printer, lens and mosaic, with the Challenge's noise.

    Speckle and noise as measured on its image "Star, noise": 118 +- 38 grey levels, correlation
    exp(-(d / 2.74 px)^2), noise of variance 0.5 + 0.031 x grey level.
    """
    rng = np.random.default_rng(SEED)
    w, h, fine = CAMERA.width_px, CAMERA.height_px, 4
    size = (h + 16) * fine, (w + 16) * fine
    white = rng.standard_normal(size, dtype=np.float32)
    field = cv2.GaussianBlur(white, (0, 0), 1.37 * fine)
    level = 118 + 55 * np.tanh(field / field.std())
    x, y = np.meshgrid(np.arange(float(w)), np.arange(float(h)))
    truth = STAR.motion(x, y)
    back = y.copy()
    for _ in range(30):  # the slope is .31 at most
        back = y - STAR.motion(x, back)[..., 1]
    images = []
    columns = ((x + 8.5) * fine - 0.5).astype(np.float32)
    for rows in (y, back):
        at = ((rows + 8.5) * fine - 0.5).astype(np.float32)
        seen = cv2.remap(level, columns, at, cv2.INTER_CUBIC)
        noisy = seen + np.sqrt(0.5 + 0.031 * seen) * rng.standard_normal(seen.shape)
        images.append(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    return FlowSequence(np.stack(images), truth.astype(np.float32), np.array([0.0, 1.0]))


def _on_the_gel(make: Callable[[Any], Field], mosaic: bool = True) -> FlowSequence:
    from ...elasticity.layer import BondedLayer

    layer = BondedLayer.for_skin(SENSOR.skin, GelMaterial(), spacing_mm=0.25)
    view, margin_mm = SENSOR.optics.view_mm, MARGIN_PX * MM_PER_PX
    crop = LatticeCrop(layer.x_mm, layer.y_mm, (view[0] / 2 + margin_mm, view[1] / 2 + margin_mm))
    return drawn(DOTS, crop.lattice, crop(make(layer)).astype(np.float64),
                 sensor=ImageSensor(mosaic=mosaic))  # fmt: skip


def _pressed(layer: Any) -> Field:
    from ...gel.level import follow
    from ...gel.linear.contact import LayerContact
    from ...shapes.indenter import parse

    contact = LayerContact(layer, parse("sphere:10"))
    *_, pressed = follow(contact, contact.rest(), (0.0, 0.0, 1.2), 0.3)
    *_, sheared = follow(contact, pressed, (1.5, 0.0, 1.2), 0.3)
    return sheared.displacement_mm


def _slid(shift_mm: tuple[float, float], width_mm: float, layer: Any) -> Field:
    """A Gaussian shift with 1 mm of depth at its centre, (ny, nx, 3)."""
    xx, yy = np.meshgrid(layer.x_mm, layer.y_mm)
    b = np.exp(-(xx**2 + yy**2) / (2 * width_mm**2))
    return np.stack([shift_mm[0] * b, shift_mm[1] * b, -b], axis=-1)


SCENES: dict[str, Callable[[], FlowSequence]] = {
    "press": partial(_on_the_gel, _pressed),
    "press, three chips": partial(_on_the_gel, _pressed, mosaic=False),
    "slide": partial(_on_the_gel, partial(_slid, (2.7, 1.35), 5.0)),
    "star: speckle": speckle_star,
    "star: coarse": partial(in_plane, COARSE, STAR.motion),
    "star: coarse, three chips": partial(in_plane, COARSE, STAR.motion, mosaic=False),
    "far": partial(in_plane, COARSE, far, 10),
    "far, fine": partial(in_plane, FINE, far, 10),
    "near": partial(in_plane, COARSE, near, 4),
    "near, fine": partial(in_plane, FINE, near, 4),
    "other seed": partial(in_plane, COARSE.model_copy(update={"seed": 24}), near),
    "other seed, fine": partial(in_plane, FINE.model_copy(update={"seed": 102}), near),
}
