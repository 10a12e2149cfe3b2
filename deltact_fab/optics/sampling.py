"""How finely a fisheye's raw image samples the face under its rectified view."""

from __future__ import annotations

import numpy as np

from ..aliases import Array
from .rectified import Rectified

MIN_PX = 2.0
"""Raw pixels that a patch needs each way: fewer, and its neighbours are mixed with it (Nyquist)."""
GRID_PX = 8
"""Between the view's pixels that a share is counted on."""
STEP_MM = 0.01


def raw_mm_per_px(view: Rectified, px: Array) -> Array:
    """Millimetres of the resting face per raw pixel at pixels (..., 2) of the view: (..., 2).

    Along the radius from the pupil's foot, and across it. A view's own pixel is finer where this
    is more than its mm_per_px: the image is enlarged there, and gains nothing by it.
    """
    at = view.rest_mm(np.asarray(px, float))
    out = at - (view.lens.x0_mm, view.lens.y0_mm)
    far = np.hypot(out[..., 0], out[..., 1])[..., None]
    along = np.where(far > 0, out / np.where(far > 0, far, 1.0), (1.0, 0.0))
    across = np.stack((-along[..., 1], along[..., 0]), axis=-1)
    scales = []
    for way in (along, across):
        apart = view.lens.rest_px(at + STEP_MM * way) - view.lens.rest_px(at - STEP_MM * way)
        scales.append(2 * STEP_MM / np.hypot(apart[..., 0], apart[..., 1]))
    return np.stack(scales, axis=-1)


def aliased_share(view: Rectified, patch_mm: float) -> float:
    """Share of the view, 0 to 1, in which a patch covers less than MIN_PX raw pixels one way."""
    columns = np.arange(GRID_PX / 2 - 0.5, view.width_px, GRID_PX)
    rows = np.arange(GRID_PX / 2 - 0.5, view.height_px, GRID_PX)
    scales = raw_mm_per_px(view, np.stack(np.meshgrid(columns, rows), axis=-1))
    return float(np.mean(patch_mm < MIN_PX * np.max(scales, axis=-1)))
