"""Indenters: one definition gives the height field, the footprint and the CAD solid.

Names are short and typed by hand: `sphere:10` is a sphere of 10 mm diameter, `4dots` the paper's
four-dot indenter. The tip's lowest point is at z = 0 in the indenter's frame; the body lies above.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

Field = NDArray[np.float64]


@dataclass(frozen=True)
class SphereTip:
    """One spherical cap of the indenter's face at (x, y), with its lowest point at z = 0."""

    x_mm: float
    y_mm: float
    radius_mm: float


@dataclass(frozen=True)
class Indenter:
    """A rigid indenter made of spherical tips on one stem.

    name: what the user typed, normalised (`sphere:10`, `4dots`).
    tips: spherical caps; outside all of them the indenter is out of reach.
    stem_diameter_mm: the stem that fits the stage's tool holder.
    """

    name: str
    tips: tuple[SphereTip, ...]
    stem_diameter_mm: float = 6.0
    stem_length_mm: float = 20.0

    @property
    def slug(self) -> str:
        """The name as it may stand in a file name."""
        return self.name.replace(":", "-").replace(".", "p")

    @property
    def footprint_half_mm(self) -> tuple[float, float]:
        """Half sides of the box around the tips as seen along z (x, y)."""
        return (
            max(abs(t.x_mm) + t.radius_mm for t in self.tips),
            max(abs(t.y_mm) + t.radius_mm for t in self.tips),
        )

    @property
    def reach_mm(self) -> float:
        """Depth to which the tips alone can be pressed before something else would touch."""
        return min(t.radius_mm for t in self.tips)

    def height_mm(self, x_mm: Field, y_mm: Field) -> Field:
        """Height of the indenter's underside above its lowest point, inf where there is none.

        x_mm, y_mm: arrays of one shape, relative to the indenter's axis. Returns that shape.
        """
        height = np.full(np.broadcast(x_mm, y_mm).shape, np.inf)
        for tip in self.tips:
            r2 = (x_mm - tip.x_mm) ** 2 + (y_mm - tip.y_mm) ** 2
            inside = r2 <= tip.radius_mm**2
            cap = tip.radius_mm - np.sqrt(np.where(inside, tip.radius_mm**2 - r2, 0.0))
            height = np.where(inside, np.minimum(height, cap), height)
        return height


def four_dots(tip_radius_mm: float = 2.0, pitch_mm: float = 5.0) -> Indenter:
    """The paper's first indenter: four spherical dots on the corners of a square.

    The paper calls it 2-dot in the text and draws four dots; four are built. Its tip size and
    pitch are not in the paper: the defaults keep the footprint at 9 mm, so that a shear of 10 mm
    stays on the skin.
    """
    h = pitch_mm / 2
    tips = tuple(SphereTip(x, y, tip_radius_mm) for y in (-h, h) for x in (-h, h))
    return Indenter("4dots", tips)


def parse(name: str) -> Indenter:
    """Read an indenter's name, `sphere:DIAMETER` or `4dots`. Raises InputError."""
    kind, _, size = name.strip().partition(":")
    if kind == "4dots" and not size:
        return four_dots()
    if kind == "sphere":
        try:
            diameter_mm = float(size)
        except ValueError:
            diameter_mm = math.nan
        if not (math.isfinite(diameter_mm) and 0.5 <= diameter_mm <= 30.0):
            raise InputError(
                f"indenter {name!r}: a sphere takes a diameter of 0.5 to 30 mm, as in 'sphere:10'"
            )
        return Indenter(f"sphere:{diameter_mm:g}", (SphereTip(0.0, 0.0, diameter_mm / 2),))
    raise InputError(f"indenter {name!r}: unknown; valid: sphere:DIAMETER_MM, 4dots")
