"""A recipe located in an image: rough guesses are ranked by correlation, the best refined by tiles.

A sticker in a scan is a dark or textured square on the film. Each of its eight orientations is
compared in the recipe's frame. A camera's view, where `in_view` draws the recipe, has guesses and
a comparison of its own; correlation, shifts of tiles and the fit of the map are these.
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

MIN_AGREEMENT = 0.2  # correlation of a sticker with its recipe; with another it is below 0.08
MIN_RESPONSE = 0.1  # of the phase correlation of a tile that counts
MIN_TILES, MIN_TILE_SHARE = 8, 0.2  # that count, or it is another pattern
PX_PER_PATCH = 4.0
MAX_SIDE_PX = 2400  # side of the sticker as it is compared
SHIFT_TILE_MM = 3.0
SEARCH_MM, SCAN_REACH_MM = 9.0, 1.0  # what is compared first, and how far it may lie off
SCAN_TOLERANCE_PX = 2.0

TileShifts = tuple[Field, Field, Array]
"""Of each tile a point (n, 2), a second one or a shift (n, 2), and the response (n,)."""


@dataclass(frozen=True)
class Placement:
    """Where a recipe's print lies in an image (h, w, 3), RGB in 0..1.

    to_px: (3, 3) from the recipe's mm (x, y from its middle) to px of the image. agreement: the
    correlation by which it was chosen.
    """

    image: NDArray[np.float32]
    to_px: Field
    agreement: float

    @property
    def mirrored(self) -> bool:
        return bool(np.linalg.det(self.to_px) < 0)


@dataclass(frozen=True)
class StickerFrame:
    """The frame of a recipe's sticker, in which a scan is compared: side_px x side_px."""

    recipe: PatternRecipe
    side_px: int

    @classmethod
    def finest(cls, recipe: PatternRecipe) -> StickerFrame:
        """The frame that resolves every patch."""
        fine = recipe.patch_mm or recipe.printed_mm / 400
        return cls(recipe, int(min(MAX_SIDE_PX, max(400, PX_PER_PATCH * recipe.printed_mm / fine))))

    @property
    def step_mm(self) -> float:
        return self.recipe.printed_mm / self.side_px

    @property
    def pair_px(self) -> float:
        """Width of two patches, for `correlation`."""
        return 2 * (self.recipe.patch_mm or 0) / self.step_mm

    @property
    def template(self) -> NDArray[np.float32]:
        """The sticker as the recipe has it, (side_px, side_px, 3)."""
        return _render(self.recipe, self.side_px)

    def plain(self) -> NDArray[np.float32]:
        """1 where the pattern alone is, 0 at marker dots, which look the same in every recipe."""
        if self.recipe.dots is None or self.recipe.patch_mm is None:
            return np.ones((self.side_px, self.side_px, 1), np.float32)
        without = self.recipe.model_copy(update={"dots": None})
        bare = pattern_albedo(without, self.step_mm, (self.side_px, self.side_px))
        marked = np.abs(self.template - bare).max(axis=2) > 0.05
        dilated = cv2.dilate(marked.astype(np.uint8), np.ones((7, 7), np.uint8))
        return (1 - dilated[..., None]).astype(np.float32)

    def flatten(self, scan: NDArray[np.float32], to_px: Field) -> NDArray[np.float32]:
        """A scan in this frame, (side_px, side_px, 3)."""
        step, first = self.step_mm, (self.step_mm - self.recipe.printed_mm) / 2
        to_scan = to_px @ np.array([[step, 0, first], [0, step, first], [0, 0, 1]])
        # As many source pixels as one covers are averaged: else fine patches fold.
        pitch = math.sqrt(abs(np.linalg.det(to_scan[:2, :2] / to_scan[2, 2])))
        source = scan
        if pitch > 1.5:
            source = np.asarray(cv2.GaussianBlur(scan, (0, 0), pitch / 2.5), np.float32)
        size, way_back = (self.side_px, self.side_px), cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        flat = cv2.warpPerspective(source, to_scan, size, None, way_back, cv2.BORDER_REPLICATE)
        return np.asarray(flat, np.float32)

    def shifts_mm(self, image: Array, template: Array) -> TileShifts:
        """Tiles of one ink (side_px, side_px): as of `tile_shifts`, in mm from the middle."""
        size_px = max(32, round(SHIFT_TILE_MM / self.step_mm))
        middles, shifts, responses = tile_shifts(image, template, size_px)
        return middles * self.step_mm - self.recipe.printed_mm / 2, shifts * self.step_mm, responses

    def compare(self, scan: NDArray[np.float32], to_px: Field) -> TileShifts:
        """A round of `refine` for a scan."""
        template, image = self.template, self.flatten(scan, to_px)
        # One ink: a mean of inks that lie apart is no pattern of any.
        c = int(np.argmax(image.std(axis=(0, 1)) * (template.std(axis=(0, 1)) > 0)))
        middles, shifts, responses = self.shifts_mm(image[..., c], template[..., c])
        return middles, cv2.perspectiveTransform((middles + shifts)[None], to_px)[0], responses


