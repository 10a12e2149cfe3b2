"""Rendered examples: a good and a spoiled print, a good and a spoiled sensor."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from deltact_fab.fabricate import Design, PatternRecipe, illuminance, pattern_albedo
from deltact_fab.physics import print_colours
from deltact_fab.sensor import CAMERA_GAMMA, ImageSensor, Printer
from deltact_fab.simulate import FrameRenderer, PictureGeometry

# By hand, to make each defect visible: streak, missing share of the faded ink, bubble, torn corner.
PRINT_MM, STREAK_MM = 8.0, 0.4
FADED_SHARE = 0.75
BUBBLE_MM, BUBBLE_AT_MM = 1.2, (4.0, -3.0)
TORN_MM = 5.0


Pair = tuple[bytes, bytes]
"""Good and spoiled example, JPEG."""


def render_examples(design: Design, recipe: PatternRecipe) -> dict[str, Pair]:
    """Render a good and a spoiled print (`print`), and the face with each of them (`sensor`)."""
    printer = Printer()
    rng = np.random.default_rng(0)
    values = print_colours(printer, pattern_albedo(recipe, printer.mm_per_dot), rng)
    return {"print": _print(values, printer), "sensor": _sensor(values, printer, design)}


def _print(values: NDArray[np.float32], printer: Printer) -> Pair:
    """Cut-out of the print; the same with a clogged nozzle and magenta nearly empty."""
    half, side = round(PRINT_MM / printer.mm_per_dot / 2), len(values) // 2
    good = values[side - half : side + half, side - half : side + half]
    spoiled = good.copy()
    spoiled[..., 1] += FADED_SHARE * (1 - spoiled[..., 1])
    streak = round(STREAK_MM / printer.mm_per_dot)
    spoiled[half : half + streak] = 1
    good, spoiled = (255 * image[..., ::-1] ** (1 / CAMERA_GAMMA) for image in (good, spoiled))
    return _jpeg(good), _jpeg(spoiled)


def _sensor(values: NDArray[np.float32], printer: Printer, design: Design) -> Pair:
    """Camera view; the same with a bubble, a torn film corner and one dark LED."""
    dots_mm = (np.arange(len(values)) - (len(values) - 1) / 2) * printer.mm_per_dot
    x, y = np.meshgrid(dots_mm, dots_mm)
    right, top = np.array(design.optics.view_mm) / 2
    spoiled = values * (illuminance(design, x, y, dark=0) / illuminance(design, x, y))[..., None]
    spoiled[y - x > right + top - TORN_MM] = 1
    r = np.hypot(x - BUBBLE_AT_MM[0], y - BUBBLE_AT_MM[1]) / (BUBBLE_MM / 2)
    spoiled = np.where((r < 1)[..., None], 0.25 + 0.5 * (r < 0.4)[..., None], spoiled)
    spoiled *= np.where(np.abs(r - 1) < 0.12, 0.2, 1)[..., None]
    geometry, rng = PictureGeometry.resting(design), np.random.default_rng(0)

    def photograph(print_: NDArray[Any]) -> bytes:
        values = print_.astype(np.float32)
        draw = FrameRenderer(geometry, values, printer.mm_per_dot, ImageSensor())
        return _jpeg(draw.render(None, rng))

    return photograph(values), photograph(spoiled)


def _jpeg(bgr: NDArray[Any]) -> bytes:
    return cv2.imencode(".jpg", np.clip(bgr, 0, 255).astype(np.uint8))[1].tobytes()
