"""A good and a spoiled print, a good and a spoiled sensor, as a lab sees them: rendered."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..aliases import Float
from ..cad.check.electric import lit
from ..cad.dimensions import Design
from ..imaging import GAMMA, ImageSensor, Printer
from ..optics import Pinhole, SurfaceLattice
from ..patterns.raster import albedo
from ..patterns.recipe import PatternRecipe
from ..virtual.picture import FrameRenderer, Geometry, Texture

PRINT_MM, STREAK_MM = 8.0, 0.4
FAINT = 0.75  # of the ink that is nearly empty, what is missing
BUBBLE_MM, BUBBLE_AT_MM = 1.2, (4.0, -3.0)
TORN_MM = 5.0


@dataclass(frozen=True)
class Pair:
    """Two pictures as data URLs."""

    good: str
    spoiled: str


def pairs(design: Design, recipe: PatternRecipe) -> dict[str, Pair]:
    """Of the print (`print`) and of the face through the sensor's camera (`sensor`)."""
    printer = Printer()
    rng = np.random.default_rng(0)
    values = printer.print_(albedo(recipe, printer.mm_per_dot), rng)
    return {"print": _print(values, printer), "sensor": _sensor(values, printer, design)}


def _print(values: Float, printer: Printer) -> Pair:
    """A cut of it; then with a clogged nozzle and magenta nearly empty."""
    half, side = round(PRINT_MM / printer.mm_per_dot / 2), len(values) // 2
    good = values[side - half : side + half, side - half : side + half]
    spoiled = good.copy()
    spoiled[..., 1] += FAINT * (1 - spoiled[..., 1])
    streak = round(STREAK_MM / printer.mm_per_dot)
    spoiled[half : half + streak] = 1
    return Pair(*(_url(255 * one[..., ::-1] ** (1 / GAMMA)) for one in (good, spoiled)))


def _sensor(values: Float, printer: Printer, design: Design) -> Pair:
    """The view; then with a bubble, the film torn at a corner and one LED dark."""
    camera = Pinhole.of(design)
    at = (np.arange(len(values)) - (len(values) - 1) / 2) * printer.mm_per_dot
    x, y = np.meshgrid(at, at)
    right, top = np.array(design.optics.view_mm) / 2
    spoiled = values * (lit(design, x, y, dark=0) / lit(design, x, y))[..., None]
    spoiled[y - x > right + top - TORN_MM] = 1
    r = np.hypot(x - BUBBLE_AT_MM[0], y - BUBBLE_AT_MM[1]) / (BUBBLE_MM / 2)
    spoiled = np.where((r < 1)[..., None], 0.25 + 0.5 * (r < 0.4)[..., None], spoiled)
    spoiled *= np.where(np.abs(r - 1) < 0.12, 0.2, 1)[..., None]
    x_mm, y_mm = np.array(design.optics.view_mm) / 2 + 4
    lattice = SurfaceLattice(-x_mm, -y_mm, 1.0, int(2 * x_mm) + 1, int(2 * y_mm) + 1)
    geometry, rng = Geometry(camera, lattice), np.random.default_rng(0)
    seen = []
    for print_ in (values, spoiled):
        texture = Texture(print_.astype(np.float32), printer.mm_per_dot)
        seen.append(_url(FrameRenderer(geometry, texture, ImageSensor()).render(None, rng)))
    return Pair(*seen)


def _url(bgr: NDArray[Any]) -> str:
    done = cv2.imencode(".jpg", np.clip(bgr, 0, 255).astype(np.uint8))[1]
    return f"data:image/jpeg;base64,{base64.b64encode(done.tobytes()).decode()}"