@lru_cache(maxsize=2)
def _render(recipe: PatternRecipe, side_px: int) -> NDArray[np.float32]:
    """A recipe's sticker; kept, for it is asked for at every refinement."""
    return pattern_albedo(recipe, recipe.printed_mm / side_px, (side_px, side_px))


def locate_in_scan(scan: Image, recipe: PatternRecipe, dpi: float | None) -> Placement | None:
    """The best of all squares of a scan (h, w, 3) RGB, in the part of it around that square.

    dpi: None where it is not known. None where no square is this recipe's.
    """
    # One by one, so that only one part of the scan is kept.
    placements = (place for corners in _squares(scan, recipe, dpi)
             for place in _place_square(scan, recipe, corners))  # fmt: skip
    best = max(placements, key=lambda place: place.agreement, default=None)
    return None if best is None or best.agreement < MIN_AGREEMENT else best


def _squares(scan: Image, recipe: PatternRecipe, dpi: float | None) -> Iterator[Field]:
    """Corners (4, 2) in px of what may be a sticker, in order round it, the likeliest first."""
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
    """Where a print may be: what is darker than the film, then what has more texture than the rest.

    A fine pattern is an even grey from afar; on a grey table only texture tells it.
    """
    grey = cv2.GaussianBlur(small.mean(axis=2), (0, 0), 2.0)
    yield (grey < 0.8 * np.percentile(grey, 98)).astype(np.uint8)
    mean = cv2.GaussianBlur(small, (0, 0), 4.0)
    spread = np.sqrt(np.maximum(cv2.GaussianBlur(small**2, (0, 0), 4.0) - mean**2, 0).mean(axis=2))
    scaled = (255 * np.minimum(spread / max(float(spread.max()), 1e-6), 1)).astype(np.uint8)
    _, mask = cv2.threshold(scaled, 0, 1, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    yield mask.astype(np.uint8)


def _place_square(full_scan: Image, recipe: PatternRecipe, corners: Field) -> Iterator[Placement]:
    """The likeliest ways round in which a square of a scan is the recipe, each refined."""
    room = 0.1 * np.ptp(corners, axis=0)
    low = np.maximum(corners.min(axis=0) - room, 0).astype(int)
    high = (corners.max(axis=0) + room + 1).astype(int)
    scan = full_scan[low[1] : high[1], low[0] : high[0]].astype(np.float32) / np.float32(255)
    corners = corners - low
    if cv2.contourArea(corners.astype(np.float32), oriented=True) < 0:
        corners = corners[::-1]
    half = recipe.printed_mm / 2
    square = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    # In the middle, where corners that are a little off only shift it.
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
    """The print with every tile where it lies, and how the whole agrees then; none: another's."""
    fine = StickerFrame.finest(recipe)
    frames = (StickerFrame(recipe, fine.side_px // 2), fine, fine, fine)
    refined = refine(to_px, [partial(frame.compare, scan) for frame in frames], SCAN_TOLERANCE_PX)
    if refined is not None:
        image, plain = fine.flatten(scan, refined), fine.plain()
        yield Placement(scan, refined, correlation(image, fine.template, plain, 2, fine.pair_px)[0])


def refine(
    to_px: Field, rounds: Iterable[Callable[[Field], TileShifts]], tolerance_px: float
) -> Field | None:
    """The map with every tile where it lies; None where too few are like the recipe's.

    rounds: each compares image and recipe under a map, and gives points of the recipe in mm and
    where they lie in the image, px. tolerance_px: a tile further off the common map is an outlier.
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
    """The best correlation of two pictures up to `reach` px apart, over colours, and the shift.

    where: (h, w, 1), what counts. The shift (x, y) is from drawn to seen.

    Of means over two patches (pair_px): neighbours that must differ are nearly a chessboard, which
    all such recipes share.
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
    """Whole tiles of a picture: rows and columns, and the middle (x, y) in px."""
    for row in range(0, shape[0] - size + 1, size):
        for column in range(0, shape[1] - size + 1, size):
            middle = np.array([column + size / 2, row + size / 2])
            yield (slice(row, row + size), slice(column, column + size)), middle


def tile_shifts(image: Array, template: Array, size: int) -> TileShifts:
    """Middles of the tiles and by how much they lie off, px, and the peak's response."""
    window = cv2.createHanningWindow((size, size), cv2.CV_64F)
    middles, shifts, responses = [], [], []
    for cut, middle_px in tiles(image.shape, size):
        a, b = template[cut].astype(np.float64), image[cut].astype(np.float64)
        shift, response = cv2.phaseCorrelate(a - a.mean(), b - b.mean(), window)
        middles.append(middle_px)
        shifts.append(shift)
        responses.append(response)
    return np.array(middles), np.array(shifts), np.array(responses)
