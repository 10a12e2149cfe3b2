"""A sticker photographed at rest: raster, print, camera pixels, exposure, modelled by `imaging`.

Lens distortion and vignetting are left out, because they belong to the camera and not to the
pattern. The mean falloff of light is kept, because it sets the noise.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...units import MM_PER_INCH
from ..raster import albedo, cell_means, finest_mm, raster_window
from ..recipe import PatternRecipe

if TYPE_CHECKING:
    from ...aliases import Float
    from ...imaging import ImageSensor

MARGIN_MM = 0.3
"""Printed around the field, from where misregistered (15 um) and spreading (20 um) ink comes."""
MARGIN_PX = 4
"""Camera pixels around the field, for blur and demosaicing; even, to keep the mosaic's phase."""
STRIP = 256


def sent(recipe: PatternRecipe, dpi: float, field_mm: tuple[float, float]) -> NDArray[np.uint8]:
    """The middle of a sticker in printer dots, (h, w, 3) file values: field_mm (x, y) and a margin.

    Where a patch or marker is smaller than a printer dot, each dot gets the mean of what it covers,
    as from a driver that scales down. Nothing outside the sticker is included.
    """
    mm_per_dot = MM_PER_INCH / dpi
    whole_px = round(recipe.printed_mm / mm_per_dot)
    width_px, height_px = (
        _centred(round((side_mm + 2 * MARGIN_MM) / mm_per_dot), whole_px) for side_mm in field_mm
    )
    if has_raster(recipe, dpi):
        image = raster_window(recipe, dpi, max(width_px, height_px))
        top, left = (len(image) - height_px) // 2, (len(image) - width_px) // 2
        return image[top : top + height_px, left : left + width_px]
    means = albedo(recipe, mm_per_dot, (height_px, width_px))
    return np.rint(means * 255).astype(np.uint8)


def has_raster(recipe: PatternRecipe, dpi: float) -> bool:
    """Whether patches and markers are as large as `raster` asks for."""
    return all(MM_PER_INCH / dpi <= limit_mm * (1 + 1e-9) for limit_mm, _ in finest_mm(recipe))


def photograph(
    printed: Float,
    mm_per_dot: float,
    sensor: ImageSensor,
    mm_per_px: float,
    size_px: tuple[int, int],
    rng: np.random.Generator,
) -> NDArray[np.uint8]:
    """A centred print (rows, columns, 3) as the camera's image of size_px (h, w), (h, w, 3) RGB."""
    from ...imaging import Exposure, view_grid

    height_px, width_px = (length + 2 * MARGIN_PX for length in size_px)
    edges_mm, ends_mm = _edges(printed.shape[0], mm_per_dot), _edges(height_px, mm_per_px)
    # Columns by strips: the float64 intermediates of a fine print would be gigabytes
    band = np.concatenate(
        [
            cell_means(printed[:, first : first + STRIP], edges_mm, ends_mm)
            for first in range(0, printed.shape[1], STRIP)
        ],
        axis=1,
    ).swapaxes(0, 1)
    edges_mm, ends_mm = _edges(printed.shape[1], mm_per_dot), _edges(width_px, mm_per_px)
    radiance = cell_means(band, edges_mm, ends_mm).swapaxes(0, 1).astype(np.float32)
    # Every pixel gets the mean light of the view
    off = np.sqrt(np.mean(view_grid(*size_px) ** 2, axis=(0, 1)))
    bgr = Exposure(sensor, np.broadcast_to(off, (height_px, width_px, 2))).expose(radiance, rng)
    return np.ascontiguousarray(bgr[MARGIN_PX:-MARGIN_PX, MARGIN_PX:-MARGIN_PX, ::-1])


def _centred(wanted_px: int, whole_px: int) -> int:
    """A length near the wanted one that leaves equal margins on both sides of the whole."""
    return whole_px if wanted_px >= whole_px else wanted_px + (whole_px - wanted_px) % 2


def _edges(length: int, pitch_mm: float) -> NDArray[np.float64]:
    return np.asarray((np.arange(length + 1) - length / 2) * pitch_mm, np.float64)
