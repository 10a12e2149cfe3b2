"""Indenters: one definition gives the height field, the footprint and the CAD solid.

Names are short and typed by hand: `sphere:10` is a sphere of 10 mm diameter, `star` the paper's
star. The tip's lowest point is at z = 0 in the indenter's frame; the body lies above.

The paper draws five indenters for the pattern selection (Fig. 4c: 4 dots, edges, ellipsoid,
hexagonal prism, star) without a dimension. The defaults here keep the longest side of the
footprint at 9 mm, so that a shear of 10 mm each way stays on the skin of 36 x 34 mm, and give
sharp edges the small radius of a real print. Nor does it give one of the shapes it reconstructs
(sphere, cylinder, ring, toy hat): they take the same 9 mm. `NAME:SIZE` scales an indenter to
another longest side; radii that the printer sets (edges, corners, noses) stay.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Field
from ..errors import InputError
from .prism import PrismTip
from .tips import EllipsoidTip, RidgeTip, SphereTip
from .turned import TurnedTip

Tip = SphereTip | RidgeTip | EllipsoidTip | PrismTip | TurnedTip

REACH_MM = 12.0  # as long as the standard gel is thick
SHANK_MM = 3.0  # least length above the equator, for the gel that bulges
SIZE_MM = 9.0


@dataclass(frozen=True)
class Indenter:
    """A rigid indenter: tips with their shanks on one back plate, and a stem.

    name: what the user typed, normalised (`sphere:10`, `4dots`).
    tips: what touches the gel; outside all of them the indenter is out of reach.
    stem_diameter_mm: the stem that fits the stage's tool holder.
    stem_flat_at_mm: the stem's flat from its axis, on the side of the tips' +x and over the whole
        length: it clocks the tips in the tool holder. The same for all.
    reach_mm: free length from the lowest point up to the back plate, that is, the depth to which
        tips and shanks alone can be pressed.
    """

    name: str
    tips: tuple[Tip, ...]
    stem_diameter_mm: float = 6.0
    stem_length_mm: float = 20.0
    stem_flat_at_mm: float = 2.2
    reach_mm: float = REACH_MM

    @property
    def slug(self) -> str:
        """The name as it may stand in a file name."""
        return self.name.replace(":", "-").replace(".", "p")

    @property
    def footprint_half_mm(self) -> tuple[float, float]:
        """Half sides of the box around the tips as seen along z (x, y)."""
        return (
            max(abs(t.x_mm) + t.half_mm[0] for t in self.tips),
            max(abs(t.y_mm) + t.half_mm[1] for t in self.tips),
        )

    @property
    def equator_mm(self) -> float:
        """Depth at which the first tip is in up to where its sides turn vertical.

        A model of the gel's face as a height field ends there; the indenter itself goes on.
        """
        return min(t.equator_mm for t in self.tips)

    def height_mm(self, x_mm: Field, y_mm: Field) -> Field:
        """Height of the indenter's underside above its lowest point, inf where there is none.

        x_mm, y_mm: arrays of one shape, relative to the indenter's axis. Returns that shape. Shanks
        and back plate are not in it: they are out of sight from below or further away.
        """
        height = np.full(np.broadcast(x_mm, y_mm).shape, np.inf)
        for tip in self.tips:
            height = np.minimum(height, tip.height_mm(x_mm, y_mm))
        return height


def sphere(diameter_mm: float) -> Indenter:
    """A sphere, as in the paper's force calibration (10, 12, 15, 18 and 22 mm)."""
    radius_mm = diameter_mm / 2
    reach_mm = max(REACH_MM, radius_mm + SHANK_MM)
    tip = SphereTip(0.0, 0.0, radius_mm)
    return Indenter(f"sphere:{diameter_mm:g}", (tip,), reach_mm=reach_mm)


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


# Each takes the factor by which the default of SIZE_MM is scaled.
_SCALED: dict[str, Callable[[float], Indenter]] = {
    "4dots": lambda s: four_dots(2.0 * s, 5.0 * s),
    "2dots": lambda s: two_dots(2.0 * s, 5.0 * s),
    "edges": lambda s: edges(5.5 * s, 1.75 * s, 5.5 * s),
    "ellipsoid": lambda s: ellipsoid(4.5 * s, 3.0 * s),
    "hexprism": lambda s: hexprism(4.5 * s),
    "star": lambda s: star(4.5 * s, 2.25 * s),
    "cylinder": lambda s: cylinder(4.5 * s),
    "ring": lambda s: ring(4.5 * s, 1.5 * s),
    "hat": lambda s: hat(4.5 * s, 2.475 * s, 2.7 * s),
}
KINDS = ("sphere", *_SCALED)


def parse(name: str) -> Indenter:
    """Read an indenter's name: `sphere:DIAMETER`, or one of KINDS with or without `:SIZE`.

    SIZE is the longest side of the footprint in mm, 9 by default. Raises InputError with the
    nearest name or the sizes that are valid.
    """
    kind, colon, size = name.strip().partition(":")
    if kind == "sphere":
        diameter_mm = _size(size)
        if not 0.5 <= diameter_mm <= 30.0:
            raise InputError(
                f"indenter {name!r}: a sphere takes a diameter of 0.5 to 30 mm, as in 'sphere:10'"
            )
        return sphere(diameter_mm)
    if kind not in _SCALED:
        near = difflib.get_close_matches(kind, KINDS, n=1)
        valid = f"valid: sphere:DIAMETER_MM, and with or without :SIZE_MM {', '.join(_SCALED)}"
        hint = f"did you mean {near[0]!r}?" if near else valid
        raise InputError(f"indenter {name!r}: unknown; {hint}")
    if not colon:
        return _SCALED[kind](1.0)
    size_mm = _size(size)
    if not 5.0 <= size_mm <= 20.0:
        raise InputError(
            f"indenter {name!r}: the longest side of its footprint is 5 to 20 mm, as in "
            f"'{kind}:{SIZE_MM:g}'"
        )
    scaled = _SCALED[kind](size_mm / SIZE_MM)
    return scaled if size_mm == SIZE_MM else replace(scaled, name=f"{kind}:{size_mm:g}")


def _size(text: str) -> float:
    """A size as it is written in a name, so that one name is one shape; NaN when it is none."""
    try:
        return float(f"{float(text):g}")
    except ValueError:
        return math.nan
