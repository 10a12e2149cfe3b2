"""Trackability of a pattern before and after printing and photographing.

Before: the designed colours, averaged over camera pixels. After: rasterised, printed, averaged over
camera pixels and exposed by the model of `imaging`, whose values are assumed. Lens distortion and
vignetting belong to the camera and are not modelled; the mean falloff of light is, because it sets
the noise. Both cover the middle of the sticker: the camera's view, or what the sticker or the
number of printer dots allows (`field_mm`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import MM_PER_INCH, Array, InputError
from deltact_fab.sensor import CAMERA_GAMMA, ImageSensor, Printer, SensorDimensions

from ..raster import cell_means, finest_mm, pattern_albedo, raster_window
from ..recipe import PatternRecipe
from .figures import Figures, agreement, figures

STANDARD_MM_PER_PX = SensorDimensions().optics.mm_per_px
MIN_SIDE_PX = 64
"""Shorter side of the smallest field, by hand: level 5 of its pyramid has 2 pixels."""
PRINTED_SHARE = 0.5
"""Least contrast of a sharp print: the MTF50 of ISO 12233."""
SEEN_SHARE = 0.1
"""Least contrast of resolved detail: the MTF10 of ISO 12233. Below it only the coarse remainder of
the pattern can be tracked, not its patches."""
MAX_FIELD_PX, MAX_DOTS = 1_000_000, 6_000_000
"""By hand: the whole view at 2400 dpi; about 0.5 GB of memory while it is printed."""


@dataclass(frozen=True)
class Quality:
    """Figures of a pattern as designed and as photographed, and the contrast it keeps."""

    field_mm: tuple[float, float]
    """Measured field of view (x, y)."""
    field_px: tuple[int, int]
    dpi: float
    mm_per_px: float
    seed: int
    """Seed of halftone, misregistration and noise."""
    dots_a_patch: float | None
    """Printer dots along a patch, or along a marker without patches; None on clear film."""
    px_a_patch: float | None
    """Camera pixels along the same."""
    print_contrast: float | None
    """Share of the designed contrast on the print; None if the design has no contrast."""
    camera_contrast: float | None
    """The same in the camera's image."""
    printable: bool
    """True if the print keeps half of the contrast and `raster` accepts the feature sizes."""
    seen: bool
    """True if the camera's image keeps a tenth of the contrast."""
    designed: Figures
    photographed: Figures


def measure_quality(
    recipe: PatternRecipe,
    printer: Printer | None = None,
    sensor: ImageSensor | None = None,
    mm_per_px: float = STANDARD_MM_PER_PX,
    seed: int = 0,
    view_mm: tuple[float, float] | None = None,
) -> Quality:
    """Measure a pattern. The same arguments give the same numbers.

    view_mm: (x, y) to measure, by default the standard sensor's view. Raises InputError for a
    scale or resolution that is no number above 0, a seed below 0, and for a field of fewer than
    64 px a side.
    """
    from deltact_fab.physics import print_colours

    printer, sensor = printer or Printer(), sensor or ImageSensor()
    if not (0 < mm_per_px < math.inf and 0 < printer.dpi < math.inf and seed >= 0):
        raise InputError(
            f"quality: mm_per_px {mm_per_px:g} and dpi {printer.dpi:g} must be above 0, "
            f"seed {seed} 0 or above"
        )
    size_px = field_px(recipe, printer.mm_per_dot, mm_per_px, view_mm)
    field_mm = (size_px[1] * mm_per_px, size_px[0] * mm_per_px)
    designed = pattern_albedo(recipe, mm_per_px, size_px) * np.float32(255)
    image = driver_image(recipe, printer.dpi, field_mm)
    rng = np.random.default_rng([seed, 5])
    printed = print_colours(printer, image.astype(np.float32) / np.float32(255), rng)
    photo = photograph(printed, printer.mm_per_dot, sensor, mm_per_px, size_px, rng)
    resolved = has_raster(recipe, printer.dpi)
    # Where a printer dot covers several patches, the values sent have already lost contrast
    patches = None if resolved else recipe.patches()
    coded = np.power(printed, np.float32(1 / CAMERA_GAMMA)) * np.float32(255)
    original, coded = _middle(image), _middle(coded)
    print_contrast = contrast_share(coded, original, original if patches is None else patches)
    camera_contrast = contrast_share(photo, designed, image if patches is None else patches)
    feature_mm = recipe.patch_mm
    if feature_mm is None and recipe.dots is not None:
        feature_mm = recipe.dots.diameter_mm
    return Quality(
        field_mm=field_mm,
        field_px=(size_px[1], size_px[0]),
        dpi=printer.dpi,
        mm_per_px=mm_per_px,
        seed=seed,
        dots_a_patch=None if feature_mm is None else feature_mm / printer.mm_per_dot,
        px_a_patch=None if feature_mm is None else feature_mm / mm_per_px,
        print_contrast=print_contrast,
        camera_contrast=camera_contrast,
        printable=resolved and (print_contrast is None or print_contrast >= PRINTED_SHARE),
        seen=camera_contrast is not None and camera_contrast >= SEEN_SHARE,
        designed=figures(designed, mm_per_px),
        photographed=figures(photo, mm_per_px),
    )


