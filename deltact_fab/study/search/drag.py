"""One candidate, printed and photographed once, and its tracking error on a known drag.

Simulated. What a pixel sees of the face depends on the motion alone, so it is solved once a process
and serves every pattern.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ...aliases import Field, Float, Image
from ...analysis.tracking_error.tally import MOVING_MM, Mean
from ...errors import SensorError
from ...imaging import ImageSensor, Printer
from ...measure.flow import FlowObservation, named_tracker
from ...optics import Pinhole, SurfaceLattice, axes_mm
from ...patterns.raster import albedo
from ...patterns.recipe import PatternRecipe
from ...virtual.picture import MARGIN_PX, FrameRenderer, Geometry, Texture
from .imager import PatternImager

BEYOND_MM = 1.0
"""Printed around what moves into the view: spread and misplaced ink come from there too."""
LATTICE_MM = 0.3

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

    def picture(self, texture: Texture) -> FrameRenderer:
        """What draws a print."""
        return FrameRenderer(geometry(self), texture, self.sensor)


def lattice(camera: Pinhole) -> SurfaceLattice:
    """Nodes over the view and its margin."""
    x_mm, y_mm = axes_mm(camera, MARGIN_PX + 1)
    nx, ny = (int(np.ceil((a[-1] - a[0]) / LATTICE_MM)) + 1 for a in (x_mm, y_mm))
    return SurfaceLattice(float(x_mm[0]), float(y_mm[0]), LATTICE_MM, nx, ny)


@lru_cache(maxsize=2)
def geometry(view: CameraView) -> Geometry:
    """Of displacements on the lattice."""
    return Geometry(view.camera, lattice(view.camera))


def _drawn(view: CameraView, fields_mm: Sequence[Field]) -> list[FaceSampling]:
    seen = geometry(view)
    inner = slice(MARGIN_PX, -MARGIN_PX)
    return [
        FaceSampling(seen.material_px(u), np.ascontiguousarray(seen.forward_px(u)[inner, inner]))
        for u in fields_mm
    ]


def _grid(view: CameraView) -> tuple[Field, Field]:
    return np.meshgrid(*lattice(view.camera).axes_mm())


@lru_cache(maxsize=2)
def at_rest(view: CameraView) -> FaceSampling:
    """No motion."""
    x, _ = _grid(view)
    return _drawn(view, [np.zeros((*x.shape, 3))])[0]


@lru_cache(maxsize=2)
def dragged(view: CameraView, seed: int) -> list[FaceSampling]:
    """Frames of a press that is dragged and goes back, with waves on the skin.

    In steps of STEP_MM; the first half and one more, OUTWARD, lead to the largest motion.
    """
    rng = np.random.default_rng([seed, 22])
    x, y = _grid(view)
    whole = drag_mm(x, y, rng)
    whole *= DRAG_MM / np.hypot(whole[..., 0], whole[..., 1]).max()
    shares = [k / OUTWARD for k in (*range(1, OUTWARD + 1), *range(OUTWARD - 1, 0, -1))]
    return _drawn(view, [whole * share for share in shares])


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


FIELD_PX = 200_000
TRACKER = "fused"
MAX_LOSS = 2.0
"""Times the error of short steps: beyond it a step counts as not bridged."""

Vectors = NDArray[Any]


def probe(given: dict[str, Any]) -> dict[str, Any]:
    """given: bench, recipe (plain data), seed (of print, noise and drag), field_px.

    Returns plain data: `error_mm` and `coverage` of the drag there and back, and `bridged_mm`, the
    longest step in which it is followed as well as in short ones. A pattern in which nothing can be
    tracked has `refused`, saying why.
    """
    cv2.setNumThreads(1)  # DIS splits the image by thread
    bench = PatternImager.from_dict(given["bench"])
    recipe = PatternRecipe.model_validate_json(json.dumps(given["recipe"]))
    view = view_of(bench, given["field_px"])
    rng = np.random.default_rng([given["seed"], 5])
    picture = view.picture(view.printed(recipe, bench.printer, rng))
    rest = picture.expose(at_rest(view).at_px, rng)
    try:
        return _of_drag(picture, view, rest, given["seed"], rng)
    except SensorError as why:  # no texture anywhere
        return {"refused": str(why)}


def _of_drag(
    picture: FrameRenderer, view: CameraView, rest: Image, seed: int, rng: np.random.Generator
) -> dict[str, Any]:
    """The drag there and back, and the way there in ever fewer frames."""
    frames = dragged(view, seed)
    images = [picture.expose(drawn.at_px, rng) for drawn in frames]
    scale = view.camera.mm_per_px
    tracker = named_tracker(TRACKER)
    tracker.update(rest)
    off, sure = Mean(), Mean()
    for image, drawn in zip(images, frames, strict=True):
        moving, off_mm, confident = _judged(tracker.update(image), drawn, scale)
        off.take(off_mm[moving])
        sure.take(off_mm[moving & confident])
    leaps = {}
    for stride in strides(OUTWARD):
        tracker = named_tracker(TRACKER)
        tracker.update(rest)
        for image in images[stride - 1 : OUTWARD : stride]:
            seen = tracker.update(image)
        moving, off_mm, _ = _judged(seen, frames[OUTWARD - 1], scale)
        leaps[stride] = float(off_mm[moving].mean())
    return {
        "error_mm": off.value,
        "coverage": sure.n / off.n,
        "bridged_mm": STEP_MM * bridged(leaps),
    }


def _judged(
    seen: FlowObservation, drawn: FaceSampling, mm_per_px: float
) -> tuple[NDArray[np.bool_], Vectors, NDArray[np.bool_]]:
    """Which pixels (h, w) move, the error (h, w) mm, and where the tracker is confident."""
    off_mm = np.hypot(*np.moveaxis(seen.flow_px - drawn.truth_px, -1, 0)) * mm_per_px
    return moving_px(drawn.truth_px, mm_per_px), off_mm, seen.confident


def strides(n: int) -> list[int]:
    """Frames a step, so that every way ends at the last one of n."""
    return [stride for stride in range(1, n + 1) if n % stride == 0]


def bridged(errors: dict[int, float]) -> int:
    """The longest stride up to which the error stays within MAX_LOSS of that at stride 1."""
    longest = 1
    for stride in sorted(errors):
        if errors[stride] > MAX_LOSS * errors[1]:
            break
        longest = stride
    return longest


def moving_px(truth_px: Vectors, mm_per_px: float) -> NDArray[np.bool_]:
    """Pixels (h, w) that move by MOVING_MM or more and stay in view."""
    h, w = truth_px.shape[:2]
    x, y = np.arange(w) + truth_px[..., 0], np.arange(h)[:, None] + truth_px[..., 1]
    seen = (x >= 0) & (x <= w - 1) & (y >= 0) & (y <= h - 1)
    return np.asarray(
        seen & (np.hypot(truth_px[..., 0], truth_px[..., 1]) * mm_per_px >= MOVING_MM)
    )
