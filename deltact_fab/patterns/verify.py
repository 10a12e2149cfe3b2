"""A print against its recipe: is it right, how large is it, what did the printer do to it.

The sticker is found in a scan as a dark or textured square on the film. Each of its eight
orientations is correlated with the recipe, and the best is refined tile by tile: the positions of
the tiles give scale, shear and the registration of the inks; their content gives contrast, order
and gaps. Scale needs the dpi of a flatbed scan; a photograph has none.

The averaging by the scan's pixels is modelled. Blur by the lens or by a film out of focus is
attributed to the printer.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .. import catalog
from ..checks import Check, graded, passes
from ..errors import InputError
from ..imaging import Printer
from ..shapes.bounded import Bounded, number
from ..units import MM_PER_INCH
from .dots import to_px
from .metadata import opened
from .quality.measure import PRINTED_SHARE, kept
from .raster import albedo
from .recipe import PatternRecipe, centres_mm, draw_patches

Image = NDArray[np.float32]
PX_A_PATCH = 4.0
MOST_PX = 2400  # side of the sticker as it is compared
TILE_MM = 3.0
MIDDLE_MM, ASIDE_MM = 9.0, 1.0  # what is compared first, and how far it may lie off
FOUND = 0.2  # correlation of a sticker with its recipe; with another it is below 0.08
TOLD = 0.1  # response of a tile that counts
SCALE_OFF, SHEAR_OFF = 0.002, 0.002
IN_ORDER = 0.8  # of neighbouring patches; by chance it is half of them
INK_SHARE = 0.5  # of the strongest ink's contrast
GAP_SHARE = 0.5  # of the median tile's contrast
DOT_SHARE = 0.5  # of a dot's contrast with what is around it
DPI_RANGE = (50.0, 9600.0)
HALVED = "this JPEG keeps half of the colours' resolution: scan it as PNG or TIFF"


@dataclass(frozen=True)
class PrintFound:
    """A sticker in a scan. scale: its sides in (x, y) over the recipe's, None in a photograph.

    shear: tangent of the deviation of its axes from a right angle. turned_deg: counter-clockwise,
    as it lies in the scan. ink_um: offsets of R, G, B from their mean, (3, 2). contrast: of R, G, B
    as a share of the recipe's. gaps_mm: centres of tiles that lack ink. spread_um: ink spread at
    which the printer model of `pattern quality` keeps as much contrast. halved: the file keeps
    colours at half its resolution, so contrast and inks are not judged.
    """

    mirrored: bool
    turned_deg: float
    scale: tuple[float, float] | None
    shear: float
    contrast: tuple[float, float, float]
    kept: float
    in_order: float | None
    ink_um: tuple[tuple[float, float], ...]
    gaps_mm: tuple[tuple[float, float], ...]
    dots: tuple[int, int] | None
    spread_um: float
    misregistration_um: float
    halved: bool


@dataclass(frozen=True)
class KnownPrinter(Bounded):
    """A printer as its own print showed it: the file of `pattern verify -o`."""

    scale_x: float = number(1.0, "stretch in x by which a sheet comes out right", 0.5, 2)
    scale_y: float = number(1.0, "the same in y", 0.5, 2)
    spread_um: float = number(Printer.spread_um, "spread of the ink, two sigma", 0, 2000)
    misregistration_um: float = number(
        Printer.misregistration_um, "by which inks lie apart, one sigma", 0, 2000
    )


def load_printer(path: Path) -> KnownPrinter:
    """The file of `pattern verify -o`. Raises InputError naming file and key."""
    return catalog.validate(KnownPrinter, catalog.read(path), str(path))


@dataclass(frozen=True)
class PrintCheck:
    """What `verify` says: rows, the worst of which is the verdict, and the figures behind them.

    scaled: by which the sheet was stretched when it was written.
    """

    scan: str
    rows: tuple[Check, ...]
    found: PrintFound | None
    scaled: tuple[float, float] = (1.0, 1.0)

    @property
    def passed(self) -> bool:
        """True where no row fails."""
        return passes(self.rows)

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as `pattern verify --json` prints it."""
        return {
            "passed": self.passed, "scan": self.scan, "scaled": self.scaled,
            "found": None if self.found is None else asdict(self.found),
            "checks": [row.as_dict() for row in self.rows],
        }  # fmt: skip

    def printer(self) -> KnownPrinter:
        """What the print shows about its printer.

        Raises InputError for a photograph, and for a print that is not the recipe's.
        """
        found = self.found
        if found is None or found.scale is None:
            raise InputError(f"{self.scan}: has no scale: use a flatbed scan with its dpi")
        if found.halved:
            raise InputError(f"{self.scan}: {HALVED}")
        x, y = (was / is_ for was, is_ in zip(self.scaled, found.scale, strict=True))
        return KnownPrinter(x, y, found.spread_um, found.misregistration_um)


