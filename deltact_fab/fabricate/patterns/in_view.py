"""Locate a recipe's print in a camera's view, render it there, and compare the two."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Array, Field, Image, Point, Point2
from deltact_fab.sensor import CAMERA_GAMMA, CameraModel, SkinDimensions

from .locate import (
    MIN_AGREEMENT,
    MIN_RESPONSE,
    Placement,
    TileShifts,
    correlation,
    refine,
    tile_shifts,
)
from .quality.figures import grey_levels
from .raster import pattern_albedo
from .recipe import PatternRecipe

# Search range of decision 0071: turn by up to 7.5 degrees, scale by up to 6 %, the middle off by
# LAG_MM; by hand: a wider one takes longer and finds more false matches.
VIEW_SEARCH_MM, LAG_MM = 9.0, 3.0  # side of the compared middle, largest offset
TURNS_DEG = np.arange(-7.5, 7.6, 1.5)
TRIED_SCALES = ((1.0,), (0.94, 0.96, 0.98, 1.02, 1.04, 1.06))
# Refinement, by hand: larger tiles are more certain, smaller ones follow the lens.
REFINE_PX, VIEW_TOLERANCE_PX = (96, 96, 64, 64), 1.5  # tile side per round, outlier threshold
ALIGN_PX, RIM_PX = 48, 32  # tile side, largest shift beyond the view
# Findings of decision 0071 on tiles of 1.5 mm; by hand: thresholds between ten sound sensors and
# thirty bad ones, all simulated.
FINDINGS_TILE_MM = 1.5
BLURS_PX = np.geomspace(0.25, 6.0, 20)
TILE_CORRELATION, TILE_GAIN = 0.3, 0.15  # correlation with the recipe; contrast over the median
# By hand: averaging length, robust standard deviations, share of the contrast, and least length.
DEVIATION_MM, DEVIATION_SIGMA, DEVIATION_SHARE, MIN_DEVIATION_MM = 0.25, 7.0, 0.6, 0.2
SHADING_MM = 2.0  # differences smooth over this are light, by hand: smaller hides wide stains


class PrintInView:
    """The recipe's print, rendered as a camera sees it; the recipe must have patches."""

    def __init__(self, recipe: PatternRecipe, camera: CameraModel) -> None:
        assert recipe.patch_mm is not None, "accept asks"
        self.recipe, self.camera, self.patch_mm = recipe, camera, recipe.patch_mm
        scale, (x, y) = camera.mm_per_px, camera.centre_px
        self.nominal = np.array([[1 / scale, 0, x], [0, 1 / scale, y], [0, 0, 1]])
        """(3, 3), sensor mm (x, y) to px of the view."""
        self._step_mm = scale / 2
        self._print: NDArray[np.float32] = pattern_albedo(recipe, self._step_mm)
        self._bare = recipe.model_copy(update={"dots": None})  # dots look the same in all recipes

    def render(self, to_px: Field, rim_px: int = 0) -> NDArray[np.float32]:
        """Render the view, (h, w, 3) RGB in 0..1, white beyond the sticker.

        to_px: (3, 3), sticker mm to px. rim_px: added on every side.
        """
        w, h = self.camera.width_px + 2 * rim_px, self.camera.height_px + 2 * rim_px
        upsample = np.array([[2, 0, 0.5 + 2 * rim_px], [0, 2, 0.5 + 2 * rim_px], [0, 0, 1]])
        fine = _warp(self._print, self._step_mm, upsample @ to_px, (2 * w, 2 * h))
        return np.asarray(cv2.resize(fine, (w, h), interpolation=cv2.INTER_AREA), np.float32)

    def dots(self, to_px: Field) -> Image:
        """Mask (h, w) of marker dots and their edges in the view."""
        w, h = self.camera.width_px, self.camera.height_px
        if self.recipe.dots is None:
            return np.zeros((h, w), np.uint8)
        difference = np.abs(self._print - pattern_albedo(self._bare, self._step_mm)).max(axis=2)
        mask = cv2.dilate((difference > 0.02).astype(np.float32), np.ones((9, 9), np.uint8))
        bare = np.asarray(1 - mask, np.float32)
        return (_warp(bare, self._step_mm, to_px, (w, h)) < 0.5).astype(np.uint8)

    def place(self, view: NDArray[np.float32]) -> Placement | None:
        """Locate the print in a view (h, w, 3); None for another pattern."""
        for scales in TRIED_SCALES:
            guess = self._best_guess(view, scales)
            if guess.agreement >= MIN_AGREEMENT:
                rounds = [partial(self._compare, luma(view), side_px) for side_px in REFINE_PX]
                to_px = refine(guess.to_px, rounds, VIEW_TOLERANCE_PX)
                return None if to_px is None else replace(guess, to_px=to_px)
        return None

    def compare(self, view: NDArray[np.float32]) -> ComparedPrint | None:
        """Compare the print with a view (h, w, 3); None for another pattern."""
        placement = self.place(view)
        return None if placement is None else ComparedPrint(self, placement)

    def _best_guess(self, view: NDArray[np.float32], scales: Sequence[float]) -> Placement:
        """Best match of the middle of the view over orientation, turn and scale."""
        step = min(0.1, max(self.patch_mm / 2, self.camera.mm_per_px))
        shrink = self.camera.mm_per_px / step
        small = np.asarray(
            cv2.resize(view, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA), np.float32
        )
        h, w = small.shape[:2]
        px = min(round(VIEW_SEARCH_MM / step), h, w) // 2 * 2
        row, column = (h - px) // 2, (w - px) // 2
        image = _remove_shading(small[row : row + px, column : column + px], step)
        coarse = _remove_shading(pattern_albedo(self._bare, step), step)
        # View px to window px: shrunk and cropped.
        cut = np.array([[shrink, 0, (shrink - 1) / 2 - column],
                        [0, shrink, (shrink - 1) / 2 - row], [0, 0, 1]])  # fmt: skip
        window, reach = np.ones((px, px, 1), np.float32), min(round(LAG_MM / step), px // 2 - 1)
        best, pair_px = Placement(view, self.nominal, 0.0), 2 * self.patch_mm / step
        turns = np.add.outer((0.0, 90.0, 180.0, 270.0), TURNS_DEG).ravel()
        for scale, flip, turn_deg in product(scales, (1.0, -1.0), turns):
            to_view = self.nominal @ _rotation(turn_deg) @ np.diag([scale * flip, scale, 1.0])
            template = _warp(coarse, step, cut @ to_view, (px, px))
            agreement, (x, y) = correlation(image, template, window, reach, pair_px)
            if agreement > best.agreement:
                shift = np.array([[1, 0, x / shrink], [0, 1, y / shrink], [0, 0, 1]])
                best = Placement(view, shift @ to_view, agreement)
        return best

    def _compare(self, image: NDArray[np.float32], tile_px: int, to_px: Field) -> TileShifts:
        """One round of `locate.refine` on tiles of a view's luma."""
        middles, shifts, responses = tile_shifts(image, luma(self.render(to_px)), tile_px)
        middles = middles - 0.5
        points_mm = cv2.perspectiveTransform(middles[None], np.linalg.inv(to_px))[0]
        return points_mm, middles + shifts, responses


def _warp(
    image: NDArray[np.float32], step_mm: float, to_px: Field, size: tuple[int, int]
) -> NDArray[np.float32]:
    """Warp a print with pixels of step_mm, centred at 0, by a map mm to px; white outside."""
    middle = [(1 - n) * step_mm / 2 for n in image.shape[1::-1]]
    grid = np.array([[step_mm, 0, middle[0]], [0, step_mm, middle[1]], [0, 0, 1]])
    return np.asarray(cv2.warpPerspective(image, to_px @ grid, size, flags=cv2.INTER_LINEAR,
                                          borderValue=(1, 1, 1)), np.float32)  # fmt: skip


def _rotation(deg: float) -> Field:
    c, s = math.cos(math.radians(deg)), math.sin(math.radians(deg))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def _remove_shading(image: NDArray[np.float32], step_mm: float) -> NDArray[np.float32]:
    """Remove shading: a high-pass filter of 1 mm."""
    return np.asarray(image - cv2.GaussianBlur(image, (0, 0), 1.0 / step_mm), np.float32)


def luma(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Luma of an RGB image (h, w, 3), float32."""
    return np.asarray(grey_levels(image), np.float32)


def align(image: NDArray[np.float32], template: NDArray[np.float32]) -> NDArray[np.float32]:
    """Align a template, RIM_PX wider on every side, with an image by a smooth polynomial shift.

    It takes up the lens distortion that a homography leaves.
    """
    h, w = image.shape
    warped = template[RIM_PX:-RIM_PX, RIM_PX:-RIM_PX]
    x, y = np.meshgrid(np.arange(w), np.arange(h))
    everywhere = _quartic(x.ravel() + 0.5, y.ravel() + 0.5, w, h)
    warp = np.zeros((h, w, 2))
    corners = (0, 0), (h % ALIGN_PX, w % ALIGN_PX)  # tiles from both ends: the rim counts too
    for _ in range(2):
        parts = [tile_shifts(image[i:, j:], warped[i:, j:], ALIGN_PX) for i, j in corners]
        xy = np.concatenate([p[0] + (j, i) for p, (i, j) in zip(parts, corners, strict=True)])
        shifts, response = (np.concatenate([p[k] for p in parts]) for k in (1, 2))
        good = strong = response > MIN_RESPONSE
        for _ in range(3):
            fitted = np.linalg.pinv(_quartic(xy[good, 0], xy[good, 1], w, h)) @ shifts[good]
            residuals = np.hypot(*(shifts - _quartic(xy[:, 0], xy[:, 1], w, h) @ fitted).T)
            good = strong & (residuals < max(0.5, 3 * float(np.median(residuals[good]))))
        warp += (everywhere @ fitted).reshape(h, w, 2)
        at_x, at_y = (
            (grid - warp[..., k] + RIM_PX).astype(np.float32) for k, grid in enumerate((x, y))
        )
        warped = np.asarray(cv2.remap(template, at_x, at_y, cv2.INTER_LINEAR), np.float32)
    return warped


def _quartic(x_px: Array, y_px: Array, w: int, h: int) -> Field:
    """Monomials up to the fourth degree, (n, 15)."""
    x, y = 2 * x_px / w - 1, 2 * y_px / h - 1
    return np.stack([x**i * y**j for i in range(5) for j in range(5 - i)], axis=-1)


@dataclass(frozen=True)
class FaceFindings:
    """Findings of images at rest about a sensor, in mm of its frame.

    turned_deg: rotation of the sticker against the design, counter-clockwise as the camera sees
    it. scale: image scale over the camera's. keystone: size ratio of opposite sides, less 1.
    blur_px: standard deviation per tile, rows of y, None without pattern. level: white level,
    linear, 1 is full scale. evenness: least over mean light; one_sided: fall from side to side
    over the mean. edges: width without pattern at each side, mm. torn, places: (x, y, length) of
    missing pattern at the rim, and of deviations. saturated: share of full pixels. noise_mm: of a
    face point, None: unknown. rest: findings of `health`.
    """

    agreement: float
    mirrored: bool
    turned_deg: float
    place_mm: Point2
    scale: float
    keystone: float
    blur_px: list[list[float | None]]
    level: float
    evenness: float
    one_sided: float
    face_share: float
    edges: dict[str, float]
    torn: tuple[Point, ...]
    places: tuple[Point, ...]
    saturated: float = 0.0
    noise_mm: float | None = None
    rest: tuple[str, ...] = ()


class _TileGrid:
    """Tiles of the view: means, and regression of an image on another."""

    def __init__(self, shape: tuple[int, ...], mm_per_px: float) -> None:
        self.ny, self.nx = (max(3, round(n * mm_per_px / FINDINGS_TILE_MM)) for n in shape[:2])
        self._shape = shape
        self.mm = shape[1] * mm_per_px / self.nx, shape[0] * mm_per_px / self.ny
        x, y = ((np.arange(n) + 0.5 - n / 2) * side
                for n, side in zip((self.nx, self.ny), self.mm, strict=True))  # fmt: skip
        self.x_mm, self.y_mm = np.meshgrid(x, y)

    def mean(self, image: Array) -> Field:
        """Mean of each tile, (ny, nx)."""
        return np.asarray(
            cv2.resize(image, (self.nx, self.ny), interpolation=cv2.INTER_AREA), np.float64
        )

    def spread(self, values: Array) -> NDArray[np.float32]:
        """Interpolate tile values to the view's pixels."""
        size = (self._shape[1], self._shape[0])
        return np.asarray(cv2.resize(values.astype(np.float32), size), np.float32)

    def regress(self, y: NDArray[np.float32], x: NDArray[np.float32]) -> tuple[Field, ...]:
        """Correlation, slope and offset of an image y over an image x, each (ny, nx)."""
        my, mx = self.mean(y), self.mean(x)
        yy, xx, xy = self.mean(y * y), self.mean(x * x), self.mean(y * x)
        var_y, var_x = np.maximum(yy - my * my, 1e-9), np.maximum(xx - mx * mx, 1e-9)
        slope = (xy - my * mx) / var_x
        return (xy - my * mx) / np.sqrt(var_y * var_x), slope, my - slope * mx


class ComparedPrint:
    """Rendered print against the image at each of BLURS_PX, (blurs, ny, nx)."""

    def __init__(self, sticker: PrintInView, placement: Placement) -> None:
        self.image, self.sticker, self.placement = luma(placement.image), sticker, placement
        self.tiles = tiles = _TileGrid(self.image.shape, sticker.camera.mm_per_px)
        self.template = align(self.image, luma(sticker.render(placement.to_px, RIM_PX)))
        self.blurred = [
            np.asarray(cv2.GaussianBlur(self.template, (0, 0), s), np.float32) for s in BLURS_PX
        ]
        self.correlations, self.slope, self.offset = (
            np.stack(layers)
            for layers in zip(*(tiles.regress(self.image, b) for b in self.blurred), strict=True)
        )
        self.agreement = float(np.median(self.correlations.max(axis=0)))

    def findings(self, skin: SkinDimensions) -> FaceFindings:
        camera, tiles, correlations = self.sticker.camera, self.tiles, self.correlations
        best = correlations.argmax(axis=0)
        # Contrast is compared at one blur: a blank tile correlates with any very soft image.
        gain = self.slope[int(np.median(best))]
        has_pattern = correlations.max(axis=0) >= TILE_CORRELATION
        has_pattern &= gain >= TILE_GAIN * np.median(gain)
        slope, offset = (
            np.take_along_axis(values, best[None], 0)[0] for values in (self.slope, self.offset)
        )
        white = np.clip(slope + offset, 0, None) ** CAMERA_GAMMA
        light = _smooth(white, has_pattern)[has_pattern]
        mean = float(light.mean())
        edges, torn, inside = _find_missing(~has_pattern, tiles)
        index = tiles.spread(_smooth(best, has_pattern)).round().astype(int)
        slope_px, offset_px = (tiles.spread(_smooth(v, has_pattern)) for v in (slope, offset))
        template = np.take_along_axis(np.stack(self.blurred), index[None], 0)[0]
        residual = self.image - (template * slope_px + offset_px)
        window_px = round(SHADING_MM / camera.mm_per_px)
        residual = np.abs(residual - cv2.blur(residual, (window_px, window_px)))
        residual = residual / np.maximum(slope_px, 1e-3) / self.template.std()
        marked = cv2.dilate((~has_pattern & ~inside).astype(np.uint8), np.ones((5, 5), np.uint8))
        # The edges of white dots depend on light and interpolation, not on dirt.
        ignored = (tiles.spread(marked) > 0.5) | (self.sticker.dots(self.placement.to_px) > 0)
        to_face = np.linalg.inv(self.sticker.nominal) @ self.placement.to_px
        half = np.array([camera.width_px, camera.height_px]) * camera.mm_per_px / 2
        scale, keystone = _scales(to_face, half)
        turn = math.degrees(math.atan2(to_face[1, 1], to_face[0, 1])) - 90
        face_mm2 = skin.width_mm * skin.length_mm
        x_mm, y_mm = cv2.perspectiveTransform(np.zeros((1, 1, 2)), to_face)[0, 0].tolist()
        return FaceFindings(
            agreement=self.agreement,
            mirrored=self.placement.mirrored,
            turned_deg=(turn + 180) % 360 - 180,
            place_mm=(x_mm, y_mm),
            scale=scale,
            keystone=keystone,
            blur_px=[
                [round(float(b), 2) if valid else None for b, valid in zip(*row, strict=True)]
                for row in zip(_refine_blur(correlations, best), has_pattern, strict=True)
            ],
            level=float(np.median(white[has_pattern])),
            evenness=float(light.min()) / mean,
            one_sided=measure_fall(light / mean, tiles.x_mm[has_pattern], tiles.y_mm[has_pattern]),
            face_share=float(has_pattern.mean() * 4 * half[0] * half[1] / face_mm2),
            edges=edges,
            torn=torn,
            places=_find_deviations(residual, ignored, camera.mm_per_px),
        )


def _refine_blur(rho: Field, best: NDArray[np.int64]) -> Field:
    """Refine the best of BLURS_PX by a parabola through its neighbours, px."""
    peak = np.clip(best, 1, len(BLURS_PX) - 2)
    below, top, above = (np.take_along_axis(rho, (peak + k)[None], 0)[0] for k in (-1, 0, 1))
    curvature = below - 2 * top + above
    step = np.where(curvature < 0, 0.5 * (below - above) / np.minimum(curvature, -1e-12), 0.0)
    index = peak + np.clip(step, -1, 1)
    return np.exp(np.interp(index, np.arange(len(BLURS_PX)), np.log(BLURS_PX)))


def _smooth(values: Array, valid: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Fill invalid tiles with the nearest valid value, then filter by 3 x 3 medians."""
    from scipy.ndimage import distance_transform_edt

    nearest = distance_transform_edt(~valid, return_distances=False, return_indices=True)
    return np.asarray(cv2.medianBlur(values[tuple(nearest)].astype(np.float32), 3), np.float32)


def measure_fall(share: Array, x_mm: Array, y_mm: Array) -> float:
    """Measure the linear fall of light from side to side, apart from symmetric falloff."""
    x, y = x_mm / np.abs(x_mm).max(), y_mm / np.abs(y_mm).max()
    table = np.stack((np.ones_like(x), x, y, x * x, y * y), axis=-1)
    fitted, *_ = np.linalg.lstsq(table, share, rcond=None)
    return float(2 * np.hypot(fitted[1], fitted[2]))


def _find_missing(
    missing: NDArray[np.bool_], tiles: _TileGrid
) -> tuple[dict[str, float], tuple[Point, ...], NDArray[np.bool_]]:
    """Missing pattern: width along whole sides, pieces at the rim, and mask of inner tiles."""
    depths, edges = [], {}
    for side, axis, flip in (("-x", 1, 1), ("+x", 1, -1), ("-y", 0, 1), ("+y", 0, -1)):
        blank = np.moveaxis(missing, axis, 0)[::flip].mean(axis=1) >= 0.5
        depths.append(int(np.argmin(np.append(blank, False))))
        if depths[-1]:
            edges[side] = round(depths[-1] * tiles.mm[1 - axis], 1)
    inner = slice(depths[2], tiles.ny - depths[3]), slice(depths[0], tiles.nx - depths[1])
    count, labels = cv2.connectedComponents(missing[inner].astype(np.uint8))
    rim = np.unique(np.concatenate((labels[[0, -1]].ravel(), labels[:, [0, -1]].ravel())))
    torn, inside = [], np.zeros_like(missing)
    for label in range(1, count):
        region = labels == label
        if label in rim:
            x, y = tiles.x_mm[inner][region], tiles.y_mm[inner][region]
            size = max(np.ptp(x) + tiles.mm[0], np.ptp(y) + tiles.mm[1])
            torn.append((round(float(x.mean()), 1), round(float(y.mean()), 1), round(size, 1)))
        else:
            inside[inner] |= region
    return edges, tuple(torn), inside


def _find_deviations(
    residual: NDArray[np.float32], ignored: NDArray[np.bool_], mm_per_px: float
) -> tuple[Point, ...]:
    """Find deviations from the pattern: (x, y, length), mm, largest first."""
    size = max(3, round(DEVIATION_MM / mm_per_px))
    mean = cv2.blur(residual, (size, size))
    background = mean[~ignored]
    middle = float(np.median(background))
    limit = middle + DEVIATION_SIGMA * 1.4826 * float(np.median(np.abs(background - middle)))
    limit = max(limit, DEVIATION_SHARE)
    deviating = (mean > limit) & ~ignored
    joined = cv2.dilate(deviating.astype(np.uint8), np.ones((size, size), np.uint8))
    count, _, stats, middles = cv2.connectedComponentsWithStats(joined)
    h, w = residual.shape
    places = []
    for k in range(1, count):
        x, y = (middles[k] - ((w - 1) / 2, (h - 1) / 2)) * mm_per_px
        longest = (
            max(stats[k, cv2.CC_STAT_WIDTH], stats[k, cv2.CC_STAT_HEIGHT]) - size
        ) * mm_per_px
        if longest >= MIN_DEVIATION_MM:
            places.append((round(float(x), 1), round(float(y), 1), round(float(longest), 1)))
    return tuple(sorted(places, key=lambda place: -place[2]))


def _scales(to_face: Field, half_mm: Field) -> tuple[float, float]:
    """Scale of a map in the middle, and the largest ratio of opposite sides' scales, less 1."""

    def scale_at(x: float, y: float) -> float:
        corners = np.array([[[x, y]], [[x + 0.1, y]], [[x, y + 0.1]]])
        a, b, c = cv2.perspectiveTransform(corners, to_face)[:, 0]
        return float(math.sqrt(abs(np.linalg.det(np.stack((b - a, c - a))))) / 0.1)

    x, y = half_mm
    ratios = [scale_at(x, 0) / scale_at(-x, 0), scale_at(0, y) / scale_at(0, -y)]
    return scale_at(0, 0), max(max(r, 1 / r) for r in ratios) - 1
