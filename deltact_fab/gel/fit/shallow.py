"""Where a mesh sees a contact, and the layer's forces above that depth: a curve's light end."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...errors import DeltactFabError
from ...shapes import Indenter, SkinDimensions
from ..linear.contact import LayerContact
from ..linear.layer import BondedLayer
from ..material import GelMaterial

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
) -> list[Any]:
    """Depths above the first solved one, normal forces there and at it, of the bonded layer.

    Empty where the layer refuses that depth.
    """
    layer = BondedLayer.for_skin(skin, unit, spacing_mm=SPACING_MM)
    contact = LayerContact(layer, indenter, observe_shear=False)
    depths, normal = [], []
    for part in (*PARTS, 1.0):
        try:
            state = contact.solve(contact.rest((*at_mm, 0.0)), (*at_mm, part * first_mm))
        except DeltactFabError:
            # Too shallow for its grid: deeper ones may do.
            if part == 1.0:
                return []
            continue
        depths.append(part * first_mm)
        normal.append(-state.force_n[2])
    return [depths[:-1], normal[:-1], normal[-1]]
