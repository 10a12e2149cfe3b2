"""Faces whose parts, density and landing are known in closed form: the measurement's references."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from ...aliases import Array
from ...measure.face import FaceFlow
from ...measure.force import SensorView
from ...measure.shape.density import SIGMA_PX
from ...optics import Pinhole, axes_mm
from ...shapes.sensor import SensorDimensions

SENSOR = SensorDimensions()
CAMERA = Pinhole.of(SENSOR)
VIEW = SensorView(CAMERA, SENSOR.skin)
MM_PER_PX = CAMERA.mm_per_px


@cache
def _pixels() -> tuple[Array, Array]:
    x, y = axes_mm(CAMERA)
    return x[None], y[:, None]


def face(shift_mm: Array, every: int) -> FaceFlow:
    """A shift (h, w, 2) at every pixel of the camera, as a tracker's would be handed on."""
    x, y = axes_mm(CAMERA)
    w, h = len(x) // every, len(y) // every
    x, y = (axis[: n * every].reshape(n, every).mean(1) for axis, n in ((x, w), (y, h)))
    shift = means(shift_mm, every).astype(np.float32)
    return FaceFlow(shift, np.ones((h, w), bool), x, y)


def means(values: Array, every: int) -> Array:
    """Over every x every pixels."""
    h, w = (side // every for side in values.shape[:2])
    cells = values[: h * every, : w * every].reshape(h, every, w, every, *values.shape[2:])
    return np.asarray(cells.mean(axis=(1, 3)))


def _slope(x0: float, y0: float, sigma_mm: float) -> Array:
    """Minus the gradient of a Gaussian, times sigma: .6 at most."""
    x, y = _pixels()
    bump = np.exp(-((x - x0) ** 2 + (y - y0) ** 2) / (2 * sigma_mm**2))
    return np.stack(((x - x0) / sigma_mm * bump, (y - y0) / sigma_mm * bump), axis=-1)


@dataclass(frozen=True)
class Parts:
    """Three fields (h, w, 2) at every pixel, mm, that the decomposition should find apart."""

    d: Array
    r: Array
    h: Array


@cache
def parts(sigma_mm: float) -> Parts:
    """Something that spreads, something that turns, and a shift with a saddle.

    The first two end inside the view (4e-4 of their most is left at the nearest edge at 2 mm).
    """
    x, y = _pixels()
    one = np.ones(np.broadcast_shapes(x.shape, y.shape))
    turned = _slope(-4.0, 1.0, sigma_mm)
    return Parts(
        _slope(3.0, -1.0, sigma_mm),
        np.stack((-turned[..., 1], turned[..., 0]), axis=-1),
        np.stack((0.3 + 0.01 * x * one, -0.2 - 0.01 * y * one), axis=-1),
    )


def dent(push: float, sigma_mm: float = 2.0) -> Array:
    """A spread (h, w, 2) at every pixel, mm, whose determinant at the middle is (1 + push)^2.

    Below push = -1 the map folds.
    """
    return push * sigma_mm * _slope(0.0, 0.0, sigma_mm)


def dent_density(push: float, sigma_mm: float = 2.0) -> Array:
    """1 / det(I + grad u) of `dent` under a Gaussian of SIGMA_PX, (h, w), in closed form."""
    wide2 = sigma_mm**2 + (SIGMA_PX * MM_PER_PX) ** 2  # a Gaussian of a Gaussian is one again
    x, y = _pixels()
    rho2 = x**2 + y**2
    gain = push * (sigma_mm**2 / wide2) ** 2 * np.exp(-rho2 / (2 * wide2))
    return np.asarray(1 / ((1 + gain) * (1 + gain * (1 - rho2 / wide2))))
