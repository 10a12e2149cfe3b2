"""A small analytic renderer for the measurement tests: exact motion, texture, a camera.

It stands apart from the package's own simulation on purpose: the estimators are tested against a
field known in closed form. The field is u(x) = amplitude g(x), a Gaussian bump, whose inverse is
found by Newton's method to 1e-4 px.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import cv2
import numpy as np
import pytest

from deltact_fab.common.aliases import Array

MM_PER_PX = 0.0378
OVER = 3  # texture pixels per image pixel


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    cv2.setNumThreads(1)


@dataclass(frozen=True)
class Bump:
    """u(x) = (shear + press (x - c) / sigma) exp(-|x - c|^2 / 2 sigma^2), in px."""

    centre_px: tuple[float, float]
    sigma_px: float
    shear_px: tuple[float, float] = (0.0, 0.0)
    press_px: float = 0.0
    shift_px: tuple[float, float] = (0.0, 0.0)

    def scaled(self, s: float) -> Bump:
        return Bump(
            self.centre_px,
            self.sigma_px,
            (s * self.shear_px[0], s * self.shear_px[1]),
            s * self.press_px,
            (s * self.shift_px[0], s * self.shift_px[1]),
        )

    def parts(self, x: Array, y: Array) -> tuple[Array, ...]:
        """ux, uy and the four derivatives, at float64 points."""
        dx, dy = (x - self.centre_px[0]) / self.sigma_px, (y - self.centre_px[1]) / self.sigma_px
        g = np.exp(-0.5 * (dx * dx + dy * dy))
        p = self.press_px
        ax, ay = self.shear_px[0] + p * dx, self.shear_px[1] + p * dy
        gs = g / self.sigma_px
        return (
            ax * g + self.shift_px[0],
            ay * g + self.shift_px[1],
            (p - ax * dx) * gs,
            -ax * dy * gs,
            -ay * dx * gs,
            (p - ay * dy) * gs,
        )

    def displacement_px(self, points: Array) -> Array:
        """(..., 2) points to (..., 2) displacements."""
        ux, uy, *_ = self.parts(
            np.asarray(points[..., 0], float), np.asarray(points[..., 1], float)
        )
        return np.stack((ux, uy), axis=-1)

    def flow_px(self, height: int, width: int) -> Array:
        y, x = np.mgrid[0:height, 0:width].astype(float)
        return self.displacement_px(np.stack((x, y), -1))

    def inverse_px(self, height: int, width: int, start: Array | None = None) -> Array:
        """Material point (h, w, 2) seen at each pixel."""
        y, x = np.mgrid[0:height, 0:width].astype(float)
        sx, sy = (x.copy(), y.copy()) if start is None else (start[..., 0], start[..., 1])
        for _ in range(30):
            ux, uy, a, b, c, d = self.parts(sx, sy)
            rx, ry = sx + ux - x, sy + uy - y
            worst = max(np.abs(rx).max(), np.abs(ry).max())
            if worst < 1e-4:
                return np.stack((sx, sy), -1)
            a, d = 1 + a, 1 + d
            det = a * d - b * c
            # A full Newton step can leave the basin of attraction; 40 px cannot.
            stepx, stepy = (d * rx - b * ry) / det, (a * ry - c * rx) / det
            sx, sy = sx - np.clip(stepx, -40, 40), sy - np.clip(stepy, -40, 40)
        raise AssertionError(f"the inverse did not converge: {worst} px")


@dataclass
class Scene:
    """A texture on the skin and a camera over it. Pixel (0, 0) at rest is material (0, 0)."""

    width: int
    height: int
    patch_mm: float = 0.1
    dots: bool = False
    seed: int = 1
    noise: float = 2.0
    shading: float = 0.35
    blur_px: float = 0.6
    margin: int = 60
    contrast: float = 1.0
    rest_px: Array = field(default_factory=lambda: np.zeros((0, 2)))
    _map: Array | None = None

    def __post_init__(self) -> None:
        rng = np.random.default_rng(self.seed)
        w, h = self.width + 2 * self.margin, self.height + 2 * self.margin
        self._origin = self.margin
        pitch = self.patch_mm / MM_PER_PX * OVER
        cols = (np.arange(w * OVER) / pitch).astype(int)
        rows = (np.arange(h * OVER) / pitch).astype(int)
        patches = rng.integers(0, 256, (rows[-1] + 1, cols[-1] + 1, 3), np.uint8)
        texture = patches[rows][:, cols]
        if self.dots:
            nx = min(13, int((self.width - 40) / (2.2 / MM_PER_PX)) + 1)
            ny = min(13, int((self.height - 30) / (1.6 / MM_PER_PX)) + 1)
            gx = (np.arange(nx) - (nx - 1) / 2) * 2.2 / MM_PER_PX + (self.width - 1) / 2
            gy = (np.arange(ny) - (ny - 1) / 2) * 1.6 / MM_PER_PX + (self.height - 1) / 2
            self.rest_px = np.stack(np.meshgrid(gx, gy), -1).reshape(-1, 2)
            radius = 0.3 / MM_PER_PX * OVER
            for x, y in self.rest_px:
                # Texture pixel i has its centre at (i + 0.5) / OVER - 0.5 - margin.
                cx, cy = ((v + self._origin + 0.5) * OVER - 0.5 for v in (x, y))
                x0, y0 = int(cx - radius) - 1, int(cy - radius) - 1
                n = int(2 * radius) + 4
                yy, xx = np.mgrid[y0 : y0 + n, x0 : x0 + n]
                cover = np.clip(radius + 0.5 - np.hypot(xx - cx, yy - cy), 0, 1)[..., None]
                view = texture[y0 : y0 + n, x0 : x0 + n]
                view[:] = np.round(255 * cover + view * (1 - cover))
        # Ink spread: half a pixel of the camera.
        self.texture = cv2.GaussianBlur(texture, (0, 0), 0.4 * OVER)
        y, x = np.mgrid[0 : self.height, 0 : self.width].astype(np.float32)
        r2 = ((x / self.width - 0.45) ** 2 + (y / self.height - 0.55) ** 2) / 0.5
        self._light = (0.85 * (1 - self.shading * r2)).astype(np.float32)[..., None]

    def picture(self, bump: Bump | None = None, noise_seed: int = 0) -> Array:
        """(h, w, 3) BGR uint8 of the skin under a displacement field."""
        h, w = self.height, self.width
        if bump is None:
            y, x = np.mgrid[0:h, 0:w].astype(float)
            material = np.stack((x, y), -1)
        else:
            self._map = material = bump.inverse_px(h, w, self._map)
        # Two samples per pixel each way, then the mean: the camera integrates over its pixel.
        fine = cv2.resize(
            material.astype(np.float32), (2 * w, 2 * h), interpolation=cv2.INTER_LINEAR
        )
        points = (fine + self._origin + 0.5) * OVER - 0.5
        seen = cv2.remap(
            self.texture, points, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101
        )
        image = cv2.resize(seen, (w, h), interpolation=cv2.INTER_AREA).astype(np.float32)
        image = 127.5 + (image - 127.5) * self.contrast
        image = cv2.GaussianBlur(image, (0, 0), self.blur_px) * self._light
        if self.noise:
            rng = np.random.default_rng((self.seed, noise_seed))
            image += self.noise * rng.standard_normal(image.shape, np.float32)
        return np.clip(np.round(image), 0, 255).astype(np.uint8)


@pytest.fixture(scope="session")
def make_scene() -> Callable[..., Scene]:
    return Scene


@pytest.fixture(scope="session")
def make_bump() -> type[Bump]:
    return Bump
