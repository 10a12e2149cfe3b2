"""Render a recipe to pixels: the printer's file, and the colours of a virtual sticker.

Image x is sensor +x and image y is sensor +y, as the camera sees the sticker from inside; row 0,
column 0 is the corner at (-x, -y). Every image here is centred on the sensor's origin: the centre
of pixel (row i, column j) of an h x w image is
x = (j - (w - 1) / 2) mm_per_px, y = (i - (h - 1) / 2) mm_per_px.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import MM_PER_INCH, InputError, write_files
from deltact_fab.sensor import SensorDimensions

from . import dots, metadata
from .cell_grid import CellGrid, edges_mm
from .code import patches_hash
from .laws import plain
from .recipe import PatternRecipe, load_recipe

DEFAULT_DPI = 1200.0  # by hand: common to laser and inkjet printers
MAX_SIDE_PX = 11_000
"""Side of the largest raster, by hand: about 1 GB of memory while it is written."""


@dataclass(frozen=True)
class PatternFiles:
    """Files written by `pattern make`; dpi: None if one image pixel is one patch."""

    recipe: PatternRecipe
    image: Path
    image_sha256: str
    patches_sha256: str
    """First digits, patches without dots, as on a sheet's label."""
    side_px: int
    mm_per_px: float
    dpi: float | None
    dots_csv: Path | None
    dots_sha256: str | None
    inner_corners: tuple[int, int] | None = None
    """Inner corners of a chessboard in the camera's view, along x and y."""

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as `pattern make --json` prints it."""
        r = self.recipe
        return {
            "law": r.law,
            "d": r.patch_mm,
            "r": r.r,
            "channels": r.channels,
            "scales_mm": r.scales_mm,
            "weights": r.weights,
            "n": r.n,
            "seed": r.seed,
            "size_mm": r.printed_mm,
            "asked_size_mm": r.size_mm,
            "dpi": self.dpi,
            "mm_per_px": self.mm_per_px,
            "side_px": self.side_px,
            "dots": None if r.dots is None else r.dots.model_dump(),
            "dots_sha256": self.dots_sha256,
            "inner_corners": self.inner_corners,
            "patches_sha256": self.patches_sha256,
            "sha256": self.image_sha256,
            "files": [str(p) for p in (self.image, self.dots_csv) if p is not None],
        }


def raster(recipe: PatternRecipe, dpi: float) -> NDArray[np.uint8]:
    """Render the sticker in printer dots, (h, h, 3) uint8 RGB, h = printed side in dots.

    Every patch edge lies at the printer dot nearest to its true place, so the error of an edge is
    at most half a dot and does not grow across the sticker; patches differ by one dot in width.
    Marker dots are binary: a printer dot belongs to a marker where its centre does.

    Raises InputError for a resolution that loses the patches or makes too large an image.
    """
    side_px = round(recipe.printed_mm / checked_mm_per_px(recipe, dpi))
    return raster_window(recipe, dpi, side_px)


def raster_window(recipe: PatternRecipe, dpi: float, side_px: int) -> NDArray[np.uint8]:
    """Render the middle of `raster`, (side_px, side_px, 3), adjusted by a dot to stay centred.

    Stickers may have any size; only the whole raster is limited. Raises InputError if dpi loses
    the patches.
    """
    mm_per_px = checked_mm_per_px(recipe, dpi, full_sticker=False)
    side_mm, pitch_mm = (recipe.printed_mm,) * 2, (mm_per_px,) * 2
    cells = CellGrid("", recipe.patches(), side_mm, pitch_mm, grid=recipe.dots)
    low_px = max(0, (cells.height_px - side_px) // 2)
    high_px = cells.height_px - low_px
    return cells.rows(low_px, high_px)[:, low_px:high_px]


def pattern_albedo(
    recipe: PatternRecipe, mm_per_px: float, size_px: tuple[int, int] | None = None
) -> NDArray[np.float32]:
    """Designed colour of the sticker, (h, w, 3) float32 RGB in 0..1, linear in the file's value.

    White is no ink, as outside the sticker. Gamma, printer dots, halftone and ink spread belong to
    `imaging.Printer`, which takes these values. Each pixel is the mean over its area (patches
    exact, marker dots to about 1e-3 of a pixel).

    mm_per_px: side of a pixel. size_px: (h, w); default: the least square that covers the
    sticker. The image is centred on the sensor's origin (see the module for pixel to mm).
    Raises InputError when mm_per_px is not above zero.
    """
    if not (math.isfinite(mm_per_px) and mm_per_px > 0):
        raise InputError(f"mm_per_px: {mm_per_px} must be finite and above 0")
    if size_px is None:
        side_px = math.ceil(recipe.printed_mm / mm_per_px - 1e-9)
        size_px = (side_px, side_px)
    ink = np.pad(recipe.patches(), ((1, 1), (1, 1), (0, 0)), constant_values=255) / 255.0
    inner_mm = edges_mm(recipe.n, recipe.printed_mm)
    far_mm = max(*size_px) * mm_per_px + inner_mm[-1]
    steps_mm = np.concatenate(([-far_mm], inner_mm, [far_mm]))
    out = np.empty((*size_px, 3), np.float32)
    rows_mm, columns_mm = (
        np.linspace(-length / 2, length / 2, length + 1) * mm_per_px for length in size_px
    )
    strip = 256  # rows at a time: float64 intermediates of a whole fine image would be gigabytes
    for first in range(0, size_px[0], strip):
        band = cell_means(ink, steps_mm, rows_mm[first : first + strip + 1])
        band = cell_means(band.swapaxes(0, 1), steps_mm, columns_mm).swapaxes(0, 1)
        out[first : first + strip] = band
    if recipe.dots is not None:
        dots.blend(out, recipe.dots, mm_per_px, np.array(recipe.dots.rgb) / 255.0)
    return out


def make_pattern(
    recipe: PatternRecipe | str,
    path: Path | str,
    dpi: float | None = None,
    sensor: SensorDimensions | None = None,
    check_view: bool = True,
) -> PatternFiles:
    """Write the sticker as PNG, and the centres of its dots beside it as NAME.dots.csv.

    recipe: also a name of the catalogue, or a recipe's file.

    One image pixel is one patch, unless dpi is given or the sticker has dots or no patches: then
    it is a raster at dpi, by default DEFAULT_DPI or the nearest one that resolves it. The PNG holds
    recipe and dots as text (`metadata`), the size in its pHYs chunk. Equal recipe, resolution
    and versions give equal bytes.

    check_view: False for an existing sticker, whatever this sensor sees of it.

    Raises InputError if dots leave the sensor's view, a chessboard does not fill it, or a file
    cannot be written; nothing is changed then.
    """
    recipe, path = load_recipe(recipe) if isinstance(recipe, str) else recipe, Path(path)
    if path.suffix.lower() != ".png":
        raise InputError(f"{path}: expected a name that ends in .png")
    table_path = None if recipe.dots is None else path.with_suffix(".dots.csv")
    view_mm = (sensor or SensorDimensions()).optics.view_mm
    if check_view:
        check_seen(recipe, view_mm)
    corners = plain.inner_corners(recipe, view_mm) if recipe.law == "chessboard" else None
    if dpi is None and (recipe.dots is not None or recipe.patch_mm is None):
        lowest, highest = _dpi_range(recipe)
        dpi = float(max(lowest, min(DEFAULT_DPI, highest)))
    if dpi is None:
        image, mm_per_px = recipe.patches(), recipe.patch_mm or recipe.printed_mm
    else:
        mm_per_px = checked_mm_per_px(recipe, dpi)
        image = raster(recipe, dpi)
    size_px = (image.shape[0], image.shape[1])
    table = None if recipe.dots is None else dots.centres_csv(recipe.dots, mm_per_px, size_px)
    table_hash = None if table is None else hashlib.sha256(table).hexdigest()
    content = metadata.png(image, recipe, mm_per_px, dpi, table)
    files = {path: content}
    if table is not None and table_path is not None:
        files[table_path] = table
    write_files(files)
    return PatternFiles(
        recipe=recipe,
        image=path,
        image_sha256=hashlib.sha256(content).hexdigest(),
        patches_sha256=patches_hash(recipe),
        side_px=image.shape[0],
        mm_per_px=mm_per_px,
        dpi=dpi,
        dots_csv=table_path,
        dots_sha256=table_hash,
        inner_corners=corners,
    )


def check_seen(recipe: PatternRecipe, view_mm: tuple[float, float]) -> None:
    """Raise InputError for dots that leave a view (x, y), or a chessboard that does not fill it."""
    if recipe.dots is not None:
        dots.check_inside(recipe.dots, view_mm)
    if recipe.law == "chessboard":
        plain.check_covers(recipe, view_mm)


def checked_mm_per_px(recipe: PatternRecipe, dpi: float, full_sticker: bool = True) -> float:
    """Return the side of a printer dot; InputError if it is too coarse or the sticker too large.

    full_sticker: False if only a part is rendered, which has no size limit.
    """
    if not (math.isfinite(dpi) and dpi > 0):
        raise InputError(f"dpi: {dpi:g} must be above 0, as in 1200")
    lowest, highest = _dpi_range(recipe)
    right = f"use {lowest} to {highest}" if full_sticker else f"use {lowest} or more"
    if full_sticker and lowest > highest:
        right = f"no resolution resolves it within {MAX_SIDE_PX} pixels: make the sticker smaller"
    for limit_mm, name in finest_mm(recipe):
        if MM_PER_INCH / dpi > limit_mm * (1 + 1e-9):
            raise InputError(
                f"dpi: a printer dot at {dpi:g} dpi is {MM_PER_INCH / dpi:.4g} mm, larger than "
                f"{name} ({limit_mm:g} mm); {right}"
            )
    side_px = recipe.printed_mm * dpi / MM_PER_INCH
    if side_px < 1 or (full_sticker and side_px > MAX_SIDE_PX * (1 + 1e-9)):
        raise InputError(
            f"dpi: {recipe.printed_mm:g} mm at {dpi:g} dpi is {side_px:.4g} pixels a side; at most "
            f"{MAX_SIDE_PX}; {right}"
        )
    return MM_PER_INCH / dpi


def finest_mm(recipe: PatternRecipe) -> list[tuple[float, str]]:
    """Upper limits of a printer dot's size, each with the name of its feature."""
    # A marker below four printer dots is not round; a patch below one is lost
    limits = (
        (recipe.patch_mm, "a patch"),
        (recipe.dots and recipe.dots.diameter_mm / 4, "a quarter of a marker dot"),
    )
    return [(limit_mm, name) for limit_mm, name in limits if limit_mm]


