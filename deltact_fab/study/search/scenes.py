"""Known motions in the camera's view, drawn for any print: subpixel shifts, a star, a drag.

All of it is simulated. What a pixel sees of the face depends on the motion alone, so it is solved
once a process and serves every pattern.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ...aliases import Field, Float
from ...imaging import ImageSensor, Printer
from ...optics import Pinhole, SurfaceLattice, axes_mm
from ...patterns.raster import albedo
from ...patterns.recipe import PatternRecipe
from ...virtual.picture import MARGIN_PX, FrameRenderer, Geometry, Texture
from ..star import Star
from .imager import PatternImager

BEYOND_MM = 1.0
"""Printed around what moves into the view: spread and misplaced ink come from there too."""
LATTICE_MM = 0.3
SHIFTS_PX = ((0.25, 0.0), (0.0, 0.75), (0.5, 0.25), (0.75, 0.5), (1.25, 1.0), (1.0, 1.5))
"""Quarters of a pixel each way, and both phases of the mosaic, which has a period of two."""
MAX_STAR_PX = 190.0
"""Longest period of the star: the view that is judged is smaller than the DIC Challenge's."""

DRAG_MM = 2.4
"""The largest motion of the drag, STEP_MM a frame: 12 frames, which many steps divide."""
STEP_MM = 0.2
OUTWARD = round(DRAG_MM / STEP_MM)
DRAG_WIDTH_MM, DRAG_DEPTH_MM = 2.0, 2.0
"""So steep that the skin before it nearly folds (det F .2) and is lost to a tracker, as before an
indenter that is dragged: where it comes back, a pattern that repeats itself is mistaken for itself.
With a width of 3 mm that never happens, and the order of patterns is not that on the gel."""
WAVES = ((1.5, 0.015), (2.5, 0.03), (4.0, 0.06))
"""Wavelength and amplitude (mm) of smooth waves on top: a slope of .06 to .09 each."""


class FaceSampling(NamedTuple):
    """What pixels see of the face (h + 2, w + 2, 2), and where rest pixels go (h, w, 2), px."""

    at_px: Float
    truth_px: Float


@dataclass(frozen=True)
class CameraView:
    """A camera and its sensor; it keeps what was solved for a motion, for any print."""

    camera: Pinhole
    sensor: ImageSensor

    def printed(self, recipe: PatternRecipe, printer: Printer, rng: np.random.Generator) -> Texture:
        """The part of the print that can come into view."""
        reach_mm = DRAG_MM + BEYOND_MM
        height, width = (
            round((side_px * self.camera.mm_per_px + 2 * reach_mm) / printer.mm_per_dot)
            for side_px in (self.camera.height_px, self.camera.width_px)
        )
        colours = albedo(recipe, printer.mm_per_dot, (height, width))
        return Texture(printer.print_(colours, rng), printer.mm_per_dot)

    def picture(self, texture: Texture, sensor: ImageSensor | None = None) -> FrameRenderer:
        """What draws a print; sensor: None for the view's own."""
        return FrameRenderer(geometry(self, LATTICE_MM), texture, sensor or self.sensor)


def lattice(camera: Pinhole, spacing_mm: float) -> SurfaceLattice:
    """Nodes over the view and its margin."""
    x_mm, y_mm = axes_mm(camera, MARGIN_PX + 1)
    nx, ny = (int(np.ceil((a[-1] - a[0]) / spacing_mm)) + 1 for a in (x_mm, y_mm))
    return SurfaceLattice(float(x_mm[0]), float(y_mm[0]), spacing_mm, nx, ny)


@lru_cache(maxsize=4)
def geometry(view: CameraView, spacing_mm: float) -> Geometry:
    """Of displacements on a lattice of that spacing."""
    return Geometry(view.camera, lattice(view.camera, spacing_mm))


