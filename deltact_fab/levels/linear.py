"""What a linear level of the gel says of itself; a file of this folder makes one.

The numbers are measured; docs/evidence/gel.md holds the tables they are read from.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..elasticity.face import FaceOperator
    from ..elasticity.material import GelMaterial
    from ..shapes import SkinDimensions

TIP_FORCE = 1.05  # x (poisson - EVEN_POISSON) x depth/contact radius: too stiff above it
EVEN_POISSON = 0.42
BEND_FORCE = 1.0  # x (depth/thickness)^2, of the force: too soft
SPREAD_FORCE = 0.02  # x depth/contact radius: what the two do not tell
# x depth^2 sqrt(pi/face): first + second x (contact radius/thickness)^2.
BEND_IN_PLANE = (0.13, 0.4)
MIN_IN_PLANE = 0.002  # x depth: what the reference, a disc for the block, tells apart


@dataclass(frozen=True)
class PressScales:
    """A press in the numbers that a level's errors follow from (mm, mm2).

    depth_mm > 0. radius_mm: of the largest circle in the contact; wide_mm: of one as large as the
    box around it. sides_mm: from where the tip goes to the four sides of the gel.
    """

    depth_mm: float
    thickness_mm: float
    radius_mm: float
    wide_mm: float
    sides_mm: tuple[float, ...]
    face_mm2: float
    poisson: float


Errors = tuple[float, float]
"""Of force, relative, and in plane, mm rms over the face."""


@dataclass(frozen=True)
class LinearLevel:
    """about: what it leaves out, one line for whoever reads a run.

    face: skin, material and spacing (mm) to the operator of its face. errors: what it leaves out.
    refusal: why it cannot have a material, None where it can; no such function: it takes any.
    rank: `auto` tries the lowest first; None: only when it is asked for.
    """

    about: str
    face: Callable[[SkinDimensions, GelMaterial, float], FaceOperator]
    errors: Callable[[PressScales], Errors]
    refusal: Callable[[GelMaterial], str | None] | None = None
    rank: int | None = None


def large_strain(touch: PressScales) -> Errors:
    """What every linear level leaves out: large strain under the tip, and over the thickness.

    The first is of the order depth/contact radius, with a sign that Poisson's ratio sets.
    """
    depth, steep = touch.depth_mm, touch.depth_mm / touch.radius_mm
    tip = TIP_FORCE * (touch.poisson - EVEN_POISSON) * steep
    bend = BEND_FORCE * (depth / touch.thickness_mm) ** 2
    # Of opposite signs, they are not relied on to cancel.
    force = max(tip, bend + max(-tip, 0.0)) + SPREAD_FORCE * steep
    in_plane = BEND_IN_PLANE[0] + BEND_IN_PLANE[1] * (touch.radius_mm / touch.thickness_mm) ** 2
    in_plane *= depth**2 * math.sqrt(math.pi / touch.face_mm2)
    return force, in_plane + MIN_IN_PLANE * depth
