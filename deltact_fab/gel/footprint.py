"""An indenter's part in the gel at a depth: sections, edges, mirrors; for `level_selection`."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ..aliases import Field
from ..shapes import Indenter

R2 = 0.7548776662466927, 0.5698402909980532  # steps that fill a square evenly (Roberts)
MIRROR_MM = 1e-6


def is_mirrored(indenter: Indenter, axis: int) -> bool:
    """Whether an indenter is its own image in the plane x = 0 (axis 0) or y = 0 (axis 1).

    By its underside at points that no symmetry puts on an edge.
    """
    k = np.arange(1, 2001)
    half = indenter.footprint_half_mm
    x, y = (
        np.asarray((2 * ((c * k) % 1) - 1) * h, np.float64) for c, h in zip(R2, half, strict=True)
    )
    other: tuple[Field, Field] = (-x, y) if axis == 0 else (x, -y)
    here, there = indenter.height_mm(x, y), indenter.height_mm(*other)
    return bool(np.allclose(here, there, rtol=0, atol=MIRROR_MM))


def contact_radius_mm(indenter: Indenter, depth_mm: float) -> float:
    """Radius of the largest circle in the section at half the depth: Hertz' a^2 = R d of a ball."""
    return _sections(indenter, depth_mm)[0]


def section_half_mm(indenter: Indenter, depth_mm: float) -> tuple[float, float]:
    """Half sides (x, y) of the box around the section at the whole depth, about the axis."""
    return _sections(indenter, depth_mm)[1]


@lru_cache(maxsize=64)
def _sections(indenter: Indenter, depth_mm: float) -> tuple[float, tuple[float, float]]:
    from scipy.ndimage import distance_transform_edt

    boxes = []
    radius = 0.0
    half_x, half_y = indenter.footprint_half_mm
    for part in (1.0, 0.5):
        # Zoom in on a light touch: a few hundredths of a millimetre have a section too.
        size = max(half_x, half_y)
        for _ in range(6):
            cell = size / 100
            x = np.arange(-101, 102) * cell
            height = indenter.height_mm(*np.meshgrid(x, x))
            inside = np.isfinite(height) & (height <= part * depth_mm)
            seen = [np.abs(x[inside.any(axis=k)]).max(initial=0.0) for k in (0, 1)]
            if max(seen) >= size / 4:
                break
            size = max(2 * max(seen), 4 * cell)
        boxes.append((float(seen[0]) + cell / 2, float(seen[1]) + cell / 2))
        if part < 1:
            radius = float(distance_transform_edt(inside).max()) * cell
    return float(max(radius, cell)), boxes[0]
