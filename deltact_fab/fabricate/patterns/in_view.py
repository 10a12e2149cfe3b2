"""A recipe's print located in a camera's view, drawn where it lies there, and compared with it."""

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
    LEAST_AGREEMENT,
    LEAST_RESPONSE,
    Placement,
    Tiles,
    correlation,
    refine,
    tile_shifts,
)
from .quality.figures import grey_levels
from .raster import pattern_albedo
from .recipe import PatternRecipe

SEARCH_MM = 9.0  # side of what is compared first
ASIDE_MM = 3.0  # the sticker's middle is looked for so far off
ALIGN_PX, RIM_PX = 48, 32
ROUNDS_PX = (96, 96, 64, 64)  # sides of the tiles, from round to round
TOLERANCE_PX = 1.5
TURNS_DEG = np.arange(-7.5, 7.6, 1.5)
SCALES = ((1.0,), (0.94, 0.96, 0.98, 1.02, 1.04, 1.06))  # of the picture; tried in turn
TILE_MM = 1.5
BLURS_PX = np.geomspace(0.25, 6.0, 20)
TILE_FOUND = 0.3  # correlation of a tile with the recipe
TILE_GAIN = 0.15  # contrast of a tile, of the median one
PLACE_MM, PLACE_SIGMA, PLACE_LEAST = 0.25, 7.0, 0.6  # the last is a share of the contrast
LEAST_PLACE_MM = 0.2
WIDE_MM = 2.0  # what differs alike over more is light


