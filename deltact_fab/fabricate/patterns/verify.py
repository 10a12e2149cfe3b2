"""A print against its recipe: is it right, how large is it, what did the printer do to it.

The positions of its tiles (`locate`) give scale, shear and the registration of the inks; their
content gives contrast, order and gaps. Scale needs the dpi of a flatbed scan, which a photograph
does not have.

The averaging by the scan's pixels is modelled. Blur by the lens or by a film out of focus is
attributed to the printer.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import MM_PER_INCH, Check, InputError, graded, read_toml, validate
from deltact_fab.sensor import Bounded, Printer, bounded_number

from .dots import to_px
from .locate import LEAST_AGREEMENT, LEAST_RESPONSE, Placement, StickerFrame, locate_in_scan, tiles
from .metadata import opened
from .quality.measure import PRINTED_SHARE, kept
from .raster import pattern_albedo
from .recipe import PatternRecipe

GAP_TILE_MM = 1.5
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

    scale_x: float = bounded_number(1.0, "stretch in x by which a sheet comes out right", 0.5, 2)
    scale_y: float = bounded_number(1.0, "the same in y", 0.5, 2)
    spread_um: float = bounded_number(Printer.spread_um, "spread of the ink, two sigma", 0, 2000)
    misregistration_um: float = bounded_number(
        Printer.misregistration_um, "by which inks lie apart, one sigma", 0, 2000
    )


def load_printer(path: Path) -> KnownPrinter:
    """The file of `pattern verify -o`. Raises InputError naming file and key."""
    return validate(KnownPrinter, read_toml(path), str(path))


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
        return not any(row.failed for row in self.rows)

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


def verify_print(
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
    best = locate_in_scan(scan, recipe, dpi)
    if best is None:
        row = _row(
            "recipe", "recipe", _read(scan),
            "this recipe's pattern, whole, with blank film around it", False,
            "scan the whole sticker at 600 dpi or more; is it this recipe?",
        )  # fmt: skip
        return PrintCheck(str(path), (row,), None)
    found = _found(recipe, best, dpi, halved)
    return PrintCheck(str(path), tuple(_rows(found, recipe, best, mirrored, scaled)), found, scaled)


def _read(scan: NDArray[np.uint8]) -> str:
    """What is there instead, as far as a code beside it tells."""
    text, *_ = cv2.QRCodeDetector().detectAndDecode(cv2.cvtColor(scan, cv2.COLOR_RGB2GRAY))
    return f"another one: {text}" if text else "not this recipe's pattern"


def _found(recipe: PatternRecipe, placed: Placement, dpi: float | None, halved: bool) -> PrintFound:
    frame = StickerFrame.finest(recipe)
    side, drawn = frame.side_px, frame.drawn
    seen = frame.flatten(placed.image, placed.to_px)
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
        _, shift_mm, response = frame.shifts_mm(seen[..., c], drawn[..., c])
        good = response > LEAST_RESPONSE
        inks.append(np.median(shift_mm[good], axis=0) if good.any() else np.zeros(2))
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


def _in_order(seen: NDArray[np.float32], recipe: PatternRecipe) -> float | None:
    """Share of neighbouring patches of which the lighter one is the lighter one, a colour each."""
    if recipe.patch_mm is None or recipe.n < 3:
        return None
    patches = recipe.patches().astype(np.float32)
    means = cv2.resize(seen, (recipe.n, recipe.n), interpolation=cv2.INTER_AREA)
    right = whole = 0
    for axis in (0, 1):
        want, have = np.diff(patches, axis=axis), np.diff(means, axis=axis)
        told = np.abs(want) >= 64
        whole += int(told.sum())
        right += int((np.sign(want) == np.sign(have))[told].sum())
    return right / whole if whole else None


def _gaps(
    seen: NDArray[np.float32], drawn: NDArray[np.float32], recipe: PatternRecipe
) -> tuple[tuple[float, float], ...]:
    """Middles (mm) of tiles that have half of the contrast of the others, or less."""
    side = len(seen)
    step = recipe.printed_mm / side
    size = max(16, round(GAP_TILE_MM / step))
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


def _dots(seen: NDArray[np.float32], recipe: PatternRecipe) -> tuple[int, int] | None:
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
    x, y = np.rint(to_px(recipe.dots.centres_mm(), step, off.shape)).astype(int).T
    return int((inside[y, x] < DOT_SHARE * beside[y, x]).sum()), len(x)


def _spread_um(recipe: PatternRecipe, share: float) -> float:
    """The spread at which the printer's model keeps that share of a recipe's contrast."""
    if recipe.patch_mm is None:
        return 0.0
    fine = recipe.patch_mm / 8
    px = min(512, round(recipe.printed_mm / fine))
    drawn = pattern_albedo(recipe, fine, (px, px))
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
    found: PrintFound, recipe: PatternRecipe, placed: Placement, mirrored: bool,
    scaled: tuple[float, float],
) -> Iterator[Check]:  # fmt: skip
    agrees = f"found, agreement {placed.agreement:.2f}"
    yield _row("recipe", "recipe", agrees, f">= {LEAST_AGREEMENT:g}", True)
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
