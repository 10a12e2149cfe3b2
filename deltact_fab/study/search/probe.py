"""One candidate, printed and photographed once: its predictors, and its error on a known drag.

Simulated. Predictors of the image alone are `patterns.quality`'s, of the green that the default
tracker follows; the others need that tracker. Bias: a print moved as a whole by known parts of a
pixel, each photographed twice, so that what both pairs have in common, which interpolation and
aliasing make (Schreier, Braasch, Sutton, Opt. Eng. 39 (2000) 2915), can be told from noise.
Resolution: the star of the DIC Challenge 2.0.

All of it is simulated. What a pixel sees of the face depends on the motion alone, so it is solved
once a process and serves every pattern.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
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
from ...patterns.quality.figures import figures
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


FIELD_PX = 200_000
TRACKER = "fused"
EDGE_PX = 12
"""Left out at the border, where half of a matching window sees nothing."""
MAX_LOSS = 2.0
"""Times the error of short steps: beyond it a step counts as not bridged."""

Vectors = NDArray[Any]


def probe(given: dict[str, Any]) -> dict[str, Any]:
    """given: bench, recipe (plain data), seed (of print, noise and drag), field_px.

    Returns plain data by predictor's name, lengths in px but where the name says mm; `error_mm`,
    `confident_error_mm` and `coverage` of the drag there and back; `leap_error_mm` and
    `leap_coverage` of the way there in one step, `bridged_mm`, the longest step in which it is
    followed as well as in short ones. A pattern in which nothing can be tracked has `refused`,
    saying why.
    """
    cv2.setNumThreads(1)  # DIS splits the image by thread
    bench = PatternImager.from_dict(given["bench"])
    recipe = PatternRecipe.model_validate_json(json.dumps(given["recipe"]))
    view = view_of(bench, given["field_px"])
    rng = np.random.default_rng([given["seed"], 5])
    texture = view.printed(recipe, bench.printer, rng)
    picture = view.picture(texture)
    rest = [picture.expose(at_rest(view).at_px, rng) for _ in range(2)]
    found = _of_image(view, texture, rng)
    try:
        found |= _of_shifts(picture, view, rest, rng)
        found |= _of_star(picture, view, rest[0], rng)
        found |= _of_drag(picture, view, rest[0], given["seed"], rng)
    except SensorError as why:  # no texture anywhere
        return found | {"refused": str(why)}
    return found


def _of_image(view: CameraView, texture: Texture, rng: np.random.Generator) -> dict[str, Any]:
    even = replace(view.sensor, shading=0.0)  # falloff is no contrast
    image = view.picture(texture, even).expose(at_rest(view).at_px, rng)
    # Of the channel that is followed: a pattern's colours may cancel in grey, by the luck of a seed
    green = np.repeat(image[..., 1:2], 3, axis=-1)
    seen = figures(green, view.camera.mm_per_px, None, None)
    return {
        "mean_gradient": seen.mean_gradient,
        "sssig": seen.sssig,
        "contrast_0": seen.contrast[0],
        "contrast_3": seen.contrast[3],
        "contrast_4": seen.contrast[4],
        "peak": seen.peak,
    }


def flow_px(images: list[Image]) -> tuple[Vectors, NDArray[np.bool_]]:
    """The default tracker's flow (h, w, 2) of the last image, and where it is confident (h, w)."""
    tracker = named_tracker(TRACKER)
    for image in images:
        seen = tracker.update(image)
    return seen.flow_px, seen.confident


def _of_shifts(
    picture: FrameRenderer, view: CameraView, rest: list[Image], rng: np.random.Generator
) -> dict[str, Any]:
    """Mean error, its part that stays at a place, and noise, over all shifts; root mean squares."""
    offs = []
    for drawn, shift in zip(shifted(view), SHIFTS_PX, strict=True):
        pair = [flow_px([image, picture.expose(drawn.at_px, rng)])[0] for image in rest]
        inner = (slice(EDGE_PX, -EDGE_PX),) * 2
        offs.append([flow[inner].astype(np.float64) - np.array(shift) for flow in pair])
    return bias_figures(np.array(offs))


def bias_figures(offs_px: NDArray[np.float64]) -> dict[str, float]:
    """Of errors (shifts, 2 exposures, h, w, 2) px, each exposure with noise of its own.

    bias_px: of the mean over the image. local_bias_px: what two exposures have in common beside it,
    place by place. noise_px: what they have not. All are of the vector, root mean square over
    shifts.
    """
    mean = offs_px.mean(axis=(1, 2, 3), keepdims=True)
    first, second = np.moveaxis(offs_px - mean, 1, 0)
    common = float((first * second).sum(axis=-1).mean())
    apart = float(((first - second) ** 2).sum(axis=-1).mean() / 2)
    return {
        "bias_px": float(np.sqrt((mean**2).sum(axis=-1).mean())),
        "local_bias_px": float(np.sqrt(max(common, 0.0))),
        "noise_px": float(np.sqrt(apart)),
    }


def _of_star(
    picture: FrameRenderer, view: CameraView, rest: Image, rng: np.random.Generator
) -> dict[str, Any]:
    star = star_of(view)
    found = star.figures(flow_px([rest, picture.expose(starred(view).at_px, rng)])[0])
    # Finer than every period of the star: as fine as its finest one.
    loss_px = star.least_px if np.isnan(found.loss_px) else found.loss_px
    return {"resolution_px": loss_px}


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
        moving, off_mm, confident = _judged(seen, frames[OUTWARD - 1], scale)
        leaps[stride] = float(off_mm[moving].mean()), float(confident[moving].mean())
    errors = {stride: error for stride, (error, _) in leaps.items()}
    return {
        "error_mm": off.value,
        "confident_error_mm": sure.value,
        "coverage": sure.n / off.n,
        "leap_error_mm": leaps[OUTWARD][0],
        "leap_coverage": leaps[OUTWARD][1],
        "bridged_mm": STEP_MM * bridged(errors),
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
