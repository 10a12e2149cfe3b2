"""Sensors that were made badly, seen through the rig's camera chain.

Printer, lens, mosaic and noise are the product's own; what is spoiled is painted here, in the
print, in its light and in the lens.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from deltact_fab.cad.design import load_design
from deltact_fab.imaging import ImageSensor, Printer
from deltact_fab.optics import Fisheye, Pinhole, Rectified, SurfaceLattice
from deltact_fab.patterns import load_recipe
from deltact_fab.patterns.raster import albedo
from deltact_fab.virtual.picture import FrameRenderer, Geometry, Texture
from deltact_fab.virtual.raw_view import RawView

DESIGN = load_design("deltact")
LATTICE = SurfaceLattice(-20.0, -17.0, 0.5, 81, 69)
STEP_MM = Printer().mm_per_dot
Paint = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Made:
    """How one was made. paint: of (values, x_mm, y_mm) on the face; move: a 2 x 3 map of the print
    in mm; press: of each image, how deep a bump in the middle is, mm; lens: of the true lens."""

    recipe: str = "dense-with-dots"
    move: tuple[tuple[float, float, float], tuple[float, float, float]] = ((1, 0, 0), (0, 1, 0))
    paint: tuple[Paint, ...] = ()
    camera: ImageSensor = field(default_factory=ImageSensor)
    press_mm: tuple[float, ...] = ()
    lens: tuple[tuple[str, float], ...] = ()
    fisheye: bool = False
    images: int = 1
    seed: int = 0


def photographs(made: Made, n: int) -> list[np.ndarray]:
    """n images (h, w, 3) BGR as the camera gives them."""
    rng = np.random.default_rng(made.seed)
    print_ = Printer().print_(albedo(load_recipe(made.recipe), STEP_MM), rng)
    side = len(print_)
    back = np.array([[1 / STEP_MM, 0, (side - 1) / 2], [0, 1 / STEP_MM, (side - 1) / 2], [0, 0, 1]])
    moved = back @ np.vstack((made.move, [0, 0, 1])) @ np.linalg.inv(back)
    values = cv2.warpPerspective(print_, moved, (side, side), borderValue=(0.9, 0.9, 0.9))
    at = (np.arange(side) - (side - 1) / 2) * STEP_MM
    x, y = np.meshgrid(at, at)
    for paint in made.paint:
        values = paint(values, x, y).astype(np.float32)
    camera: Pinhole | RawView = Pinhole.of(DESIGN)
    if made.fisheye or made.lens:
        nominal = Fisheye.of(DESIGN)
        numbers = dict(made.lens)
        true = replace(nominal, **{k: getattr(nominal, k) + v for k, v in numbers.items()})
        camera = RawView(true, Rectified.of(DESIGN, nominal))
    draw = FrameRenderer(Geometry(camera, LATTICE), Texture(values, STEP_MM), made.camera)
    lattice_x, lattice_y = np.meshgrid(*LATTICE.axes_mm())
    bump = np.zeros((*lattice_x.shape, 3))
    bump[..., 2] = -np.exp(-(lattice_x**2 + lattice_y**2) / 18)
    images = []
    for k in range(n):
        deep = made.press_mm[k] if k < len(made.press_mm) else 0.0
        images.append(draw.render(bump * deep if deep else None, rng))
    return images


def turned(deg: float, x_mm: float = 0.0, y_mm: float = 0.0, scale: float = 1.0) -> tuple:
    c, s = scale * np.cos(np.radians(deg)), scale * np.sin(np.radians(deg))
    return ((c, -s, x_mm), (s, c, y_mm))


def bubble(x0: float, y0: float, mm: float) -> Paint:
    """Air in the gel: a lens that spreads what is behind it, with a bright spot and a dark rim."""

    def paint(values, x, y):
        r = np.hypot(x - x0, y - y0) / (mm / 2)
        # From the middle outwards less and less enlarged.
        pull = np.where(r < 1, 0.35 + 0.65 * r**2, 1.0)
        half = (len(values) - 1) / 2
        map_x = ((x0 + (x - x0) * pull) / STEP_MM + half).astype(np.float32)
        map_y = ((y0 + (y - y0) * pull) / STEP_MM + half).astype(np.float32)
        out = cv2.remap(values, map_x, map_y, cv2.INTER_LINEAR)
        rim = np.exp(-(((r - 0.92) / 0.08) ** 2))[..., None]
        spot = np.exp(-((np.hypot(x - x0 - 0.15 * mm, y - y0 + 0.15 * mm) / (0.12 * mm)) ** 2))
        return np.clip(out * (1 - 0.7 * rim) + 0.6 * spot[..., None], 0, 1)

    return paint


def lint(x0: float, y0: float, mm: float, wide_mm: float = 0.12) -> Paint:
    """A curved dark thread."""

    def paint(values, x, y):
        off = np.abs(y - y0 - 0.15 * mm * np.sin(3 * (x - x0) / mm))
        mask = np.clip((wide_mm / 2 - off) / 0.02, 0, 1) * (np.abs(x - x0) < mm / 2)
        return values * (1 - 0.85 * mask[..., None])

    return paint


def gone(where: Callable[[np.ndarray, np.ndarray], np.ndarray], colour: float) -> Paint:
    """No print where that is: white coat, black coat or frame."""
    return lambda values, x, y: np.where(where(x, y)[..., None], colour, values)


def light(of: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Paint:
    return lambda values, x, y: values * of(x, y)[..., None]


def ring_without(led: int) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Five bulbs on a circle of 9 mm, 10 mm behind the face, each falling off as cos^4."""

    def of(x, y):
        light, whole = np.zeros_like(x), np.zeros_like(x)
        for k in range(5):
            a = 2 * np.pi * k / 5
            d2 = (x - 9 * np.cos(a)) ** 2 + (y - 9 * np.sin(a)) ** 2 + 100
            whole += 1 / d2**2
            light += (k != led) / d2**2
        return light / whole.max()

    return of
