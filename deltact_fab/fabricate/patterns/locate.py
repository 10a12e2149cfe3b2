"""Locate a recipe in an image: rank rough guesses by correlation, refine the best by tiles.

A sticker in a scan is a dark or textured square on the film, compared in eight orientations in the
recipe's frame. For a camera's view, `in_view` makes its own guesses and shares correlation, tile
shifts and refinement.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache, partial

import cv2
import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import MM_PER_INCH, Array, Field, Image

from .raster import pattern_albedo
from .recipe import PatternRecipe

MIN_AGREEMENT = 0.2  # correlation with the recipe; measured: 0.94, other seeds 0.08, decision 0071
# By hand: higher loses poor prints, lower lets noise in. Phase correlation of a tile that counts;
# least number and share of such tiles.
MIN_RESPONSE, MIN_TILES, MIN_TILE_SHARE = 0.1, 8, 0.2
# By hand: finer costs time. Pixels of a patch, side of the frame, side of a tile.
PATCH_PX, MAX_FRAME_PX, SHIFT_TILE_MM = 4.0, 2400, 3.0
# By hand: side of the middle that is compared first, its largest offset; an outlier's distance.
SEARCH_MM, SCAN_REACH_MM, SCAN_TOLERANCE_PX = 9.0, 1.0, 2.0

TileShifts = tuple[Field, Field, Array]
"""Per tile: a point (n, 2), its match or shift (n, 2), and the response (n,)."""


@dataclass(frozen=True)
class Placement:
    """A recipe's print located in an image (h, w, 3), RGB in 0..1.

    to_px: (3, 3), recipe mm (x, y from the middle) to px. agreement: correlation with the recipe.
    """

    image: NDArray[np.float32]
    to_px: Field
    agreement: float

    @property
    def mirrored(self) -> bool:
        return bool(np.linalg.det(self.to_px) < 0)


@dataclass(frozen=True)
class StickerFrame:
    """Frame of a recipe's sticker for comparison with a scan, side_px x side_px."""

    recipe: PatternRecipe
    side_px: int

    @classmethod
    def finest(cls, recipe: PatternRecipe) -> StickerFrame:
        """Return the frame that resolves every patch."""
        fine = recipe.patch_mm or recipe.printed_mm / 400
        return cls(recipe, int(min(MAX_FRAME_PX, max(400, PATCH_PX * recipe.printed_mm / fine))))

    @property
    def step_mm(self) -> float:
        return self.recipe.printed_mm / self.side_px

    @property
    def pair_px(self) -> float:
        """Width of two patches, for `correlation`."""
        return 2 * (self.recipe.patch_mm or 0) / self.step_mm

    @property
    def template(self) -> NDArray[np.float32]:
        """The designed sticker, (side_px, side_px, 3)."""
        return _render(self.recipe, self.side_px)

    def plain(self) -> NDArray[np.float32]:
        """Weight 1 on the pattern, 0 at marker dots, which look the same in every recipe."""
        if self.recipe.dots is None or self.recipe.patch_mm is None:
            return np.ones((self.side_px, self.side_px, 1), np.float32)
        without = self.recipe.model_copy(update={"dots": None})
        bare = pattern_albedo(without, self.step_mm, (self.side_px, self.side_px))
        marked = np.abs(self.template - bare).max(axis=2) > 0.05
        dilated = cv2.dilate(marked.astype(np.uint8), np.ones((7, 7), np.uint8))
        return (1 - dilated[..., None]).astype(np.float32)

    def flatten(self, scan: NDArray[np.float32], to_px: Field) -> NDArray[np.float32]:
        """Resample a scan to this frame, (side_px, side_px, 3)."""
        step, first = self.step_mm, (self.step_mm - self.recipe.printed_mm) / 2
        to_scan = to_px @ np.array([[step, 0, first], [0, step, first], [0, 0, 1]])
        # Low-pass filter before downsampling, or fine patches alias.
        pitch = math.sqrt(abs(np.linalg.det(to_scan[:2, :2] / to_scan[2, 2])))
        source = scan
        if pitch > 1.5:
            source = np.asarray(cv2.GaussianBlur(scan, (0, 0), pitch / 2.5), np.float32)
        size, flags = (self.side_px, self.side_px), cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        flat = cv2.warpPerspective(source, to_scan, size, None, flags, cv2.BORDER_REPLICATE)
        return np.asarray(flat, np.float32)

    def shifts_mm(self, image: Array, template: Array) -> TileShifts:
        """`tile_shifts` of one ink (side_px, side_px), in mm from the middle."""
        size_px = max(32, round(SHIFT_TILE_MM / self.step_mm))
        middles, shifts, responses = tile_shifts(image, template, size_px)
        return middles * self.step_mm - self.recipe.printed_mm / 2, shifts * self.step_mm, responses

    def compare(self, scan: NDArray[np.float32], to_px: Field) -> TileShifts:
        """One round of `refine` for a scan."""
        template, image = self.template, self.flatten(scan, to_px)
        # One ink: misregistered inks blur each other's mean.
        c = int(np.argmax(image.std(axis=(0, 1)) * (template.std(axis=(0, 1)) > 0)))
        middles, shifts, responses = self.shifts_mm(image[..., c], template[..., c])
        return middles, cv2.perspectiveTransform((middles + shifts)[None], to_px)[0], responses