def load_scan(path: Path, dpi: float | None = None) -> tuple[NDArray[np.uint8], float | None, bool]:
    """An image (h, w, 3) RGB, its dpi, and whether its colours are halved, as JPEG does.

    dpi: of the file unless given; None where neither says it. Raises InputError for a file that is
    no image, and for a dpi that no scanner has.
    """
    low, high = DPI_RANGE
    if dpi is not None and not low <= dpi <= high:
        raise InputError(f"--dpi {dpi:g}: expected {low:g} to {high:g}")
    from PIL.JpegImagePlugin import get_sampling

    with opened(path) as image:
        told = image.info.get("dpi")
        halved = image.format == "JPEG" and get_sampling(image) not in (-1, 0)
        rgb = np.asarray(image.convert("RGB"))
    if dpi is None and told is not None and 100 <= float(told[0]) == float(told[1]):
        dpi = float(told[0])
    return rgb, dpi, halved


def verify(
    path: Path,
    recipe: PatternRecipe,
    dpi: float | None = None,
    mirrored: bool = False,
    scaled: tuple[float, float] = (1.0, 1.0),
) -> PrintCheck:
    """Compare a scan or photograph of a print with its recipe.

    dpi: of the scan, instead of the file's. mirrored: what the transfer requires (`slide`). scaled:
    by which the sheet was stretched already. Raises InputError for a file that cannot be used and
    for a recipe of one colour.
    """
    if recipe.patch_mm is None and recipe.dots is None:
        raise InputError(f"{recipe.law}: one uniform colour: there is nothing to compare")
    scan, dpi, halved = load_scan(path, dpi)
    best = _best_of(_placed(scan, recipe, corners) for corners in _squares(scan, recipe, dpi))
    if best is None or best.agreement < FOUND:
        row = _row(
            "recipe", "recipe", _read(scan),
            "this recipe's pattern, whole, with blank film around it", False,
            "scan the whole sticker at 600 dpi or more; is it this recipe?",
        )  # fmt: skip
        return PrintCheck(str(path), (row,), None)
    found = _found(recipe, best, dpi, halved)
    return PrintCheck(str(path), tuple(_rows(found, recipe, best, mirrored, scaled)), found, scaled)


@dataclass(frozen=True)
class _Placed:
    """Part of a scan, from the recipe's mm (x, y from its middle) to its px, and how it agrees."""

    scan: Image
    to_px: NDArray[np.float64]
    mirrored: bool
    agreement: float


def _best_of(places: Iterable[_Placed | None]) -> _Placed | None:
    """The one that agrees best, so that only one part of the scan is kept."""
    found = (place for place in places if place is not None)
    return max(found, key=lambda place: place.agreement, default=None)


def _read(scan: NDArray[np.uint8]) -> str:
    """What is there instead, as far as a code beside it tells."""
    text, *_ = cv2.QRCodeDetector().detectAndDecode(cv2.cvtColor(scan, cv2.COLOR_RGB2GRAY))
    return f"another one: {text}" if text else "not this recipe's pattern"


