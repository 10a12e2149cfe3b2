"""Compare a print with its recipe: identity, scale, and effects of the printer.

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
from .locate import MIN_AGREEMENT, MIN_RESPONSE, Placement, StickerFrame, locate_in_scan, tiles
from .metadata import open_image
from .quality.measure import PRINTED_SHARE, contrast_share
from .raster import pattern_albedo
from .recipe import PatternRecipe

# Limits of decision 0071, by hand: tighter refuses usable prints, looser passes faults.
SCALE_TOL, SHEAR_TOL = 0.002, 0.002
# Agreement and saturation of colours. Measured on simulated scans: casts, leaking inks and half the
# saturation 0.95 and more, 0.4 and more; grey 0, 0; exchanged inks below 0.
MIN_CHROMA, MIN_SATURATION = 0.5, 0.25
LEAST_CHROMA = 0.02  # by hand, spread of a recipe's colours: less is a grey recipe
DPI_ERROR = 1.25  # by hand: a wrong dpi is off by more, a printer's scale by less
MIN_IN_ORDER = 0.8  # share of neighbouring patches in order; 0.5 by chance
INK_SHARE, GAP_SHARE, DOT_SHARE = 0.5, 0.5, 0.5  # contrast over best ink, median tile, surroundings
GAP_TILE_MM, SCAN_DPI_RANGE = 1.5, (50.0, 9600.0)  # smaller tiles are noisier; dpi of scanners
NOT_LOCATED = "pattern not located"
NO_DPI = "no dpi in the file; give --dpi"
HALVED_COLOUR = "JPEG with halved colour resolution: scan as PNG or TIFF"


@dataclass(frozen=True)
class PrintMeasurement:
    """A measured sticker. scale: its sides (x, y) over the recipe's, None in a photograph.

    shear: tangent of the axes' deviation from a right angle. turned_deg: counter-clockwise in the
    scan. ink_um: offsets of R, G, B from their mean, (3, 2). contrast: of R, G, B over the
    recipe's. chroma: agreement and saturation of the colours (`_measure_chroma`). gaps_mm: centres
    of tiles without ink. spread_um: ink spread at which the printer model of `pattern quality`
    keeps as much contrast. halved: the file's colours have half its resolution, so contrast and
    inks are not judged.
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
    chroma: tuple[float, float] | None = None


@dataclass(frozen=True)
class KnownPrinter(Bounded):
    """A printer measured on its own print: the file of `pattern verify -o`."""

    scale_x: float = bounded_number(1.0, "scale of a sheet in x that corrects the print", 0.5, 2)
    scale_y: float = bounded_number(1.0, "the same in y", 0.5, 2)
    spread_um: float = bounded_number(Printer.spread_um, "spread of the ink, two sigma", 0, 2000)
    misregistration_um: float = bounded_number(
        Printer.misregistration_um, "misregistration of the inks, one sigma", 0, 2000
    )


def load_printer(path: Path) -> KnownPrinter:
    """Load the file of `pattern verify -o`. Raises InputError naming file and key."""
    return validate(KnownPrinter, read_toml(path), str(path))


