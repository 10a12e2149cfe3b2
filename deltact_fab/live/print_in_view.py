"""A recipe's print found in a camera's view of it, and drawn where it lies there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..aliases import Field, Float
from ..optics import CameraModel
from ..patterns.locate import (
    LEAST_AGREEMENT,
    LEAST_RESPONSE,
    Placement,
    Tiles,
    correlation,
    refine,
    tile_shifts,
)
from ..patterns.quality.figures import grey
from ..patterns.raster import albedo
from ..patterns.recipe import PatternRecipe

SEARCH_MM = 9.0  # side of what is compared first
ASIDE_MM = 3.0  # the sticker's middle is looked for so far off
ALIGN_PX, RIM_PX = 48, 32
ROUNDS_PX = (96, 96, 64, 64)  # sides of the tiles, from round to round
TOLERANCE_PX = 1.5
TURNS_DEG = np.arange(-7.5, 7.6, 1.5)
SCALES = ((1.0,), (0.94, 0.96, 0.98, 1.02, 1.04, 1.06))  # of the picture; tried in turn


class PrintInView:
    """The recipe's print, drawn as a camera sees it. patch_mm: of the recipe, which has patches."""

    def __init__(self, recipe: PatternRecipe, camera: CameraModel) -> None:
        assert recipe.patch_mm is not None, "accept asks"
        self.recipe, self.camera, self.patch_mm = recipe, camera, recipe.patch_mm
        scale, (x, y) = camera.mm_per_px, camera.centre_px
        self.nominal = np.array([[1 / scale, 0, x], [0, 1 / scale, y], [0, 0, 1]])
        """From the sensor's mm (x, y) to px of the view."""
        self._step_mm = scale / 2
        self._print: Float = albedo(recipe, self._step_mm)
        self._bare = recipe.model_copy(update={"dots": None})  # those look the same in all recipes

    def seen(self, to_px: Field, rim_px: int = 0) -> Float:
        """(h, w, 3) RGB in 0..1, white beyond the sticker. to_px: from its mm to the view's px.

        rim_px: so much wider on every side.
        """
        w, h = self.camera.width_px + 2 * rim_px, self.camera.height_px + 2 * rim_px
        twice = np.array([[2, 0, 0.5 + 2 * rim_px], [0, 2, 0.5 + 2 * rim_px], [0, 0, 1]])
        fine = _warped(self._print, self._step_mm, twice @ to_px, (2 * w, 2 * h))
        return np.asarray(cv2.resize(fine, (w, h), interpolation=cv2.INTER_AREA), np.float32)

    def dots(self, to_px: Field) -> NDArray[np.uint8]:
        """Where in the view (h, w) a marker dot is, or its edge."""
        w, h = self.camera.width_px, self.camera.height_px
        if self.recipe.dots is None:
            return np.zeros((h, w), np.uint8)
        off = np.abs(self._print - albedo(self._bare, self._step_mm)).max(axis=2)
        mask = cv2.dilate((off > 0.02).astype(np.float32), np.ones((9, 9), np.uint8))
        bare = np.asarray(1 - mask, np.float32)
        return (_warped(bare, self._step_mm, to_px, (w, h)) < 0.5).astype(np.uint8)

    def locate(self, view: Float) -> Placement | None:
        """The print in a view (h, w, 3); None where it is another pattern."""
        for scales in SCALES:
            guess = self._guess(view, scales)
            if guess.agreement >= LEAST_AGREEMENT:
                rounds = [partial(self._compare, luma(view), tile_px) for tile_px in ROUNDS_PX]
                to_px = refine(guess.to_px, rounds, TOLERANCE_PX)
                return None if to_px is None else replace(guess, to_px=to_px)
        return None

    def _guess(self, view: Float, scales: Sequence[float]) -> Placement:
        """The way round in which the middle of the view is most like the recipe."""
        step = min(0.1, max(self.patch_mm / 2, self.camera.mm_per_px))
        shrink = self.camera.mm_per_px / step
        small = np.asarray(
            cv2.resize(view, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA), np.float32
        )
        h, w = small.shape[:2]
        px = min(round(SEARCH_MM / step), h, w) // 2 * 2
        top, left = (h - px) // 2, (w - px) // 2
        seen = _levelled(small[top : top + px, left : left + px], step)
        coarse = _levelled(albedo(self._bare, step), step)
        # Of the window: its px are the view's, shrunk and cut.
        cut = np.array([[shrink, 0, (shrink - 1) / 2 - left],
                        [0, shrink, (shrink - 1) / 2 - top], [0, 0, 1]])  # fmt: skip
        window, reach = np.ones((px, px, 1), np.float32), min(round(ASIDE_MM / step), px // 2 - 1)
        best = Placement(view, self.nominal, 0.0)
        turns = np.add.outer((0.0, 90.0, 180.0, 270.0), TURNS_DEG).ravel()
        for scale, flip, turn_deg in product(scales, (1.0, -1.0), turns):
            way = self.nominal @ _turn(turn_deg) @ np.diag([scale * flip, scale, 1.0])
            drawn = _warped(coarse, step, cut @ way, (px, px))
            agreement, (x, y) = correlation(seen, drawn, window, reach, 2 * self.patch_mm / step)
            if agreement > best.agreement:
                moved = np.array([[1, 0, x / shrink], [0, 1, y / shrink], [0, 0, 1]])
                best = Placement(view, moved @ way, agreement)
        return best

    def _compare(self, seen: Float, tile_px: int, to_px: Field) -> Tiles:
        """A `Comparison` of a view's luma, tile by tile of the view."""
        middles, shifts, responses = tile_shifts(seen, luma(self.seen(to_px)), tile_px)
        middles = middles - 0.5
        points_mm = cv2.perspectiveTransform(middles[None], np.linalg.inv(to_px))[0]
        return points_mm, middles + shifts, responses


def _warped(image: Float, step_mm: float, to_px: Field, size: tuple[int, int]) -> Float:
    """A print of step_mm, its middle at 0, through a map from mm to px; beyond it white."""
    middle = [(1 - n) * step_mm / 2 for n in image.shape[1::-1]]
    grid = np.array([[step_mm, 0, middle[0]], [0, step_mm, middle[1]], [0, 0, 1]])
    return np.asarray(cv2.warpPerspective(image, to_px @ grid, size, flags=cv2.INTER_LINEAR,
                                          borderValue=(1, 1, 1)), np.float32)  # fmt: skip


def _turn(deg: float) -> Field:
    c, s = math.cos(math.radians(deg)), math.sin(math.radians(deg))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def _levelled(image: Float, step_mm: float) -> Float:
    """Without what light does to it over more than a millimetre."""
    return np.asarray(image - cv2.GaussianBlur(image, (0, 0), 1.0 / step_mm), np.float32)


def luma(image: Float) -> Float:
    """Of an RGB picture (h, w, 3), float32."""
    return np.asarray(grey(image), np.float32)


def aligned(seen: Float, wide: Float) -> Float:
    """What is drawn wide, RIM_PX on every side, each part of it where it lies in what is seen.

    What a homography leaves of a lens is smooth.
    """
    h, w = seen.shape
    drawn = wide[RIM_PX:-RIM_PX, RIM_PX:-RIM_PX]
    x, y = np.meshgrid(np.arange(w), np.arange(h))
    everywhere = _quartic(x.ravel() + 0.5, y.ravel() + 0.5, w, h)
    moved = np.zeros((h, w, 2))
    corners = (0, 0), (h % ALIGN_PX, w % ALIGN_PX)  # tiles from both ends: the rim counts too
    for _ in range(2):
        parts = [tile_shifts(seen[i:, j:], drawn[i:, j:], ALIGN_PX) for i, j in corners]
        at = np.concatenate([p[0] + (j, i) for p, (i, j) in zip(parts, corners, strict=True)])
        off, response = (np.concatenate([p[k] for p in parts]) for k in (1, 2))
        good = response > LEAST_RESPONSE
        for _ in range(3):
            fitted = np.linalg.pinv(_quartic(at[good, 0], at[good, 1], w, h)) @ off[good]
            left = np.hypot(*(off - _quartic(at[:, 0], at[:, 1], w, h) @ fitted).T)
            good = (response > LEAST_RESPONSE) & (left < max(0.5, 3 * float(np.median(left[good]))))
        moved += (everywhere @ fitted).reshape(h, w, 2)
        at_x, at_y = (
            (one - moved[..., k] + RIM_PX).astype(np.float32) for k, one in enumerate((x, y))
        )
        drawn = np.asarray(cv2.remap(wide, at_x, at_y, cv2.INTER_LINEAR), np.float32)
    return drawn


def _quartic(x_px: NDArray[Any], y_px: NDArray[Any], w: int, h: int) -> Field:
    """The monomials up to the fourth degree, (n, 15)."""
    x, y = 2 * x_px / w - 1, 2 * y_px / h - 1
    return np.stack([x**i * y**j for i in range(5) for j in range(5 - i)], axis=-1)