def _drawn(view: CameraView, fields_mm: Sequence[Field], spacing_mm: float) -> list[FaceSampling]:
    seen = geometry(view, spacing_mm)
    inner = slice(MARGIN_PX, -MARGIN_PX)
    return [
        FaceSampling(seen.material_px(u), np.ascontiguousarray(seen.forward_px(u)[inner, inner]))
        for u in fields_mm
    ]


def _grid(view: CameraView, spacing_mm: float) -> tuple[Field, Field]:
    return np.meshgrid(*lattice(view.camera, spacing_mm).axes_mm())


@lru_cache(maxsize=2)
def at_rest(view: CameraView) -> FaceSampling:
    """No motion."""
    x, _ = _grid(view, LATTICE_MM)
    return _drawn(view, [np.zeros((*x.shape, 3))], LATTICE_MM)[0]


@lru_cache(maxsize=2)
def shifted(view: CameraView) -> list[FaceSampling]:
    """The print moved as a whole, by SHIFTS_PX."""
    x, _ = _grid(view, LATTICE_MM)
    scale = view.camera.mm_per_px
    fields = [
        np.broadcast_to(np.array([sx * scale, sy * scale, 0.0]), (*x.shape, 3))
        for sx, sy in SHIFTS_PX
    ]
    return _drawn(view, fields, LATTICE_MM)


def star_of(view: CameraView) -> Star:
    """The star over a view."""
    camera = view.camera
    most_px = min(MAX_STAR_PX, 0.45 * camera.height_px)
    return Star(camera.width_px, camera.height_px, most_px=most_px)


@lru_cache(maxsize=2)
def starred(view: CameraView) -> FaceSampling:
    """The star as a motion of the face."""
    spacing_mm = view.camera.mm_per_px
    x, y = _grid(view, spacing_mm)
    at_px = view.camera.rest_px(np.stack((x, y), axis=-1))
    moved = star_of(view).motion(at_px[..., 0], at_px[..., 1]) * spacing_mm
    return _drawn(view, [np.dstack((moved, np.zeros(x.shape)))], spacing_mm)[0]


@lru_cache(maxsize=2)
def dragged(view: CameraView, seed: int) -> list[FaceSampling]:
    """Frames of a press that is dragged and goes back, with waves on the skin.

    In steps of STEP_MM; the first half and one more, OUTWARD, lead to the largest motion.
    """
    rng = np.random.default_rng([seed, 22])
    x, y = _grid(view, LATTICE_MM)
    whole = drag_mm(x, y, rng)
    whole *= DRAG_MM / np.hypot(whole[..., 0], whole[..., 1]).max()
    shares = [k / OUTWARD for k in (*range(1, OUTWARD + 1), *range(OUTWARD - 1, 0, -1))]
    return _drawn(view, [whole * share for share in shares], LATTICE_MM)


def drag_mm(x: Field, y: Field, rng: np.random.Generator) -> Field:
    """Displacement (h, w, 3) at points of the face: a dent, a shift with it, and waves."""
    bump = np.exp(-(x**2 + y**2) / (2 * DRAG_WIDTH_MM**2))
    heading = rng.uniform(0, 2 * np.pi)
    u = np.stack([DRAG_MM * np.cos(heading) * bump, DRAG_MM * np.sin(heading) * bump,
                  -DRAG_DEPTH_MM * bump], axis=-1)  # fmt: skip
    for wavelength_mm, amplitude_mm in WAVES:
        along, to, phase = rng.uniform(0, 2 * np.pi, 3)
        way = (x * np.cos(along) + y * np.sin(along)) / wavelength_mm
        wave = amplitude_mm * np.sin(2 * np.pi * way + phase)
        u[..., 0] += wave * np.cos(to)
        u[..., 1] += wave * np.sin(to)
    return np.asarray(u)


def view_of(bench: PatternImager, field_px: int) -> CameraView:
    """The middle of the bench's view, with at most this many pixels."""
    return CameraView(bench.view(field_px), bench.sensor)