@dataclass(frozen=True)
class PrintCheck:
    """Result of `verify_print`: rows, the worst of which is the verdict, and the measurement.

    scaled: scale correction the sheet was written with.
    """

    scan: str
    rows: tuple[Check, ...]
    measured: PrintMeasurement | None
    scaled: tuple[float, float] = (1.0, 1.0)

    @property
    def passed(self) -> bool:
        """True if no row fails."""
        return not any(row.failed for row in self.rows)

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as `pattern verify --json` prints it."""
        return {
            "passed": self.passed, "scan": self.scan, "scaled": self.scaled,
            "found": None if self.measured is None else asdict(self.measured),
            "checks": [row.as_dict() for row in self.rows],
        }  # fmt: skip

    def printer(self) -> KnownPrinter:
        """Return the printer measured on the print.

        Raises InputError for a photograph, wrong colours, and another recipe's print.
        """
        measured = self.measured
        if measured is None or measured.scale is None:
            raise InputError(f"{self.scan}: no scale: use a flatbed scan with a dpi")
        if measured.halved:
            raise InputError(f"{self.scan}: {HALVED_COLOUR}")
        if wrong := [row for row in self.rows if row.failed and row.id == "colour"]:
            raise InputError(f"{self.scan}: colour: {wrong[0].value}; {wrong[0].remedy}")
        x, y = (old / scale for old, scale in zip(self.scaled, measured.scale, strict=True))
        return KnownPrinter(x, y, measured.spread_um, measured.misregistration_um)


def load_scan(path: Path, dpi: float | None = None) -> tuple[NDArray[np.uint8], float | None, bool]:
    """Load an image (h, w, 3) RGB, its dpi, and True for halved colours (JPEG 4:2:0).

    dpi: overrides the file's; None if neither is known. Raises InputError for a file that is no
    image, and for a dpi out of range.
    """
    low, high = SCAN_DPI_RANGE
    if dpi is not None and not low <= dpi <= high:
        raise InputError(f"--dpi {dpi:g}: expected {low:g} to {high:g}")
    from PIL.JpegImagePlugin import get_sampling

    with open_image(path) as image:
        file_dpi = image.info.get("dpi")
        halved = image.format == "JPEG" and get_sampling(image) not in (-1, 0)
        rgb = np.asarray(image.convert("RGB"))
    if dpi is None and file_dpi is not None and 100 <= float(file_dpi[0]) == float(file_dpi[1]):
        dpi = float(file_dpi[0])
    return rgb, dpi, halved


def verify_print(
    path: Path,
    recipe: PatternRecipe,
    dpi: float | None = None,
    mirrored: bool = False,
    scaled: tuple[float, float] = (1.0, 1.0),
) -> PrintCheck:
    """Compare a scan or photograph of a print with its recipe.

    dpi: of the scan, instead of the file's. mirrored: expected orientation (`slide`). scaled:
    scale correction of the sheet. Raises InputError for an unusable file, for a dpi that does not
    fit the print, and for a recipe of one colour.
    """
    if recipe.patch_mm is None and recipe.dots is None:
        raise InputError(f"{recipe.law}: one uniform colour, nothing to compare")
    scan, dpi, halved = load_scan(path, dpi)
    best = locate_in_scan(scan, recipe, dpi)
    if best is None and dpi is not None:
        best = locate_in_scan(scan, recipe, None)
    if best is None:
        row = _row(
            "recipe", "recipe", _identify_print(scan, dpi),
            "this recipe's whole pattern, with blank film around it", False,
            "scan the whole sticker at 600 dpi or more; is it this recipe?",
        )  # fmt: skip
        return PrintCheck(str(path), (row,), None)
    measured = _measure_print(recipe, best, dpi, halved)
    if dpi is not None and measured.scale is not None:
        times = math.sqrt(measured.scale[0] * measured.scale[1])
        if not 1 / DPI_ERROR <= times <= DPI_ERROR:
            raise InputError(
                f"{path}: dpi {dpi:g}: the print would be {times:.3g} times its size; about "
                f"{dpi * times:.0f} fits: give --dpi"
            )
    rows = tuple(_rows(measured, recipe, best, mirrored, scaled))
    return PrintCheck(str(path), rows, measured, scaled)


def _identify_print(scan: NDArray[np.uint8], dpi: float | None) -> str:
    """Describe an image in which the recipe was not located, with its QR code, if any."""
    if dpi is None:
        return f"{NOT_LOCATED}: {NO_DPI}"
    text, *_ = cv2.QRCodeDetector().detectAndDecode(cv2.cvtColor(scan, cv2.COLOR_RGB2GRAY))
    return f"{NOT_LOCATED}; QR code: {text}" if text else NOT_LOCATED


def _measure_print(
    recipe: PatternRecipe, placement: Placement, dpi: float | None, halved: bool
) -> PrintMeasurement:
    frame = StickerFrame.finest(recipe)
    side, template = frame.side_px, frame.template
    image = frame.flatten(placement.image, placement.to_px)
    # Blur of the scan: pixel area (box) and interpolation (triangle).
    long_px = math.sqrt(abs(np.linalg.det(placement.to_px[:2, :2]))) * recipe.printed_mm
    blur_px = max(0.5 * side / long_px, 1e-3)
    template = np.asarray(cv2.GaussianBlur(template, (0, 0), blur_px), np.float32)
    centre = cv2.perspectiveTransform(
        np.array([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]]), placement.to_px
    )[0]
    x, y = (centre[1] - centre[3]) / 2, (centre[2] - centre[4]) / 2
    long_x, long_y = float(np.hypot(*x)), float(np.hypot(*y))
    scale = None
    if dpi is not None:
        per_mm = dpi / MM_PER_INCH
        scale = long_x / per_mm, long_y / per_mm
    inks = []
    for c in range(3):
        _, shift_mm, response = frame.shifts_mm(image[..., c], template[..., c])
        good = response > MIN_RESPONSE
        inks.append(np.median(shift_mm[good], axis=0) if good.any() else np.zeros(2))
        # Undo the shift of this ink.
        x_px, y_px = inks[-1] * side / recipe.printed_mm
        back = np.array([[1, 0, -x_px], [0, 1, -y_px]])
        image[..., c] = cv2.warpAffine(
            image[..., c], back, (side, side), borderMode=cv2.BORDER_REPLICATE
        )
    contrast = [_gain(image[..., c], template[..., c]) for c in range(3)]
    offset_um = 1000 * (np.array(inks) - np.mean(inks, axis=0))
    share = contrast_share(image * 255, template * 255, template * 255) or 0.0
    return PrintMeasurement(
        mirrored=placement.mirrored,
        turned_deg=math.degrees(math.atan2(-x[1], -x[0] if placement.mirrored else x[0])),
        scale=scale,
        shear=float(abs(x @ y) / (long_x * long_y)),
        contrast=(contrast[0], contrast[1], contrast[2]),
        kept=share,
        in_order=_share_in_order(image, recipe),
        ink_um=tuple((float(u), float(v)) for u, v in offset_um),
        gaps_mm=_find_gaps(image, template, recipe),
        dots=_count_dots(image, recipe),
        spread_um=_spread_um(recipe, share),
        misregistration_um=float(np.sqrt(np.mean(offset_um**2))),
        halved=halved,
        chroma=_measure_chroma(image, template, frame.pair_px),
    )


def _gain(image: NDArray[Any], template: NDArray[Any]) -> float:
    """Contrast of one ink over the recipe's; 1 if it has none."""
    a, b = template - template.mean(), image - image.mean()
    power = float((a * a).mean())
    return float((a * b).mean()) / power if power > 0 else 1.0