def field_px(
    recipe: PatternRecipe, mm_per_dot: float, mm_per_px: float, view_mm: tuple[float, float] | None
) -> tuple[int, int]:
    """Size (h, w) of the field in camera pixels."""
    view_mm = view_mm or SensorDimensions().optics.view_mm
    width_mm, height_mm = (min(side_mm, recipe.printed_mm) for side_mm in view_mm)
    across_mm = math.sqrt(width_mm * height_mm)
    reduction = max(
        1.0,
        across_mm / mm_per_px / math.sqrt(MAX_FIELD_PX),
        across_mm / mm_per_dot / math.sqrt(MAX_DOTS),
    )
    width_px, height_px = (
        math.floor(side_mm / reduction / mm_per_px + 1e-9) for side_mm in (width_mm, height_mm)
    )
    if min(width_px, height_px) < MIN_SIDE_PX:
        raise InputError(
            f"quality: the field is {width_px} x {height_px} px of {mm_per_px:g} mm (at most "
            f"{MAX_DOTS // 10**6} million dots at {MM_PER_INCH / mm_per_dot:.0f} dpi), expected at "
            f"least {MIN_SIDE_PX} px per side: use a larger sticker or a lower dpi"
        )
    return height_px, width_px


def _middle(image: Array) -> Array:
    """Crop the middle 512 x 512 px at most, enough for the print's contrast."""
    row, column = (max(0, (length - 512) // 2) for length in image.shape[:2])
    return image[row : row + 512, column : column + 512]


def contrast_share(image: Array, original: Array, full: Array) -> float | None:
    """Share of a pattern's contrast kept by an image, mean of R, G and B; None if it has none.

    image, original: (h, w, 3) of one shape. full: an image with the pattern's full contrast.
    Halftone and noise do not count: they are uncorrelated with the original.
    """
    shares = []
    for c in range(3):
        designed = float(full[..., c].std(dtype=np.float64))
        if designed > 0:
            share = agreement(image[..., c], original[..., c])
            share *= float(image[..., c].std(dtype=float))
            shares.append(max(0.0, share) / designed)
    return float(np.mean(shares)) if shares else None


INK_REACH_MM = 0.3
"""Printed around the field, by hand: far more than inks spread (20 um) or lie apart (15 um)."""
EDGE_PX = 4
"""Camera pixels around the field for blur and demosaicing, by hand; even: mosaic phase."""
STRIP_COLUMNS = 256  # by hand: more costs memory


def driver_image(recipe: PatternRecipe, dpi: float, field_mm: tuple[float, float]) -> Array:
    """Render the middle of a sticker in printer dots, (h, w, 3) uint8: field_mm (x, y), margin.

    Where a patch or marker is smaller than a printer dot, each dot gets the mean over its area, as
    from a driver that scales down. Nothing outside the sticker is included.
    """
    mm_per_dot = MM_PER_INCH / dpi
    whole_px = round(recipe.printed_mm / mm_per_dot)
    width_px, height_px = (
        _centred(round((side + 2 * INK_REACH_MM) / mm_per_dot), whole_px) for side in field_mm
    )
    if has_raster(recipe, dpi):
        image = raster_window(recipe, dpi, max(width_px, height_px))
        row, column = (len(image) - height_px) // 2, (len(image) - width_px) // 2
        return image[row : row + height_px, column : column + width_px]
    means = pattern_albedo(recipe, mm_per_dot, (height_px, width_px))
    return np.rint(means * 255).astype(np.uint8)


def has_raster(recipe: PatternRecipe, dpi: float) -> bool:
    """True if patches and markers are large enough for `raster`."""
    return all(MM_PER_INCH / dpi <= limit_mm * (1 + 1e-9) for limit_mm, _ in finest_mm(recipe))


def photograph(
    printed: NDArray[np.float32],
    mm_per_dot: float,
    sensor: ImageSensor,
    mm_per_px: float,
    size_px: tuple[int, int],
    rng: np.random.Generator,
) -> NDArray[np.uint8]:
    """Photograph a centred print (rows, columns, 3): camera image of size_px (h, w), RGB uint8."""
    from deltact_fab.physics import Exposure, view_grid

    height_px, width_px = (length + 2 * EDGE_PX for length in size_px)
    edges_mm, ends_mm = _edges(printed.shape[0], mm_per_dot), _edges(height_px, mm_per_px)
    # Columns by strips: the float64 intermediates of a fine print would be gigabytes
    band = np.concatenate(
        [
            cell_means(printed[:, first : first + STRIP_COLUMNS], edges_mm, ends_mm)
            for first in range(0, printed.shape[1], STRIP_COLUMNS)
        ],
        axis=1,
    ).swapaxes(0, 1)
    edges_mm, ends_mm = _edges(printed.shape[1], mm_per_dot), _edges(width_px, mm_per_px)
    radiance = cell_means(band, edges_mm, ends_mm).swapaxes(0, 1).astype(np.float32)
    # Every pixel gets the mean light of the view
    offset = np.sqrt(np.mean(view_grid(*size_px) ** 2, axis=(0, 1)))
    bgr = Exposure(sensor, np.broadcast_to(offset, (height_px, width_px, 2))).expose(radiance, rng)
    return np.ascontiguousarray(bgr[EDGE_PX:-EDGE_PX, EDGE_PX:-EDGE_PX, ::-1])


def _centred(wanted_px: int, whole_px: int) -> int:
    """Adjust a length by at most 1 to leave equal margins on both sides of the whole."""
    return whole_px if wanted_px >= whole_px else wanted_px + (whole_px - wanted_px) % 2


def _edges(length: int, pitch_mm: float) -> NDArray[np.float64]:
    return np.asarray((np.arange(length + 1) - length / 2) * pitch_mm, np.float64)