def _squares(
    scan: NDArray[np.uint8], recipe: PatternRecipe, dpi: float | None
) -> Iterator[NDArray[np.float64]]:
    """Corners (4, 2) in px of what may be a sticker, in order round it, the likeliest first."""
    side_px = max(scan.shape[:2])
    if dpi is not None:
        side_px = round(recipe.printed_mm * dpi / MM_PER_INCH)
    shrink = min(1.0, 400 / side_px)
    small = cv2.resize(scan, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
    small = small.astype(np.float32) / np.float32(255)
    for mask in _inked(small):
        closed = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((21, 21), np.uint8))
        opened = cv2.morphologyEx(closed, cv2.MORPH_OPEN, np.ones((31, 31), np.uint8))
        outlines, _ = cv2.findContours(opened, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
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


def _inked(small: Image) -> Iterator[NDArray[np.uint8]]:
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


def _placed(
    whole: NDArray[np.uint8], recipe: PatternRecipe, corners: NDArray[np.float64]
) -> _Placed | None:
    """The way round in which a square of a scan is most like the recipe, refined."""
    room = 0.1 * np.ptp(corners, axis=0)
    low = np.maximum(corners.min(axis=0) - room, 0).astype(int)
    high = (corners.max(axis=0) + room + 1).astype(int)
    scan = whole[low[1] : high[1], low[0] : high[0]].astype(np.float32) / np.float32(255)
    corners = corners - low
    if cv2.contourArea(corners.astype(np.float32), oriented=True) < 0:
        corners = corners[::-1]
    half = recipe.printed_mm / 2
    square = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    # In the middle, where corners that are a little off only shift it.
    side = int(min(1000, max(360, 2 * recipe.n)))
    step = recipe.printed_mm / side
    half_px = round(min(recipe.printed_mm, max(MIDDLE_MM, 24 * (recipe.patch_mm or 0))) / step / 2)
    middle = slice(side // 2 - half_px, side // 2 + half_px)
    rough = _drawn(recipe, side)[middle, middle]
    plain = _plain(recipe, side)[middle, middle]
    reach = min(round(ASIDE_MM / step), half_px - 1)
    pair_px = 2 * (recipe.patch_mm or 0) / step
    tried = []
    for mirrored in (False, True):
        order = corners[::-1] if mirrored else corners
        for k in range(4):
            fitted, _ = cv2.findHomography(square, np.roll(order, k, axis=0))
            to_px = np.asarray(fitted, np.float64)
            seen = _flat(scan, to_px, recipe, side)[middle, middle]
            tried.append((alike(seen, rough, plain, reach, pair_px)[0], mirrored, to_px))
    likely = sorted(tried, key=lambda one: -one[0])[:2]
    return _best_of(_refined(scan, recipe, to_px, mirrored) for _, mirrored, to_px in likely)


@lru_cache(maxsize=2)
def _drawn(recipe: PatternRecipe, side: int) -> Image:
    """The recipe's sticker in so many pixels; kept, for it is asked for at every refinement."""
    return albedo(recipe, recipe.printed_mm / side, (side, side))


def _plain(recipe: PatternRecipe, side: int) -> Image:
    """1 where the pattern alone is, 0 at marker dots, which look the same in every recipe."""
    if recipe.dots is None or recipe.patch_mm is None:
        return np.ones((side, side, 1), np.float32)
    step = recipe.printed_mm / side
    bare = albedo(recipe.model_copy(update={"dots": None}), step, (side, side))
    marked = np.abs(_drawn(recipe, side) - bare).max(axis=2) > 0.05
    wide = cv2.dilate(marked.astype(np.uint8), np.ones((7, 7), np.uint8))
    return (1 - wide[..., None]).astype(np.float32)


def _flat(scan: Image, to_px: NDArray[np.float64], recipe: PatternRecipe, side: int) -> Image:
    """The sticker in the recipe's frame, (side, side, 3)."""
    step = recipe.printed_mm / side
    grid = np.array([[step, 0, (step - recipe.printed_mm) / 2],
                     [0, step, (step - recipe.printed_mm) / 2], [0, 0, 1]])  # fmt: skip
    way = to_px @ grid
    # As many source pixels as one covers are averaged: else fine patches fold.
    pitch = math.sqrt(abs(np.linalg.det(way[:2, :2] / way[2, 2])))
    source = scan
    if pitch > 1.5:
        source = np.asarray(cv2.GaussianBlur(scan, (0, 0), pitch / 2.5), np.float32)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpPerspective(source, way, (side, side), flags=flags,
                                          borderMode=cv2.BORDER_REPLICATE), np.float32)  # fmt: skip


def alike(
    seen: Image, drawn: Image, where: Image, reach: int, pair_px: float
) -> tuple[float, tuple[int, int]]:
    """The best correlation of two pictures up to `reach` px apart, over colours, and the shift.

    where: (h, w, 1), what counts. The shift (x, y) is from drawn to seen.

    Of means over two patches (pair_px): neighbours that must differ are nearly a chessboard, which
    all such recipes share.
    """
    k = max(1, round(pair_px))
    seen, drawn = (np.asarray(cv2.blur(one, (k, k)), np.float32) for one in (seen, drawn))
    spectrum = np.zeros((len(seen), seen.shape[1] // 2 + 1), complex)
    for c in range(3):
        a, b = ((one[..., c] - one[..., c].mean()) * where[..., 0] for one in (seen, drawn))
        norm = float(np.linalg.norm(a) * np.linalg.norm(b))
        if norm > 0:
            spectrum = spectrum + np.fft.rfft2(a) * np.conj(np.fft.rfft2(b)) / norm
    found = np.fft.irfft2(spectrum, seen.shape[:2]) / 3
    near = np.roll(found, (reach, reach), (0, 1))[: 2 * reach + 1, : 2 * reach + 1]
    y, x = np.unravel_index(np.argmax(near), near.shape)
    return float(near[y, x]), (int(x) - reach, int(y) - reach)


def _side_px(recipe: PatternRecipe) -> int:
    fine = recipe.patch_mm or recipe.printed_mm / 400
    return int(min(MOST_PX, max(400, PX_A_PATCH * recipe.printed_mm / fine)))


def _refined(
    scan: Image, recipe: PatternRecipe, to_px: NDArray[np.float64], mirrored: bool
) -> _Placed | None:
    """The map with every tile where it lies, and how the whole agrees then."""
    for side in (_side_px(recipe) // 2, _side_px(recipe), _side_px(recipe), _side_px(recipe)):
        drawn = _drawn(recipe, side)
        seen = _flat(scan, to_px, recipe, side)
        # One ink: a mean of inks that lie apart is no pattern of any.
        c = int(np.argmax(seen.std(axis=(0, 1)) * (drawn.std(axis=(0, 1)) > 0)))
        middles, off, told = _moves_mm(seen[..., c], drawn[..., c], recipe, side)
        good = told > TOLD
        if good.sum() < max(8, 0.2 * len(told)):
            return None
        there = cv2.perspectiveTransform((middles + off)[None, good], to_px)[0]
        fitted, _ = cv2.findHomography(middles[good], there, cv2.RANSAC, 2.0)
        if fitted is None:
            return None
        to_px = np.asarray(fitted, np.float64)
    pair_px = 2 * (recipe.patch_mm or 0) * side / recipe.printed_mm
    seen, plain = _flat(scan, to_px, recipe, side), _plain(recipe, side)
    return _Placed(scan, to_px, mirrored, alike(seen, drawn, plain, 2, pair_px)[0])


def tiles(
    shape: tuple[int, ...], size: int
) -> Iterator[tuple[tuple[slice, slice], NDArray[np.float64]]]:
    """Whole tiles of a picture: rows and columns, and the middle (x, y) in px."""
    for top in range(0, shape[0] - size + 1, size):
        for left in range(0, shape[1] - size + 1, size):
            middle = np.array([left + size / 2, top + size / 2])
            yield (slice(top, top + size), slice(left, left + size)), middle


def _moves_mm(
    seen: NDArray[Any], drawn: NDArray[Any], recipe: PatternRecipe, side: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """As `moves` of a whole sticker, in mm from its middle."""
    step = recipe.printed_mm / side
    middles, off, told = moves(seen, drawn, max(32, round(TILE_MM / step)))
    return middles * step - recipe.printed_mm / 2, off * step, told


def moves(
    seen: NDArray[Any], drawn: NDArray[Any], size: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Tiles: their middles and by how much they lie off, in px (n, 2), and the peak's response."""
    window = cv2.createHanningWindow((size, size), cv2.CV_64F)
    middles, off, told = [], [], []
    for cut, middle_px in tiles(seen.shape, size):
        a, b = drawn[cut].astype(np.float64), seen[cut].astype(np.float64)
        (x, y), response = cv2.phaseCorrelate(a - a.mean(), b - b.mean(), window)
        middles.append(middle_px)
        off.append((x, y))
        told.append(response)
    return np.array(middles), np.array(off), np.array(told)


def _found(recipe: PatternRecipe, placed: _Placed, dpi: float | None, halved: bool) -> PrintFound:
    side = _side_px(recipe)
    drawn = _drawn(recipe, side)
    seen = _flat(placed.scan, placed.to_px, recipe, side)
    # A scan's pixel, and the line between two of them: a box and a triangle.
    long_px = math.sqrt(abs(np.linalg.det(placed.to_px[:2, :2]))) * recipe.printed_mm
    drawn = np.asarray(cv2.GaussianBlur(drawn, (0, 0), max(0.5 * side / long_px, 1e-3)), np.float32)
    centre = cv2.perspectiveTransform(
        np.array([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]]), placed.to_px
    )[0]
    x, y = (centre[1] - centre[3]) / 2, (centre[2] - centre[4]) / 2
    long_x, long_y = float(np.hypot(*x)), float(np.hypot(*y))
    scale = None
    if dpi is not None:
        per_mm = dpi / MM_PER_INCH
        scale = long_x / per_mm, long_y / per_mm
    inks = []
    for c in range(3):
        _, off, told = _moves_mm(seen[..., c], drawn[..., c], recipe, side)
        good = told > TOLD
        inks.append(np.median(off[good], axis=0) if good.any() else np.zeros(2))
        # Each ink is judged where it lies.
        x_px, y_px = inks[-1] * side / recipe.printed_mm
        back = np.array([[1, 0, -x_px], [0, 1, -y_px]])
        seen[..., c] = cv2.warpAffine(
            seen[..., c], back, (side, side), borderMode=cv2.BORDER_REPLICATE
        )
    contrast = [_gain(seen[..., c], drawn[..., c]) for c in range(3)]
    off_um = 1000 * (np.array(inks) - np.mean(inks, axis=0))
    share = kept(seen * 255, drawn * 255, drawn * 255) or 0.0
    return PrintFound(
        mirrored=placed.mirrored,
        turned_deg=math.degrees(math.atan2(-x[1], -x[0] if placed.mirrored else x[0])),
        scale=scale,
        shear=float(abs(x @ y) / (long_x * long_y)),
        contrast=(contrast[0], contrast[1], contrast[2]),
        kept=share,
        in_order=_in_order(seen, recipe),
        ink_um=tuple((float(u), float(v)) for u, v in off_um),
        gaps_mm=_gaps(seen, drawn, recipe),
        dots=_dots(seen, recipe),
        spread_um=_spread_um(recipe, share),
        misregistration_um=float(np.sqrt(np.mean(off_um**2))),
        halved=halved,
    )


def _gain(seen: NDArray[Any], drawn: NDArray[Any]) -> float:
    """Contrast of one ink as a share of the recipe's; 1 where it has none."""
    a, b = drawn - drawn.mean(), seen - seen.mean()
    own = float((a * a).mean())
    return float((a * b).mean()) / own if own > 0 else 1.0


def _in_order(seen: Image, recipe: PatternRecipe) -> float | None:
    """Share of neighbouring patches of which the lighter one is the lighter one, a colour each."""
    if recipe.patch_mm is None or recipe.n < 3:
        return None
    patches = draw_patches(recipe).astype(np.float32)
    means = cv2.resize(seen, (recipe.n, recipe.n), interpolation=cv2.INTER_AREA)
    right = whole = 0
    for axis in (0, 1):
        want, have = np.diff(patches, axis=axis), np.diff(means, axis=axis)
        told = np.abs(want) >= 64
        whole += int(told.sum())
        right += int((np.sign(want) == np.sign(have))[told].sum())
    return right / whole if whole else None


def _gaps(seen: Image, drawn: Image, recipe: PatternRecipe) -> tuple[tuple[float, float], ...]:
    """Middles (mm) of tiles that have half of the contrast of the others, or less."""
    side = len(seen)
    step = recipe.printed_mm / side
    size = max(16, round(TILE_MM / 2 / step))
    places, shares = [], []
    for cut, middle_px in tiles(seen.shape, size):
        own = kept(seen[cut], drawn[cut], drawn[cut])
        if own is not None:
            places.append((middle_px * step).tolist())
            shares.append(own)
    least = GAP_SHARE * float(np.median(shares))
    half = recipe.printed_mm / 2
    return tuple(
        (round(x - half, 2), round(y - half, 2))
        for (x, y), share in zip(places, shares, strict=True)
        if share < least
    )


def _dots(seen: Image, recipe: PatternRecipe) -> tuple[int, int] | None:
    """Marker dots that stand out from what is around them, and how many there should be."""
    if recipe.dots is None:
        return None
    step = recipe.printed_mm / len(seen)
    reach = math.ceil(1.4 * recipe.dots.diameter_mm / step)
    far = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1]) * step
    radius = recipe.dots.diameter_mm / 2
    off = np.abs(seen - np.array(recipe.dots.rgb) / 255).mean(axis=2)
    inside, beside = (
        cv2.filter2D(off, -1, where / where.sum())
        for where in (far < 0.7 * radius, (far > 1.4 * radius) & (far < 2.8 * radius))
    )
    x, y = np.rint(to_px(centres_mm(recipe.dots), step, off.shape)).astype(int).T
    return int((inside[y, x] < DOT_SHARE * beside[y, x]).sum()), len(x)


def _spread_um(recipe: PatternRecipe, share: float) -> float:
    """The spread at which the printer's model keeps that share of a recipe's contrast."""
    if recipe.patch_mm is None:
        return 0.0
    fine = recipe.patch_mm / 8
    px = min(512, round(recipe.printed_mm / fine))
    drawn = albedo(recipe, fine, (px, px))
    inked = [c for c in range(3) if drawn[..., c].std() > 0]
    spreads = np.linspace(0.0, 1.5 * recipe.patch_mm, 16)
    shares = []
    for spread in spreads:
        blurred = cv2.GaussianBlur(drawn, (0, 0), max(spread / 2 / fine, 1e-3))
        shares.append(float(np.mean([_gain(blurred[..., c], drawn[..., c]) for c in inked])))
    return float(1000 * np.interp(-share, -np.array(shares), spreads))


def _row(id: str, name: str, found: str, limit: str, passed: bool, remedy: str = "") -> Check:
    return Check(id, name, "", found, limit, graded(passed), remedy=remedy)


def _rows(
    found: PrintFound, recipe: PatternRecipe, placed: _Placed, mirrored: bool,
    scaled: tuple[float, float],
) -> Iterator[Check]:  # fmt: skip
    agrees = f"found, agreement {placed.agreement:.2f}"
    yield _row("recipe", "recipe", agrees, f">= {FOUND:g}", True)
    way = {False: "not mirrored", True: "mirrored"}
    yield _row(
        "mirror", "mirror", way[found.mirrored], way[mirrored], found.mirrored == mirrored,
        "print with the other --transfer, or name the one that was used",
    )  # fmt: skip
    if found.scale is None:
        what = "unknown from a photograph; scan it on a flatbed"
        yield Check("scale", "scale and shear", "", what, "not judged", "not run")
    else:
        for axis, scale, was in zip("xy", found.scale, scaled, strict=True):
            yield _row(
                f"scale.{axis}", f"scale, {axis}", f"{scale:.4f}", f"1 +- {SCALE_OFF:g}",
                abs(scale - 1) <= SCALE_OFF,
                f"print again with --scale-{axis} {was / scale:.4f}, and no scaling in the viewer",
            )  # fmt: skip
        yield _row(
            "shear", "shear", f"{found.shear:.4f}", f"<= {SHEAR_OFF:g}", found.shear <= SHEAR_OFF,
            "the paper was fed at an angle, or the film was not flat on the scanner",
        )  # fmt: skip
    if found.in_order is not None:
        yield _row(
            "resolution", "patches resolved",
            f"{100 * found.in_order:.1f} % of neighbours in order",
            f">= {100 * IN_ORDER:g} %", found.in_order >= IN_ORDER,
            "use a larger patch or a printer with a higher resolution",
        )  # fmt: skip
    if found.halved:
        yield Check("contrast", "contrast and inks", "", HALVED, "not judged", "not run")
    else:
        yield _row(
            "contrast", "contrast kept", f"{found.kept:.2f}",
            f">= {PRINTED_SHARE:g} of the recipe's",
            found.kept >= PRINTED_SHARE, "use the finest setting, matt film, or a larger patch",
        )  # fmt: skip
        weakest = min(found.contrast) / max(max(found.contrast), 1e-9)
        shown = ", ".join(f"{c:.2f}" for c in found.contrast)
        yield _row(
            "inks", "inks", f"contrast of R, G, B {shown}",
            f"the weakest >= {INK_SHARE:g} of the best",
            weakest >= INK_SHARE, "an ink is missing or nearly empty: clean the head, change it",
        )  # fmt: skip
    most_um = 500 * (recipe.patch_mm or 0.15)
    worst_um = max(math.hypot(u, v) for u, v in found.ink_um)
    yield _row(
        "misregistration", "misregistration of inks", f"{worst_um:.0f} um",
        f"<= {most_um:.0f} um, half a patch",
        worst_um <= most_um, "align the print heads",
    )  # fmt: skip
    where = "; ".join(f"({x:g}, {y:g})" for x, y in found.gaps_mm[:4])
    yield _row(
        "gaps", "gaps", f"{len(found.gaps_mm)} tiles: {where} mm" if where else "none", "none",
        not found.gaps_mm, "a clogged nozzle or a scratch: clean the head, print again",
    )  # fmt: skip
    if found.dots is not None:
        there, whole = found.dots
        yield _row(
            "dots", "marker dots", f"{there} of {whole}", "all", there == whole,
            "a white dot is bare film: look for ink or dirt there",
        )  # fmt: skip
