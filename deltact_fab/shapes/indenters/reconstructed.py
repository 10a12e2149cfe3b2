"""Shapes that the paper reconstructs beside the sphere: cylinder, ring, toy hat.

The paper gives no dimension: they take the 9 mm of the others.
"""

from __future__ import annotations

from ..rigid import Indenter
from ..turned import TurnedTip


def cylinder(radius_mm: float = 4.5, edge_mm: float = 0.3) -> Indenter:
    """An upright cylinder with a flat end, its edge rounded."""
    return Indenter("cylinder", (TurnedTip.cylinder(radius_mm, edge_mm),))


def ring(radius_mm: float = 4.5, tube_mm: float = 1.5) -> Indenter:
    """A ring lying flat, half its round section out of a tube; radius_mm is the outer one."""
    return Indenter("ring", (TurnedTip.ring(radius_mm, tube_mm),))


def hat(
    radius_mm: float = 4.5,
    crown_radius_mm: float = 2.475,
    crown_mm: float = 2.7,
    flank_deg: float = 60.0,
    edge_mm: float = 0.3,
) -> Indenter:
    """A toy hat, crown first; see TurnedTip.hat for its dimensions."""
    tip = TurnedTip.hat(radius_mm, crown_radius_mm, crown_mm, flank_deg, edge_mm)
    return Indenter("hat", (tip,))


SHAPES = {
    "cylinder": lambda s: cylinder(4.5 * s),
    "ring": lambda s: ring(4.5 * s, 1.5 * s),
    "hat": lambda s: hat(4.5 * s, 2.475 * s, 2.7 * s),
}
