"""Shapes that the paper reconstructs beside the sphere: cylinder, ring, toy hat.

The paper gives no dimension: they take the 9 mm of the others.
"""

from __future__ import annotations

from ..rigid import Indenter
from ..turned import TurnedTip


def cylinder(scale: float) -> Indenter:
    """An upright cylinder with a flat end, its edge rounded."""
    return Indenter("cylinder", (TurnedTip.cylinder(4.5 * scale, edge_mm=0.3),))


def ring(scale: float) -> Indenter:
    """A ring lying flat, half its round section out of a tube."""
    return Indenter("ring", (TurnedTip.ring(4.5 * scale, 1.5 * scale),))


def hat(scale: float) -> Indenter:
    """A toy hat, crown first; see TurnedTip.hat for its dimensions."""
    tip = TurnedTip.hat(4.5 * scale, 2.475 * scale, 2.7 * scale, flank_deg=60.0, edge_mm=0.3)
    return Indenter("hat", (tip,))


SHAPES = {"cylinder": cylinder, "ring": ring, "hat": hat}