def _dpi_range(recipe: PatternRecipe) -> tuple[int, int]:
    """Least and largest whole dpi; empty if the finest detail needs more than MAX_SIDE_PX."""
    least_mm = min([recipe.printed_mm, *(limit_mm for limit_mm, _ in finest_mm(recipe))])
    lowest = math.ceil(MM_PER_INCH / least_mm * (1 - 1e-9))
    return lowest, math.floor(MAX_SIDE_PX * MM_PER_INCH / recipe.printed_mm * (1 + 1e-9))


def cell_means(
    values: NDArray[Any], edges_mm: NDArray[np.float64], cells_mm: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Mean of a step function over cells, along axis 0.

    values: (k, m, 3) between edges_mm (k + 1,). cells_mm: (c + 1,) within the edges. Returns
    (c, m, 3). The integral is linear between the edges and is interpolated at the cells' ends.
    """
    steps_mm = np.diff(edges_mm)[:, None, None]
    integral = np.concatenate((np.zeros((1, *values.shape[1:])), np.cumsum(values * steps_mm, 0)))
    inside = np.clip(np.searchsorted(edges_mm, cells_mm, "right") - 1, 0, len(values) - 1)
    cumulative = integral[inside] + values[inside] * (cells_mm - edges_mm[inside])[:, None, None]
    means = np.diff(cumulative, axis=0) / np.diff(cells_mm)[:, None, None]
    return np.clip(means, 0.0, 1.0)  # the sums round in the 13th digit