class PrintInView:
    """The recipe's print, drawn as a camera sees it. patch_mm: of the recipe, which has patches."""

    def __init__(self, recipe: PatternRecipe, camera: CameraModel) -> None:
        assert recipe.patch_mm is not None, "accept asks"
        self.recipe, self.camera, self.patch_mm = recipe, camera, recipe.patch_mm
        scale, (x, y) = camera.mm_per_px, camera.centre_px
        self.nominal = np.array([[1 / scale, 0, x], [0, 1 / scale, y], [0, 0, 1]])
        """From the sensor's mm (x, y) to px of the view."""
        self._step_mm = scale / 2
        self._print: NDArray[np.float32] = pattern_albedo(recipe, self._step_mm)
        self._bare = recipe.model_copy(update={"dots": None})  # those look the same in all recipes

    def seen(self, to_px: Field, rim_px: int = 0) -> NDArray[np.float32]:
        """(h, w, 3) RGB in 0..1, white beyond the sticker. to_px: from its mm to the view's px.

        rim_px: so much wider on every side.
        """
        w, h = self.camera.width_px + 2 * rim_px, self.camera.height_px + 2 * rim_px
        twice = np.array([[2, 0, 0.5 + 2 * rim_px], [0, 2, 0.5 + 2 * rim_px], [0, 0, 1]])
        fine = _warped(self._print, self._step_mm, twice @ to_px, (2 * w, 2 * h))
        return np.asarray(cv2.resize(fine, (w, h), interpolation=cv2.INTER_AREA), np.float32)

    def dots(self, to_px: Field) -> Image:
        """Where in the view (h, w) a marker dot is, or its edge."""
        w, h = self.camera.width_px, self.camera.height_px
        if self.recipe.dots is None:
            return np.zeros((h, w), np.uint8)
        off = np.abs(self._print - pattern_albedo(self._bare, self._step_mm)).max(axis=2)
        mask = cv2.dilate((off > 0.02).astype(np.float32), np.ones((9, 9), np.uint8))
        bare = np.asarray(1 - mask, np.float32)
        return (_warped(bare, self._step_mm, to_px, (w, h)) < 0.5).astype(np.uint8)

    def place(self, view: NDArray[np.float32]) -> Placement | None:
        """The print in a view (h, w, 3); None where it is another pattern."""
        for scales in SCALES:
            guess = self._guess(view, scales)
            if guess.agreement >= LEAST_AGREEMENT:
                rounds = [partial(self._compare, luma(view), tile_px) for tile_px in ROUNDS_PX]
                to_px = refine(guess.to_px, rounds, TOLERANCE_PX)
                return None if to_px is None else replace(guess, to_px=to_px)
        return None

    def compare(self, view: NDArray[np.float32]) -> ComparedPrint | None:
        """The print beside what is seen in a view (h, w, 3); None where it is another pattern."""
        placement = self.place(view)
        return None if placement is None else ComparedPrint(self, placement)

    def _guess(self, view: NDArray[np.float32], scales: Sequence[float]) -> Placement:
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
        coarse = _levelled(pattern_albedo(self._bare, step), step)
        # Of the window: its px are the view's, shrunk and cut.
        cut = np.array([[shrink, 0, (shrink - 1) / 2 - left],
                        [0, shrink, (shrink - 1) / 2 - top], [0, 0, 1]])  # fmt: skip
        window, reach = np.ones((px, px, 1), np.float32), min(round(ASIDE_MM / step), px // 2 - 1)
        best, pair_px = Placement(view, self.nominal, 0.0), 2 * self.patch_mm / step
        turns = np.add.outer((0.0, 90.0, 180.0, 270.0), TURNS_DEG).ravel()
        for scale, flip, turn_deg in product(scales, (1.0, -1.0), turns):
            way = self.nominal @ _turn(turn_deg) @ np.diag([scale * flip, scale, 1.0])
            drawn = _warped(coarse, step, cut @ way, (px, px))
            agreement, (x, y) = correlation(seen, drawn, window, reach, pair_px)
            if agreement > best.agreement:
                moved = np.array([[1, 0, x / shrink], [0, 1, y / shrink], [0, 0, 1]])
                best = Placement(view, moved @ way, agreement)
        return best

    def _compare(self, seen: NDArray[np.float32], tile_px: int, to_px: Field) -> Tiles:
        """A round of `locate.refine`, tile by tile of a view's luma."""
        middles, shifts, responses = tile_shifts(seen, luma(self.seen(to_px)), tile_px)
        middles = middles - 0.5
        points_mm = cv2.perspectiveTransform(middles[None], np.linalg.inv(to_px))[0]
        return points_mm, middles + shifts, responses


def _warped(
    image: NDArray[np.float32], step_mm: float, to_px: Field, size: tuple[int, int]
) -> NDArray[np.float32]:
    """A print of step_mm, its middle at 0, through a map from mm to px; beyond it white."""
    middle = [(1 - n) * step_mm / 2 for n in image.shape[1::-1]]
    grid = np.array([[step_mm, 0, middle[0]], [0, step_mm, middle[1]], [0, 0, 1]])
    return np.asarray(cv2.warpPerspective(image, to_px @ grid, size, flags=cv2.INTER_LINEAR,
                                          borderValue=(1, 1, 1)), np.float32)  # fmt: skip


def _turn(deg: float) -> Field:
    c, s = math.cos(math.radians(deg)), math.sin(math.radians(deg))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def _levelled(image: NDArray[np.float32], step_mm: float) -> NDArray[np.float32]:
    """Without what light does to it over more than a millimetre."""
    return np.asarray(image - cv2.GaussianBlur(image, (0, 0), 1.0 / step_mm), np.float32)


def luma(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Of an RGB picture (h, w, 3), float32."""
    return np.asarray(grey_levels(image), np.float32)


def aligned(seen: NDArray[np.float32], wide: NDArray[np.float32]) -> NDArray[np.float32]:
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
        good = strong = response > LEAST_RESPONSE
        for _ in range(3):
            fitted = np.linalg.pinv(_quartic(at[good, 0], at[good, 1], w, h)) @ off[good]
            left = np.hypot(*(off - _quartic(at[:, 0], at[:, 1], w, h) @ fitted).T)
            good = strong & (left < max(0.5, 3 * float(np.median(left[good]))))
        moved += (everywhere @ fitted).reshape(h, w, 2)
        at_x, at_y = (
            (one - moved[..., k] + RIM_PX).astype(np.float32) for k, one in enumerate((x, y))
        )
        drawn = np.asarray(cv2.remap(wide, at_x, at_y, cv2.INTER_LINEAR), np.float32)
    return drawn


def _quartic(x_px: Array, y_px: Array, w: int, h: int) -> Field:
    """The monomials up to the fourth degree, (n, 15)."""
    x, y = 2 * x_px / w - 1, 2 * y_px / h - 1
    return np.stack([x**i * y**j for i in range(5) for j in range(5 - i)], axis=-1)


@dataclass(frozen=True)
class FaceFindings:
    """Findings of images at rest about a sensor, in mm of its frame.

    turned_deg: of the sticker from where the design has it, counter-clockwise as the camera sees
    it. scale: of the picture, over the camera's. keystone: by how much one side of the view is
    larger than the other. blur_px: standard deviation in each tile, rows of y, None where there is
    no pattern. level: of white, linear, 1 is full. evenness: least over mean; one_sided: by how
    much it falls from side to side, of its mean. edges: what of each side shows no pattern. torn,
    places: (x, y, length) of what lacks pattern at the rim, and of what lies before it. saturated:
    share of full pixels. noise_mm: of a point of the face; None: not known. rest: what `health`
    says against it.
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


class _Tiles:
    """Means over tiles of the view, and what they say of a drawn picture in a seen one."""

    def __init__(self, shape: tuple[int, ...], mm_per_px: float) -> None:
        self.ny, self.nx = (max(3, round(n * mm_per_px / TILE_MM)) for n in shape[:2])
        self._shape = shape
        self.mm = shape[1] * mm_per_px / self.nx, shape[0] * mm_per_px / self.ny
        x, y = ((np.arange(n) + 0.5 - n / 2) * side
                for n, side in zip((self.nx, self.ny), self.mm, strict=True))  # fmt: skip
        self.x_mm, self.y_mm = np.meshgrid(x, y)

    def mean(self, image: Array) -> Field:
        """(ny, nx)."""
        return np.asarray(
            cv2.resize(image, (self.nx, self.ny), interpolation=cv2.INTER_AREA), np.float64
        )

    def spread(self, values: Array) -> NDArray[np.float32]:
        """Values of tiles over the view's pixels."""
        size = (self._shape[1], self._shape[0])
        return np.asarray(cv2.resize(values.astype(np.float32), size), np.float32)

    def compared(self, seen: NDArray[np.float32], drawn: NDArray[np.float32]) -> tuple[Field, ...]:
        """Correlation, slope and offset of seen over drawn, each (ny, nx)."""
        s, d = self.mean(seen), self.mean(drawn)
        ss, dd, sd = self.mean(seen * seen), self.mean(drawn * drawn), self.mean(seen * drawn)
        var_s, var_d = np.maximum(ss - s * s, 1e-9), np.maximum(dd - d * d, 1e-9)
        slope = (sd - s * d) / var_d
        return (sd - s * d) / np.sqrt(var_s * var_d), slope, s - slope * d


class ComparedPrint:
    """The recipe's print beside what is seen, at each of BLURS_PX: (blurs, ny, nx)."""

    def __init__(self, sticker: PrintInView, placement: Placement) -> None:
        self.seen, self.sticker, self.placement = luma(placement.image), sticker, placement
        self.tiles = tiles = _Tiles(self.seen.shape, sticker.camera.mm_per_px)
        self.drawn = aligned(self.seen, luma(sticker.seen(placement.to_px, RIM_PX)))
        self.blurred = [
            np.asarray(cv2.GaussianBlur(self.drawn, (0, 0), s), np.float32) for s in BLURS_PX
        ]
        self.like, self.slope, self.offset = (
            np.stack(one)
            for one in zip(*(tiles.compared(self.seen, b) for b in self.blurred), strict=True)
        )
        self.agreement = float(np.median(self.like.max(axis=0)))

    def findings(self, skin: SkinDimensions) -> FaceFindings:
        camera, tiles, like = self.sticker.camera, self.tiles, self.like
        best = like.argmax(axis=0)
        # Contrast is compared at one blur: a tile without pattern may be like anything very soft.
        usual = self.slope[int(np.median(best))]
        shown = (like.max(axis=0) >= TILE_FOUND) & (usual >= TILE_GAIN * np.median(usual))
        slope, offset = (
            np.take_along_axis(one, best[None], 0)[0] for one in (self.slope, self.offset)
        )
        white = np.clip(slope + offset, 0, None) ** CAMERA_GAMMA
        light = _smooth(white, shown)[shown]
        mean = float(light.mean())
        edges, torn, inside = _missing(~shown, tiles)
        index = tiles.spread(_smooth(best, shown)).round().astype(int)
        slope_px, offset_px = (tiles.spread(_smooth(one, shown)) for one in (slope, offset))
        drawn = np.take_along_axis(np.stack(self.blurred), index[None], 0)[0]
        off, wide = self.seen - (drawn * slope_px + offset_px), round(WIDE_MM / camera.mm_per_px)
        off = np.abs(off - cv2.blur(off, (wide, wide)))
        off = off / np.maximum(slope_px, 1e-3) / self.drawn.std()
        marked = cv2.dilate((~shown & ~inside).astype(np.uint8), np.ones((5, 5), np.uint8))
        # A dot is white beside any ink: its edge depends on light and code, not on dirt.
        without = (tiles.spread(marked) > 0.5) | (self.sticker.dots(self.placement.to_px) > 0)
        way = np.linalg.inv(self.sticker.nominal) @ self.placement.to_px
        half = np.array([camera.width_px, camera.height_px]) * camera.mm_per_px / 2
        scale, keystone = _scales(way, half)
        turn = math.degrees(math.atan2(way[1, 1], way[0, 1])) - 90
        face_mm2 = skin.width_mm * skin.length_mm
        x_mm, y_mm = cv2.perspectiveTransform(np.zeros((1, 1, 2)), way)[0, 0].tolist()
        return FaceFindings(
            agreement=self.agreement,
            mirrored=self.placement.mirrored,
            turned_deg=(turn + 180) % 360 - 180,
            place_mm=(x_mm, y_mm),
            scale=scale,
            keystone=keystone,
            blur_px=[
                [round(float(b), 2) if there else None for b, there in zip(*row, strict=True)]
                for row in zip(_between(like, best), shown, strict=True)
            ],
            level=float(np.median(white[shown])),
            evenness=float(light.min()) / mean,
            one_sided=measure_fall(light / mean, tiles.x_mm[shown], tiles.y_mm[shown]),
            face_share=float(shown.mean() * 4 * half[0] * half[1] / face_mm2),
            edges=edges,
            torn=torn,
            places=_places(off, without, camera.mm_per_px),
        )


def _between(like: Field, best: NDArray[np.int64]) -> Field:
    """The blur in px at the top of the parabola through the best of BLURS_PX and its neighbours."""
    at = np.clip(best, 1, len(BLURS_PX) - 2)
    below, top, above = (np.take_along_axis(like, (at + k)[None], 0)[0] for k in (-1, 0, 1))
    bend = below - 2 * top + above
    move = np.where(bend < 0, 0.5 * (below - above) / np.minimum(bend, -1e-12), 0.0)
    index = at + np.clip(move, -1, 1)
    return np.exp(np.interp(index, np.arange(len(BLURS_PX)), np.log(BLURS_PX)))


def _smooth(values: Array, known: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Values of tiles, those that are not known as the nearest known one; medians of nine."""
    from scipy.ndimage import distance_transform_edt

    nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return np.asarray(cv2.medianBlur(values[tuple(nearest)].astype(np.float32), 3), np.float32)


def measure_fall(share: Array, x_mm: Array, y_mm: Array) -> float:
    """Measure how much light falls from side to side, beside what falls off alike all round."""
    x, y = x_mm / np.abs(x_mm).max(), y_mm / np.abs(y_mm).max()
    table = np.stack((np.ones_like(x), x, y, x * x, y * y), axis=-1)
    fitted, *_ = np.linalg.lstsq(table, share, rcond=None)
    return float(2 * np.hypot(fitted[1], fitted[2]))


def _missing(
    missing: NDArray[np.bool_], tiles: _Tiles
) -> tuple[dict[str, float], tuple[Point, ...], NDArray[np.bool_]]:
    """Along whole sides, at the rim beside that, and which tiles lie inside."""
    depths, edges = [], {}
    for side, axis, flip in (("-x", 1, 1), ("+x", 1, -1), ("-y", 0, 1), ("+y", 0, -1)):
        lost = np.moveaxis(missing, axis, 0)[::flip].mean(axis=1) >= 0.5
        depths.append(int(np.argmin(np.append(lost, False))))
        if depths[-1]:
            edges[side] = round(depths[-1] * tiles.mm[1 - axis], 1)
    left = slice(depths[2], tiles.ny - depths[3]), slice(depths[0], tiles.nx - depths[1])
    count, labels = cv2.connectedComponents(missing[left].astype(np.uint8))
    rim = np.unique(np.concatenate((labels[[0, -1]].ravel(), labels[:, [0, -1]].ravel())))
    torn, inside = [], np.zeros_like(missing)
    for label in range(1, count):
        here = labels == label
        if label in rim:
            x, y = tiles.x_mm[left][here], tiles.y_mm[left][here]
            size = max(np.ptp(x) + tiles.mm[0], np.ptp(y) + tiles.mm[1])
            torn.append((round(float(x.mean()), 1), round(float(y.mean()), 1), round(size, 1)))
        else:
            inside[left] |= here
    return edges, tuple(torn), inside


def _places(
    off: NDArray[np.float32], without: NDArray[np.bool_], mm_per_px: float
) -> tuple[Point, ...]:
    """Where the view is not what the pattern would be: middle and length, mm; the largest first."""
    size = max(3, round(PLACE_MM / mm_per_px))
    mean = cv2.blur(off, (size, size))
    usual = mean[~without]
    middle = float(np.median(usual))
    limit = middle + PLACE_SIGMA * 1.4826 * float(np.median(np.abs(usual - middle)))
    limit = max(limit, PLACE_LEAST)
    found = (mean > limit) & ~without
    joined = cv2.dilate(found.astype(np.uint8), np.ones((size, size), np.uint8))
    count, _, stats, middles = cv2.connectedComponentsWithStats(joined)
    h, w = off.shape
    places = []
    for k in range(1, count):
        x, y = (middles[k] - ((w - 1) / 2, (h - 1) / 2)) * mm_per_px
        longest = (
            max(stats[k, cv2.CC_STAT_WIDTH], stats[k, cv2.CC_STAT_HEIGHT]) - size
        ) * mm_per_px
        if longest >= LEAST_PLACE_MM:
            places.append((round(float(x), 1), round(float(y), 1), round(float(longest), 1)))
    return tuple(sorted(places, key=lambda place: -place[2]))


def _scales(way: Field, half_mm: Field) -> tuple[float, float]:
    """Of a map in the middle, and by how much one side's is larger than the other's, less 1."""

    def at(x: float, y: float) -> float:
        corners = np.array([[[x, y]], [[x + 0.1, y]], [[x, y + 0.1]]])
        a, b, c = cv2.perspectiveTransform(corners, way)[:, 0]
        return float(math.sqrt(abs(np.linalg.det(np.stack((b - a, c - a))))) / 0.1)

    x, y = half_mm
    ratios = [at(x, 0) / at(-x, 0), at(0, y) / at(0, -y)]
    return at(0, 0), max(max(r, 1 / r) for r in ratios) - 1