@lru_cache(maxsize=2)
def _render(recipe: PatternRecipe, side_px: int) -> NDArray[np.float32]:
    """Render a recipe's sticker; cached, because every refinement needs it."""
    return pattern_albedo(recipe, recipe.printed_mm / side_px, (side_px, side_px))


def locate_in_scan(scan: Image, recipe: PatternRecipe, dpi: float | None) -> Placement | None:
    """Return the best match in a scan (h, w, 3) RGB, with the crop around it, or None.

    dpi: None if unknown.
    """
    # One by one, to hold only one crop of the scan.
    placements = (place for corners in _squares(scan, recipe, dpi)
             for place in _place_square(scan, recipe, corners))  # fmt: skip
    best = max(placements, key=lambda place: place.agreement, default=None)
    return None if best is None or best.agreement < MIN_AGREEMENT else best


def _squares(scan: Image, recipe: PatternRecipe, dpi: float | None) -> Iterator[Field]:
    """Yield corners (4, 2), px, of possible stickers in cyclic order, most likely first."""
    side_px = max(scan.shape[:2])
    if dpi is not None:
        side_px = round(recipe.printed_mm * dpi / MM_PER_INCH)
    shrink = min(1.0, 400 / side_px)
    small = cv2.resize(scan, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
    small = small.astype(np.float32) / np.float32(255)
    for mask in _print_masks(small):
        closed = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((21, 21), np.uint8))
        blobs = cv2.morphologyEx(closed, cv2.MORPH_OPEN, np.ones((31, 31), np.uint8))
        outlines, _ = cv2.findContours(blobs, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        for outline in sorted(outlines, key=cv2.contourArea, reverse=True)[:12]:
            area = float(cv2.contourArea(outline))
            if area < (0.6 * side_px * shrink) ** 2 * (1.0 if dpi is not None else 0.05):
                continue
            hull = cv2.convexHull(outline)
            for share in (0.02, 0.03, 0.05, 0.08):
                four = cv2.approxPolyDP(hull, share * cv2.arcLength(hull, True), True)
                if len(four) == 4:
                    yield (four[:, 0].astype(np.float64) + 0.5) / shrink - 0.5
                    break


def _print_masks(small: NDArray[np.float32]) -> Iterator[Image]:
    """Yield masks of possible prints: darker than the film, then more textured than the rest.

    At low resolution a fine pattern is an even grey, so that on a grey table only texture helps.
    """
    grey = cv2.GaussianBlur(small.mean(axis=2), (0, 0), 2.0)
    yield (grey < 0.8 * np.percentile(grey, 98)).astype(np.uint8)
    mean = cv2.GaussianBlur(small, (0, 0), 4.0)
    spread = np.sqrt(np.maximum(cv2.GaussianBlur(small**2, (0, 0), 4.0) - mean**2, 0).mean(axis=2))
    scaled = (255 * np.minimum(spread / max(float(spread.max()), 1e-6), 1)).astype(np.uint8)
    _, mask = cv2.threshold(scaled, 0, 1, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    yield mask.astype(np.uint8)


def _place_square(full_scan: Image, recipe: PatternRecipe, corners: Field) -> Iterator[Placement]:
    """Yield the two best orientations of the recipe in a square of a scan, refined."""
    room = 0.1 * np.ptp(corners, axis=0)
    low = np.maximum(corners.min(axis=0) - room, 0).astype(int)
    high = (corners.max(axis=0) + room + 1).astype(int)
    scan = full_scan[low[1] : high[1], low[0] : high[0]].astype(np.float32) / np.float32(255)
    corners = corners - low
    if cv2.contourArea(corners.astype(np.float32), oriented=True) < 0:
        corners = corners[::-1]
    half = recipe.printed_mm / 2
    square = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    # In the middle, where inexact corners only cause a shift.
    frame = StickerFrame(recipe, int(min(1000, max(360, 2 * recipe.n))))
    step, side_px = frame.step_mm, frame.side_px
    half_px = round(min(recipe.printed_mm, max(SEARCH_MM, 24 * (recipe.patch_mm or 0))) / step / 2)
    middle = slice(side_px // 2 - half_px, side_px // 2 + half_px)
    template, plain = frame.template[middle, middle], frame.plain()[middle, middle]
    reach = min(round(SCAN_REACH_MM / step), half_px - 1)
    guesses = []
    for order in (corners, corners[::-1]):  # as it is, then mirrored
        for k in range(4):
            fitted, _ = cv2.findHomography(square, np.roll(order, k, axis=0))
            to_px = np.asarray(fitted, np.float64)
            image = frame.flatten(scan, to_px)[middle, middle]
            agreement, _ = correlation(image, template, plain, reach, frame.pair_px)
            guesses.append(Placement(scan, to_px, agreement))
    for guess in sorted(guesses, key=lambda guess: -guess.agreement)[:2]:
        yield from _refined(scan, recipe, guess.to_px)


def _refined(scan: NDArray[np.float32], recipe: PatternRecipe, to_px: Field) -> Iterator[Placement]:
    """Yield the refined placement with its final agreement; nothing for another pattern."""
    fine = StickerFrame.finest(recipe)
    frames = (StickerFrame(recipe, fine.side_px // 2), fine, fine, fine)
    refined = refine(to_px, [partial(frame.compare, scan) for frame in frames], SCAN_TOLERANCE_PX)
    if refined is not None:
        image, plain = fine.flatten(scan, refined), fine.plain()
        yield Placement(scan, refined, correlation(image, fine.template, plain, 2, fine.pair_px)[0])


def refine(
    to_px: Field, rounds: Iterable[Callable[[Field], TileShifts]], tolerance_px: float
) -> Field | None:
    """Refine the map by tile matches; None if too few tiles match the recipe.

    rounds: each compares image and recipe under a map and returns recipe points, mm, and their
    matches in the image, px. tolerance_px: outlier threshold of the homography (RANSAC).
    """
    for compare in rounds:
        points_mm, points_px, responses = compare(to_px)
        good = responses > MIN_RESPONSE
        if good.sum() < max(MIN_TILES, MIN_TILE_SHARE * len(responses)):
            return None
        fitted, _ = cv2.findHomography(points_mm[good], points_px[good], cv2.RANSAC, tolerance_px)
        if fitted is None:
            return None
        to_px = np.asarray(fitted, np.float64)
    return to_px


def correlation(
    image: NDArray[np.float32],
    template: NDArray[np.float32],
    weight: NDArray[np.float32],
    reach: int,
    pair_px: float,
) -> tuple[float, tuple[int, int]]:
    """Return the best correlation over colours and shifts up to `reach` px, and the shift.

    weight: (h, w, 1). The shift (x, y) is from template to image. Both are averaged over two
    patches (pair_px): neighbours that must differ form nearly a chessboard in every such recipe.
    """
    k = max(1, round(pair_px))
    image, template = (np.asarray(cv2.blur(p, (k, k)), np.float32) for p in (image, template))
    spectrum = np.zeros((len(image), image.shape[1] // 2 + 1), complex)
    for c in range(3):
        a, b = ((p[..., c] - p[..., c].mean()) * weight[..., 0] for p in (image, template))
        norm = float(np.linalg.norm(a) * np.linalg.norm(b))
        if norm > 0:
            spectrum = spectrum + np.fft.rfft2(a) * np.conj(np.fft.rfft2(b)) / norm
    shifted = np.fft.irfft2(spectrum, image.shape[:2]) / 3
    near = np.roll(shifted, (reach, reach), (0, 1))[: 2 * reach + 1, : 2 * reach + 1]
    y, x = np.unravel_index(np.argmax(near), near.shape)
    return float(near[y, x]), (int(x) - reach, int(y) - reach)


def tiles(shape: tuple[int, ...], size: int) -> Iterator[tuple[tuple[slice, slice], Field]]:
    """Yield the whole tiles of an image: rows and columns, and the middle (x, y), px."""
    for row in range(0, shape[0] - size + 1, size):
        for column in range(0, shape[1] - size + 1, size):
            middle = np.array([column + size / 2, row + size / 2])
            yield (slice(row, row + size), slice(column, column + size)), middle


def tile_shifts(image: Array, template: Array, size: int) -> TileShifts:
    """Return middles and shifts of the tiles, px, and responses of phase correlation."""
    window = cv2.createHanningWindow((size, size), cv2.CV_64F)
    middles, shifts, responses = [], [], []
    for cut, middle_px in tiles(image.shape, size):
        a, b = template[cut].astype(np.float64), image[cut].astype(np.float64)
        shift, response = cv2.phaseCorrelate(a - a.mean(), b - b.mean(), window)
        middles.append(middle_px)
        shifts.append(shift)
        responses.append(response)
    return np.array(middles), np.array(shifts), np.array(responses)
