"""One candidate, printed and photographed once, and its tracking error on a known drag.

Simulated. What a pixel sees of the face depends on the motion alone, so it is solved once a process
and serves every pattern.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np

from ..aliases import Field, Float, Image
from ..analysis.tracking_error.follow import Follower, TrackingPlan
from ..analysis.tracking_error.tally import Marks, TrueFrame, seen_by
from ..catalog import validate
from ..errors import SensorError
from ..experiment.session import pattern_of
from ..optics import Pinhole, SeenFace, SurfaceLattice, axes_mm
from ..patterns.recipe import recipe_from
from ..rig.config import VirtualConfig
from ..shapes import SensorDimensions
from ..virtual.drawing import noise_of, printed
from ..virtual.picture import MARGIN_PX, Geometry

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
FIELD_PX = 200_000
"""Pixels of the middle of the view, which is what is drawn."""
TRACKER = "fused"
MAX_LOSS = 2.0
"""Times the error of short steps: beyond it a step counts as not bridged."""


class DragFrame(NamedTuple):
    """What pixels see of the face (h + 2, w + 2, 2), px, and what is true of them."""

    at_px: Float
    truth: TrueFrame


def view_of(sensor: SensorDimensions) -> Pinhole:
    """The middle of the sensor's view, with at most FIELD_PX pixels, even ones for the mosaic."""
    whole = Pinhole.of(sensor)
    part = min(1.0, (FIELD_PX / (whole.width_px * whole.height_px)) ** 0.5)
    width_px, height_px = (2 * int(part * n / 2) for n in (whole.width_px, whole.height_px))
    return replace(whole, width_px=width_px, height_px=height_px)


@lru_cache(maxsize=2)
def geometry(view: Pinhole) -> tuple[Geometry, SurfaceLattice]:
    """What draws displacements on a lattice over the view and its margin."""
    x_mm, y_mm = axes_mm(view, MARGIN_PX + 1)
    nx, ny = (int(np.ceil((a[-1] - a[0]) / LATTICE_MM)) + 1 for a in (x_mm, y_mm))
    lattice = SurfaceLattice(float(x_mm[0]), float(y_mm[0]), LATTICE_MM, nx, ny)
    return Geometry(view, lattice), lattice


@lru_cache(maxsize=2)
def dragged(view: Pinhole, seed: int) -> list[DragFrame]:
    """Frames of a press that is dragged away, with waves on the skin, in steps of STEP_MM."""
    drawing, lattice = geometry(view)
    seen, in_view = SeenFace(view, lattice), seen_by(view)
    whole = drag_mm(*np.meshgrid(*lattice.axes_mm()), np.random.default_rng([seed, 22]))
    whole *= DRAG_MM / np.hypot(whole[..., 0], whole[..., 1]).max()
    return [
        DragFrame(
            drawing.material_px(u_mm),
            TrueFrame.of(*seen.both(u_mm), in_view, view.mm_per_px),
        )
        for u_mm in (whole * (k / OUTWARD) for k in range(1, OUTWARD + 1))
    ]


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


def probe(given: dict[str, Any]) -> dict[str, Any]:
    """given: rig, sensor, recipe (plain data), seed (of print, noise and drag).

    Returns `error_mm` and `coverage` of the drag there and back, and `bridged_mm`, the longest step
    in which it is followed as well as in short ones. A pattern in which nothing can be tracked has
    `refused`, saying why.
    """
    cv2.setNumThreads(1)  # DIS splits the image by thread
    config = validate(VirtualConfig, given["rig"], "rig")
    recipe, seed = recipe_from(given["recipe"], "recipe"), given["seed"]
    view = view_of(validate(SensorDimensions, given["sensor"], "sensor"))
    marks, drawing = Marks.of(view, pattern_of(recipe)), geometry(view)[0]
    picture, noise = printed(config.virtual, recipe, drawing, seed), noise_of(seed, 0)
    there = dragged(view, seed)
    rest = picture.expose(drawing.material_px(None), noise)
    truths = [frame.truth for frame in (*there, *there[-2::-1])]
    images = [picture.expose(frame.at_px, noise) for frame in (*there, *there[-2::-1])]
    try:
        whole = _followed(marks, rest, images, truths)[0]
        last_mm = {
            stride: _followed(marks, rest, images[stride - 1 : OUTWARD : stride],
                              truths[stride - 1 : OUTWARD : stride])[1]
            for stride in strides(OUTWARD)
        }  # fmt: skip
    except SensorError as why:  # no texture anywhere
        return {"refused": str(why)}
    return {
        "error_mm": whole["mean_off_dots_mm"],
        "coverage": whole["coverage"],
        "bridged_mm": STEP_MM * bridged(last_mm),
    }


def _followed(
    marks: Marks, rest: Image, images: Sequence[Image], truths: Sequence[TrueFrame]
) -> tuple[dict[str, Any], float]:
    """Figures of all frames, and the mean error of the last one, mm."""
    follower = Follower(TrackingPlan((TRACKER,), False, ()), marks)
    follower.take(rest, None)
    said = [follower.take(*frame) for frame in zip(images, truths, strict=True)]
    return follower.tallies[TRACKER].figures(), said[-1][TRACKER]["mean_off_dots_mm"]


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
