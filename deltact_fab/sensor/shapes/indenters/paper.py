"""The five indenters of the paper's pattern selection (Fig. 4c), the pair that its text names, and
what it reconstructs beside the sphere: cylinder, ring, toy hat.

The paper gives no dimension. The defaults keep the longest side of the footprint at 9 mm, so that a
shear of 10 mm each way stays on the skin of 36 x 34 mm, and give sharp edges the small radius of a
real print.
"""

from __future__ import annotations

from ..prism import PrismTip
from ..rigid import Indenter
from ..tips import EllipsoidTip, RidgeTip, SphereTip
from ..turned import TurnedTip


def four_dots(scale: float) -> Indenter:
    """The paper's first indenter: four spherical dots on the corners of a square.

    The paper calls it 2-dot in the text and draws four dots in Fig. 4c; both can be had.
    """
    h = 5.0 * scale / 2
    tips = tuple(SphereTip(x, y, 2.0 * scale) for y in (-h, h) for x in (-h, h))
    return Indenter("4dots", tips)


def two_dots(scale: float) -> Indenter:
    """Two spherical dots side by side along x, as the paper's text has it."""
    h = 5.0 * scale / 2
    return Indenter("2dots", tuple(SphereTip(x, 0.0, 2.0 * scale) for x in (-h, h)))


def edges(scale: float) -> Indenter:
    """Two parallel edges along y: right-angled wedges with a nose of radius 0.3 mm.

    Their straight part is as long as their pitch; round ends add half a width each. Steeper flanks
    lock under a friction of 0.5 when the edges are dragged over the linear layer.
    """
    h = 5.5 * scale / 2
    tips = (RidgeTip(x, 0.0, 0.3, 1.75 * scale, 5.5 * scale, flank_deg=45.0) for x in (-h, h))
    return Indenter("edges", tuple(tips))


def ellipsoid(scale: float) -> Indenter:
    """Half an ellipsoid, longest along x; as wide (y) as twice its height (z)."""
    return Indenter("ellipsoid", (EllipsoidTip(0.0, 0.0, 4.5 * scale, 3.0 * scale),))


def hexprism(scale: float) -> Indenter:
    """A flat hexagonal face, corners on +-x."""
    return Indenter("hexprism", (PrismTip.polygon(6, 4.5 * scale, corner_mm=0.5, edge_mm=0.3),))


def star(scale: float) -> Indenter:
    """A flat five-pointed star, one point on +x; see PrismTip for its dimensions."""
    radii = {"corner_mm": 0.5, "notch_mm": 0.5, "edge_mm": 0.3}
    return Indenter("star", (PrismTip(0.0, 0.0, 5, 4.5 * scale, 2.25 * scale, **radii),))


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


SHAPES = {
    "4dots": four_dots,
    "2dots": two_dots,
    "edges": edges,
    "ellipsoid": ellipsoid,
    "hexprism": hexprism,
    "star": star,
    "cylinder": cylinder,
    "ring": ring,
    "hat": hat,
}
