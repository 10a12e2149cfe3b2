"""The five indenters of the paper's pattern selection (Fig. 4c), and the pair that its text names.

The paper gives no dimension. The defaults keep the longest side of the footprint at 9 mm, so that a
shear of 10 mm each way stays on the skin of 36 x 34 mm, and give sharp edges the small radius of a
real print.
"""

from __future__ import annotations

from ..prism import PrismTip
from ..rigid import Indenter
from ..tips import EllipsoidTip, RidgeTip, SphereTip


def four_dots(tip_radius_mm: float = 2.0, pitch_mm: float = 5.0) -> Indenter:
    """The paper's first indenter: four spherical dots on the corners of a square.

    The paper calls it 2-dot in the text and draws four dots in Fig. 4c; both can be had.
    """
    h = pitch_mm / 2
    tips = tuple(SphereTip(x, y, tip_radius_mm) for y in (-h, h) for x in (-h, h))
    return Indenter("4dots", tips)


def two_dots(tip_radius_mm: float = 2.0, pitch_mm: float = 5.0) -> Indenter:
    """Two spherical dots side by side along x, as the paper's text has it."""
    h = pitch_mm / 2
    return Indenter("2dots", tuple(SphereTip(x, 0.0, tip_radius_mm) for x in (-h, h)))


def edges(
    pitch_mm: float = 5.5,
    half_width_mm: float = 1.75,
    length_mm: float = 5.5,
    nose_mm: float = 0.3,
    flank_deg: float = 45.0,
) -> Indenter:
    """Two parallel edges along y: right-angled wedges with a nose of radius nose_mm.

    length_mm: straight part of an edge; its round ends add half_width_mm each. Steeper flanks lock
    under a friction of .5 when the edges are dragged over the linear layer.
    """
    h = pitch_mm / 2
    tips = (RidgeTip(x, 0.0, nose_mm, half_width_mm, length_mm, flank_deg) for x in (-h, h))
    return Indenter("edges", tuple(tips))


def ellipsoid(a_mm: float = 4.5, b_mm: float = 3.0) -> Indenter:
    """Half an ellipsoid, a long (x) and b wide and high (y, z); both are semi-axes."""
    return Indenter("ellipsoid", (EllipsoidTip(0.0, 0.0, a_mm, b_mm),))


def hexprism(outer_mm: float = 4.5, corner_mm: float = 0.5, edge_mm: float = 0.3) -> Indenter:
    """A flat hexagonal face, corners on +-x; outer_mm from the middle to a rounded corner."""
    return Indenter("hexprism", (PrismTip.polygon(6, outer_mm, corner_mm, edge_mm),))


def star(
    outer_mm: float = 4.5,
    inner_mm: float = 2.25,
    corner_mm: float = 0.5,
    notch_mm: float = 0.5,
    edge_mm: float = 0.3,
) -> Indenter:
    """A flat five-pointed star, one point on +x; see PrismTip for its dimensions."""
    tip = PrismTip(0.0, 0.0, 5, outer_mm, inner_mm, corner_mm, notch_mm, edge_mm)
    return Indenter("star", (tip,))


SHAPES = {
    "4dots": lambda s: four_dots(2.0 * s, 5.0 * s),
    "2dots": lambda s: two_dots(2.0 * s, 5.0 * s),
    "edges": lambda s: edges(5.5 * s, 1.75 * s, 5.5 * s),
    "ellipsoid": lambda s: ellipsoid(4.5 * s, 3.0 * s),
    "hexprism": lambda s: hexprism(4.5 * s),
    "star": lambda s: star(4.5 * s, 2.25 * s),
}
