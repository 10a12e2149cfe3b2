"""Where a mesh sees a contact, and the layer's forces above that depth: a curve's light end."""

from __future__ import annotations

import math

import numpy as np

from ...aliases import Field
from ...elasticity.material import GelMaterial
from ...errors import InputError, SolverError
from ...shapes import Indenter, SkinDimensions
from ..path.knots import KnotPose, ObservedChannels
from ..path.open import choose, open_path

CELLS = 3.0  # contact radius over cell size, from which a mesh is trusted
PARTS = (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 3 / 4)  # of the first solved depth
SPACING_MM = 0.2


def widest_mm(indenter: Indenter, depth_mm: float) -> float:
    """Radius of the largest circle in the indenter's section at half the depth.

    That is the contact's radius where the gel meets a sphere as in Hertz, a^2 = R d.
    """
    from scipy.ndimage import distance_transform_edt

    half_x, half_y = indenter.footprint_half_mm
    cell = max(half_x, half_y) / 100
    x = np.arange(-half_x - 2 * cell, half_x + 3 * cell, cell)
    y = np.arange(-half_y - 2 * cell, half_y + 3 * cell, cell)
    height = indenter.height_mm(*np.meshgrid(x, y))
    inside = np.isfinite(height) & (height <= depth_mm / 2)
    return float(distance_transform_edt(inside).max()) * cell


def seen_from_mm(indenter: Indenter, h: float) -> float:
    """Depth from which the contact is CELLS cells wide, or 60 % of the tips' width."""
    goal = min(CELLS * h, 0.6 * widest_mm(indenter, math.inf))
    low, high = 0.0, 2 * indenter.equator_mm
    for _ in range(12):
        middle = (low + high) / 2
        low, high = (low, middle) if widest_mm(indenter, middle) >= goal else (middle, high)
    return high


def layer_forces(
    skin: SkinDimensions,
    unit: GelMaterial,
    indenter: Indenter,
    at_mm: tuple[float, float],
    first_mm: float,
) -> tuple[Field, Field, float] | None:
    """Depths above the first solved one, the bonded layer's normal forces there, and that at it.

    None where the layer refuses that depth.
    """
    depths = [part * first_mm for part in (*PARTS, 1.0)]
    poses = [KnotPose((*at_mm, -d), 0.0, 1.0) for d in depths]
    # Too light a touch hides in its grid: deeper ones may do.
    for skipped in range(len(PARTS) - 1):
        try:
            choice = choose(
                skin, unit, indenter, poses[skipped:],
                level="layer", friction=0.0, spacing_mm=SPACING_MM,
            )  # fmt: skip
            solver = open_path(skin, unit, indenter, poses[skipped:], ObservedChannels(), choice)
            normal = np.array([-knot.force_n[2] for knot in solver.solve_all()])
        except (InputError, SolverError):
            continue
        return np.array(depths[skipped:-1]), normal[:-1], float(normal[-1])
    return None