def _measure_chroma(
    image: NDArray[Any], template: NDArray[Any], pair_px: float
) -> tuple[float, float] | None:
    """Return agreement and saturation of the colours; None for a grey recipe.

    Agreement: worst correlation over channels of each channel less the mean of the channels.
    Saturation: contrast of these over that of the mean, both over the recipe's. Averaged over two
    patches, as halved colours are.
    """
    k = max(1, round(pair_px))
    chroma, grey = [], []
    for picture in (image, template):
        flat = cv2.blur(np.ascontiguousarray(picture), (k, k))
        mean = flat.mean(axis=2, keepdims=True)
        chroma.append(flat - mean - (flat - mean).mean(axis=(0, 1)))
        grey.append(mean)
    measured, designed = chroma
    if float(designed.std()) < LEAST_CHROMA:
        return None
    product = (measured * designed).mean(axis=(0, 1))
    norm = np.sqrt((measured**2).mean(axis=(0, 1)) * (designed**2).mean(axis=(0, 1)))
    gain = float(product.sum() / (designed**2).mean(axis=(0, 1)).sum())
    saturation = gain / max(_gain(*grey), 1e-9)
    return float(np.min(product / np.maximum(norm, 1e-12))), saturation


def _share_in_order(image: NDArray[np.float32], recipe: PatternRecipe) -> float | None:
    """Share of neighbouring patches, per colour, whose order of lightness is right."""
    if recipe.patch_mm is None or recipe.n < 3:
        return None
    patches = recipe.patches().astype(np.float32)
    means = cv2.resize(image, (recipe.n, recipe.n), interpolation=cv2.INTER_AREA)
    correct = total = 0
    for axis in (0, 1):
        expected, actual = np.diff(patches, axis=axis), np.diff(means, axis=axis)
        clear = np.abs(expected) >= 64
        total += int(clear.sum())
        correct += int((np.sign(expected) == np.sign(actual))[clear].sum())
    return correct / total if total else None


