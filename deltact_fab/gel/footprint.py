"""What of an indenter meets the gel at a depth: sections, edges, mirrors; for `level_selection`."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from ..shapes import EllipsoidTip, Indenter, PrismTip, RidgeTip, SphereTip, Tip


def is_mirrored(indenter: Indenter, axis: int) -> bool:
    """Whether an indenter is its own image in the plane x = 0 (axis 0) or y = 0 (axis 1)."""
    tips = set(indenter.tips)
    return all(_image(t, axis) in tips for t in tips)


def _image(tip: Tip, axis: int) -> Tip | None:
    """A tip's mirror image; None where it is no tip of its kind."""
    if isinstance(tip, PrismTip) and axis == 0 and tip.points % 2:
        return None  # one of its points is on +x
    # -0.0 == 0.0, and equal numbers hash alike.
    return replace(tip, x_mm=-tip.x_mm) if axis == 0 else replace(tip, y_mm=-tip.y_mm)


def edge_radius_mm(tip: Tip) -> float:
    """Smallest convex radius of a tip's underside."""
    if isinstance(tip, SphereTip):
        return tip.radius_mm
    if isinstance(tip, EllipsoidTip):
        return min(tip.a_mm, tip.b_mm) ** 2 / max(tip.a_mm, tip.b_mm)
    if isinstance(tip, RidgeTip):
        return tip.radius_mm
    if isinstance(tip, PrismTip):
        return tip.edge_mm
    found, a = tip.radius_mm, tip.start_mm
    for piece in tip.pieces:
        c = piece.centre_mm
        if c is not None and c[1] >= max(a[1], piece.end_mm[1]) - 1e-9:
            found = min(found, math.dist(c, a))
        a = piece.end_mm
    return found


def contact_radius_mm(indenter: Indenter, depth_mm: float) -> float:
    """Radius of the largest circle in the section at half the depth: Hertz' a^2 = R d of a ball."""
    return _sections(indenter, depth_mm)[0]


def whole_radius_mm(indenter: Indenter, depth_mm: float) -> float:
    """Radius of the circle as large as the box around the section at half the depth."""
    a, b = _sections(indenter, depth_mm)[2]
    return math.sqrt(4 * a * b / math.pi)


def section_half_mm(indenter: Indenter, depth_mm: float) -> tuple[float, float]:
    """Half sides (x, y) of the box around the section at the whole depth, about the axis."""
    return _sections(indenter, depth_mm)[1]


@lru_cache(maxsize=64)
def _sections(
    indenter: Indenter, depth_mm: float
) -> tuple[float, tuple[float, float], tuple[float, float]]:
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
    return max(radius, cell), boxes[0], boxes[1]
