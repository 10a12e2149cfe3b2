"""Pictures of a sensor that nothing of the product drew: rays traced with Snell's law of vectors.

It shares with the package the colours of a recipe's patches and nothing else: the lens is a law
written here or by the test, the light refracts at each plane, and what a USB camera does to the
picture (blur that grows outward, mosaic, sharpening, sRGB, JPEG by Pillow) is this file's own.
Frame and units as everywhere: mm, z out of the sensor, image x = +x, image y = +y.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

Field = NDArray[np.float64]
Law = Callable[[Field], Field]

LAWS: dict[str, Law] = {
    "equidistant": lambda t: t,
    "equisolid": lambda t: 2 * np.sin(t / 2),
    "stereographic": lambda t: 2 * np.tan(t / 2),
    "seventh order +": lambda t: t + 0.005 * t**7,
    "seventh order -": lambda t: t - 0.005 * t**7,
    "seventh and ninth": lambda t: t - 0.01 * t**7 + 0.006 * t**9,
}
"""Radius in focal lengths of the angle to the axis, rad."""


@dataclass(frozen=True)
class Lens:
    """A lens above air, plate and gel.

    law: of the radius. p1, p2: decentring (Brown's, in focal lengths). aspect: a pixel's height
    over its width. shift_mm: of the pupil, back along the axis, at an angle.
    layers: (thickness in mm, index) from the pupil to the face.
    """

    f_px: float = 388.0
    law: Law = LAWS["equidistant"]
    centre_px: tuple[float, float] = (639.5, 359.5)
    size_px: tuple[int, int] = (1280, 720)
    p1: float = 0.0
    p2: float = 0.0
    aspect: float = 1.0
    shift_mm: Law | None = None
    layers: tuple[tuple[float, float], ...] = ((3.0, 1.0), (2.0, 1.49), (12.0, 1.41))

    def image_px(self, direction: Field) -> Field:
        """Where rays (..., 3) that leave the scene for the pupil meet the image."""
        x, y, z = np.moveaxis(direction, -1, 0)
        across = np.hypot(x, y)
        radius = self.law(np.arctan2(across, z))
        gain = radius / np.maximum(across, 1e-300)
        u, v = x * gain, y * gain
        r2 = u * u + v * v
        du = 2 * self.p1 * u * v + self.p2 * (r2 + 2 * u * u)
        dv = self.p1 * (r2 + 2 * v * v) + 2 * self.p2 * u * v
        cx, cy = self.centre_px
        return np.stack((cx + self.f_px * (u + du), cy + self.f_px * self.aspect * (v + dv)), -1)

    def project_px(self, xyz_mm: Field, beyond: float | None = None) -> Field:
        """Points (..., 3) to pixels: in the gel that moved there, or in what is beyond the face.

        beyond: its index (1.0 for a board in air). The angle in air is bisected.
        """
        (gap, _), *plates = self.layers
        offset = xyz_mm[..., :2]
        reach = np.linalg.norm(offset, axis=-1)
        z = xyz_mm[..., 2]
        layers = (
            [*plates, (z, beyond)] if beyond else [*plates[:-1], (z + plates[-1][0], plates[-1][1])]
        )
        low, high = np.zeros_like(reach), np.full_like(reach, np.pi / 2 - 1e-9)
        for _ in range(52):
            angle = (low + high) / 2
            shift = self.shift_mm(angle) if self.shift_mm else 0.0
            got = (gap + shift) * np.tan(angle)
            for thickness, index in layers:
                got = got + thickness * np.tan(np.arcsin(np.sin(angle) / index))
            low, high = np.where(got < reach, angle, low), np.where(got < reach, high, angle)
        way = offset / np.maximum(reach, 1e-300)[..., None]
        return self.image_px(
            np.concatenate((way * np.sin(angle)[..., None], np.cos(angle)[..., None]), -1)
        )

    def rays(self, px: Field) -> tuple[Field, Field]:
        """Points on the resting face and slopes in the gel, (..., 2) each, of pixels (..., 2)."""
        table = np.linspace(0, 1.5, 30001)
        radii = self.law(table)
        rises = int(np.argmax(np.diff(radii, append=-1) <= 0)) + 1
        goal = (px - self.centre_px) / (self.f_px * np.array((1, self.aspect)))
        at = goal.copy()
        for _ in range(20 if self.p1 or self.p2 else 0):
            u, v = at[..., 0], at[..., 1]
            r2 = u * u + v * v
            at = goal - np.stack(
                (
                    2 * self.p1 * u * v + self.p2 * (r2 + 2 * u * u),
                    self.p1 * (r2 + 2 * v * v) + 2 * self.p2 * u * v,
                ),
                -1,
            )
        radius = np.linalg.norm(at, axis=-1)
        angle = np.interp(radius, radii[:rises], table[:rises], right=np.nan)
        way = at / np.maximum(radius, 1e-300)[..., None]
        d = np.concatenate((way * np.sin(angle)[..., None], np.cos(angle)[..., None]), -1)
        reached, index = np.zeros_like(px), 1.0
        for k, (thickness, n) in enumerate(self.layers):
            # Snell for vectors at a plane normal to z: the part along the plane is scaled.
            flat = d[..., :2] * (index / n)
            with np.errstate(invalid="ignore"):
                d = np.concatenate((flat, np.sqrt(1 - np.sum(flat**2, -1, keepdims=True))), -1)
            shift = self.shift_mm(angle)[..., None] if k == 0 and self.shift_mm else 0.0
            reached, index = reached + d[..., :2] / d[..., 2:] * (thickness + shift), n
        return reached, d[..., :2] / d[..., 2:]


@dataclass(frozen=True)
class Motion:
    """Of the face: a dent with a bulge around it, a drag and a twist, each of a Gaussian reach."""

    press_mm: float = 0.0
    drag_mm: tuple[float, float] = (0.0, 0.0)
    twist_rad: float = 0.0
    at_mm: tuple[float, float] = (0.0, 0.0)
    dent_mm: float = 2.6
    reach_mm: float = 5.0

    def share(self, part: float) -> Motion:
        """The same, that far on its way."""
        return replace(
            self, press_mm=self.press_mm * part, twist_rad=self.twist_rad * part,
            drag_mm=(self.drag_mm[0] * part, self.drag_mm[1] * part),
        )  # fmt: skip

    def __call__(self, xy_mm: Field) -> Field:
        """Displacement (..., 3) of material points (..., 2)."""
        off = xy_mm - self.at_mm
        r2 = np.sum(off**2, -1, keepdims=True)
        dent, wide = np.exp(-r2 / (2 * self.dent_mm**2)), np.exp(-r2 / (2 * self.reach_mm**2))
        c, s = np.cos(self.twist_rad * wide) - 1, np.sin(self.twist_rad * wide)
        turned = c * off + s * np.stack((-off[..., 1], off[..., 0]), -1)
        bulge = 0.12 * self.press_mm / self.dent_mm * dent * off
        flat = bulge + turned + np.asarray(self.drag_mm) * wide
        return np.concatenate((flat, -self.press_mm * dent), -1)


def true_motion_mm(lens: Lens, motion: Motion, xy_mm: Field) -> Field:
    """Projected displacement (..., 2) of material points (..., 2), on the resting face, mm.

    Where the pixel that sees the moved point looks at rest, less where the point was.
    """
    moved = np.concatenate((xy_mm, np.zeros_like(xy_mm[..., :1])), -1) + motion(xy_mm)
    return lens.rays(lens.project_px(moved))[0] - xy_mm


@dataclass(frozen=True)
class Imaging:
    """What the camera does; edge_to_centre: of the LED light (1 is even), side: from one side.

    demosaic: a cv2 code's name. jpeg: quality of one with halved colours (4:2:0), or 0 for none.
    exposure: of the light, 1 for a bright picture.
    """

    edge_to_centre: float = 1.3
    side: float = 0.0
    blur_px: tuple[float, float] = (0.6, 1.1)
    demosaic: str = "COLOR_BayerRG2BGR_VNG"
    sharpening: float = 0.5
    noise: float = 0.006
    jpeg: int = 85
    exposure: float = 1.0

    def develop(self, light: Field, rng: np.random.Generator) -> NDArray[np.uint8]:
        """Linear RGB (h, w, 3) of 0 to 1 to the BGR image that a program gets."""
        h, w = light.shape[:2]
        y, x = np.mgrid[-1 : 1 : h * 1j, -1 : 1 : w * 1j]
        r2 = ((x * x + y * y) / 2)[..., None]
        glow = (1 + (self.edge_to_centre - 1) * r2) * (1 + self.side * x[..., None])
        light = light.astype(np.float32) * (0.75 * self.exposure * glow / glow.max()).astype(
            np.float32
        )
        inner, outer = (cv2.GaussianBlur(light, (0, 0), s) for s in self.blur_px)
        light = inner + (outer - inner) * r2.astype(np.float32)
        raw = np.empty((h, w), np.float32)
        for row, column, ink in ((0, 0, 2), (0, 1, 1), (1, 0, 1), (1, 1, 0)):
            raw[row::2, column::2] = light[row::2, column::2, ink]
        eight = self._coded(raw, rng)
        bgr = cv2.cvtColor(eight, getattr(cv2, self.demosaic)).astype(np.float32)
        bgr += self.sharpening * (bgr - cv2.GaussianBlur(bgr, (0, 0), 1.0))
        image = np.clip(np.rint(bgr), 0, 255).astype(np.uint8)
        if not self.jpeg:
            return image
        packed = io.BytesIO()
        Image.fromarray(image[..., ::-1]).save(packed, "JPEG", quality=self.jpeg, subsampling=2)
        return np.ascontiguousarray(np.asarray(Image.open(packed))[..., ::-1])

    def _coded(self, light: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.uint8]:
        noise = self.noise * np.sqrt(np.maximum(light, 0) + 0.01)
        light = np.clip(light + noise * rng.standard_normal(light.shape, dtype=np.float32), 0, 1)
        srgb = np.where(light < 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
        return np.rint(255 * srgb).astype(np.uint8)


class Tracer:
    """Pictures of a printed sheet of patches under a lens.

    patches: (n, n, 3) uint8 RGB, row 0, column 0 at (-x, -y). Ink spreads by spread_mm (standard
    deviation); beyond the sheet is clear, and lit grey.
    """

    FINER = 6  # texels a patch
    RAYS = 3  # along a pixel's side

    def __init__(
        self, patches: NDArray[np.uint8], side_mm: float, lens: Lens, spread_mm: float = 0.012
    ) -> None:
        self.lens, self._side_mm = lens, side_mm
        n = len(patches)
        finer = self.FINER if n > 100 else 40
        linear = (patches / 255.0).astype(np.float32) ** 2.2
        sheet = np.repeat(np.repeat(linear, finer, 0), finer, 1)
        self._texel_mm = side_mm / (n * finer)
        self._sheet = cv2.GaussianBlur(sheet, (0, 0), spread_mm / self._texel_mm)

    @cached_property
    def _rays(self) -> tuple[Field, Field]:
        w, h = self.lens.size_px
        x, y = np.meshgrid(np.arange(-1.0, w + 1), np.arange(-1.0, h + 1))
        return self.lens.rays(np.stack((x, y), -1))

    def light(self, motion: Motion | None = None) -> Field:
        """Linear RGB (h, w, 3) of the picture of the moved face, before the camera's own part."""
        rest, slope = self._rays
        at = np.nan_to_num(rest, nan=1e3)
        inside = np.all(np.abs(at) < self._side_mm, -1)
        if motion is not None:
            there, goal, along = at[inside], at[inside], slope[inside]
            for _ in range(200):
                u = motion(there)
                before, there = there, goal + along * u[:, 2:] - u[:, :2]
                if np.max(np.abs(there - before)) < 1e-6:
                    break
            else:
                raise AssertionError("the face folds: no one point for each ray")
            at = at.copy()
            at[inside] = there
        w, h = self.lens.size_px
        total = np.zeros((h, w, 3), np.float32)
        steps = (np.arange(self.RAYS) + 0.5) / self.RAYS - 0.5
        for dy in steps:
            for dx in steps:
                texel = (_moved(at, dx, dy) + self._side_mm / 2) / self._texel_mm - 0.5
                column, row = cv2.split(texel.astype(np.float32))
                total += cv2.remap(
                    self._sheet, column, row, cv2.INTER_LINEAR,
                    borderMode=cv2.BORDER_CONSTANT, borderValue=(0.4, 0.4, 0.4),
                )  # fmt: skip
        return total / self.RAYS**2


def _moved(grid: Field, dx: float, dy: float) -> Field:
    """A grid (h + 2, w + 2, 2) at its inner nodes moved by a share of a node, linearly."""
    rows = grid[1:-1] + abs(dy) * (grid[2:] if dy > 0 else grid[:-2]) - abs(dy) * grid[1:-1]
    ahead = rows[:, 2:] if dx > 0 else rows[:, :-2]
    return rows[:, 1:-1] + abs(dx) * (ahead - rows[:, 1:-1])


def chessboard(squares: int) -> NDArray[np.uint8]:
    """Patches (n, n, 3) of a chessboard whose first square, at (-x, -y), is dark."""
    light = (np.add.outer(np.arange(squares), np.arange(squares)) % 2).astype(np.uint8)
    board = light * np.uint8(215) + np.uint8(25)
    return np.repeat(board[..., None], 3, -1)