def _find_gaps(
    image: NDArray[np.float32], template: NDArray[np.float32], recipe: PatternRecipe
) -> tuple[tuple[float, float], ...]:
    """Centres, mm, of tiles with less than GAP_SHARE of the median contrast."""
    side = len(image)
    step = recipe.printed_mm / side
    size = max(16, round(GAP_TILE_MM / step))
    places, shares = [], []
    for cut, middle_px in tiles(image.shape, size):
        contrast = contrast_share(image[cut], template[cut], template[cut])
        if contrast is not None:
            places.append((middle_px * step).tolist())
            shares.append(contrast)
    limit = GAP_SHARE * float(np.median(shares))
    half = recipe.printed_mm / 2
    return tuple(
        (round(x - half, 2), round(y - half, 2))
        for (x, y), share in zip(places, shares, strict=True)
        if share < limit
    )


def _count_dots(image: NDArray[np.float32], recipe: PatternRecipe) -> tuple[int, int] | None:
    """Count marker dots that stand out from their surroundings, and expected dots."""
    if recipe.dots is None:
        return None
    step = recipe.printed_mm / len(image)
    reach = math.ceil(1.4 * recipe.dots.diameter_mm / step)
    distance = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1]) * step
    radius = recipe.dots.diameter_mm / 2
    difference = np.abs(image - np.array(recipe.dots.rgb) / 255).mean(axis=2)
    inner, ring = (
        cv2.filter2D(difference, -1, mask / mask.sum())
        for mask in (distance < 0.7 * radius, (distance > 1.4 * radius) & (distance < 2.8 * radius))
    )
    x, y = np.rint(to_px(recipe.dots.centres_mm(), step, difference.shape)).astype(int).T
    return int((inner[y, x] < DOT_SHARE * ring[y, x]).sum()), len(x)


def _spread_um(recipe: PatternRecipe, share: float) -> float:
    """Ink spread at which the printer model keeps that share of a recipe's contrast."""
    if recipe.patch_mm is None:
        return 0.0
    fine = recipe.patch_mm / 8
    px = min(512, round(recipe.printed_mm / fine))
    template = pattern_albedo(recipe, fine, (px, px))
    inked = [c for c in range(3) if template[..., c].std() > 0]
    spreads = np.linspace(0.0, 1.5 * recipe.patch_mm, 16)
    shares = []
    for spread in spreads:
        blurred = cv2.GaussianBlur(template, (0, 0), max(spread / 2 / fine, 1e-3))
        shares.append(float(np.mean([_gain(blurred[..., c], template[..., c]) for c in inked])))
    return float(1000 * np.interp(-share, -np.array(shares), spreads))


def _row(id: str, name: str, measured: str, limit: str, passed: bool, remedy: str = "") -> Check:
    return Check(id, name, "", measured, limit, graded(passed), remedy=remedy)


