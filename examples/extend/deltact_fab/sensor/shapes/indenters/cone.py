"""A blunt cone of 45 degrees, for loads that grow with the square of the depth."""

from __future__ import annotations

import math

from ..rigid import Indenter
from ..turned import ProfilePiece, TurnedTip


def cone(radius_mm: float = 4.5, nose_mm: float = 0.6, flank_deg: float = 45.0) -> Indenter:
    """A ball of nose_mm that runs into a straight flank, flank_deg with the horizontal.

    radius_mm: where the flank ends and the shank begins.
    """
    flank = math.radians(flank_deg)
    leaves = nose_mm * math.sin(flank), nose_mm * (1 - math.cos(flank))
    rim = leaves[1] + (radius_mm - leaves[0]) * math.tan(flank)
    profile = (ProfilePiece(leaves, centre_mm=(0.0, nose_mm)), ProfilePiece((radius_mm, rim)))
    return Indenter("cone", (TurnedTip(0.0, 0.0, nose_mm, (0.0, 0.0), profile),))


SHAPES = {"cone": lambda scale: cone(4.5 * scale)}