def _rows(
    measured: PrintMeasurement, recipe: PatternRecipe, placement: Placement, mirrored: bool,
    scaled: tuple[float, float],
) -> Iterator[Check]:  # fmt: skip
    agrees = f"found, agreement {placement.agreement:.2f}"
    yield _row("recipe", "recipe", agrees, f">= {MIN_AGREEMENT:g}", True)
    wording = {False: "not mirrored", True: "mirrored"}
    yield _row(
        "mirror", "mirror", wording[measured.mirrored], wording[mirrored],
        measured.mirrored == mirrored,
        "print with the other --transfer, or name the one that was used",
    )  # fmt: skip
    if measured.scale is None:
        reason = "unknown from a photograph; scan it on a flatbed"
        yield Check("scale", "scale and shear", "", reason, "not checked", "not run")
    else:
        for axis, scale, old in zip("xy", measured.scale, scaled, strict=True):
            yield _row(
                f"scale.{axis}", f"scale, {axis}", f"{scale:.4f}", f"1 +- {SCALE_TOL:g}",
                abs(scale - 1) <= SCALE_TOL,
                f"print again with --scale-{axis} {old / scale:.4f}, and no scaling in the viewer",
            )  # fmt: skip
        yield _row(
            "shear", "shear", f"{measured.shear:.4f}", f"<= {SHEAR_TOL:g}",
            measured.shear <= SHEAR_TOL,
            "the paper was fed at an angle, or the film was not flat on the scanner",
        )  # fmt: skip
    if measured.in_order is not None:
        yield _row(
            "resolution", "patches resolved",
            f"{100 * measured.in_order:.1f} % of neighbours in order",
            f">= {100 * MIN_IN_ORDER:g} %", measured.in_order >= MIN_IN_ORDER,
            "use a larger patch or a printer with a higher resolution",
        )  # fmt: skip
    if measured.halved:
        yield Check("contrast", "contrast and inks", "", HALVED_COLOUR, "not checked", "not run")
    else:
        yield _row(
            "contrast", "contrast kept", f"{measured.kept:.2f}",
            f">= {PRINTED_SHARE:g} of the recipe's",
            measured.kept >= PRINTED_SHARE, "use the finest setting, matt film, or a larger patch",
        )  # fmt: skip
        weakest = min(measured.contrast) / max(max(measured.contrast), 1e-9)
        contrasts = ", ".join(f"{c:.2f}" for c in measured.contrast)
        yield _row(
            "inks", "inks", f"contrast of R, G, B {contrasts}",
            f"the weakest >= {INK_SHARE:g} of the best",
            weakest >= INK_SHARE, "an ink is missing or nearly empty: clean the head, change it",
        )  # fmt: skip
    limit_um = 500 * (recipe.patch_mm or 0.15)
    worst_um = max(math.hypot(u, v) for u, v in measured.ink_um)
    yield _row(
        "misregistration", "misregistration of inks", f"{worst_um:.0f} um",
        f"<= {limit_um:.0f} um, half a patch",
        worst_um <= limit_um, "align the print heads",
    )  # fmt: skip
    centres = "; ".join(f"({x:g}, {y:g})" for x, y in measured.gaps_mm[:4])
    yield _row(
        "gaps", "gaps", f"{len(measured.gaps_mm)} tiles: {centres} mm" if centres else "none",
        "none", not measured.gaps_mm, "a clogged nozzle or a scratch: clean the head, print again",
    )  # fmt: skip
    if measured.dots is not None:
        visible, total = measured.dots
        yield _row(
            "dots", "marker dots", f"{visible} of {total}", "all", visible == total,
            "a white dot is bare film: look for ink or dirt there",
        )  # fmt: skip
    if measured.chroma is not None:
        agreement, saturation = measured.chroma
        yield _row(
            "colour", "colour", f"agreement {agreement:.2f}, saturation {saturation:.2f}",
            f">= {MIN_CHROMA:g}, >= {MIN_SATURATION:g}",
            agreement >= MIN_CHROMA and saturation >= MIN_SATURATION,
            "print and scan in colour, RGB, with colour management off",
        )  # fmt: skip
