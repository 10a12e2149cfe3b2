"""What a part knows of its drawing that its solid does not tell: fits, words, notes, the section.

Views: `front` looks along +y, `top` along -z, `left` along +x; a part whose drawing is `flipped` is
turned half about x first, so that its back or its tips are seen from above.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from .dimensioning import Cut, Detail, Leader

GENERAL_TOLERANCE = "ISO 2768-m"
SQUARE_EDGES = "Sharp edges broken 0.2 at most."


@dataclass(frozen=True)
class Told:
    """A length along an axis (0, 1, 2) from a coordinate to another one.

    before, after: what stands around it. fitted: it carries the limits of what makes the part, for
    it fits something. auxiliary: it follows from others and is bracketed.
    """

    axis: int
    a_mm: float
    b_mm: float
    after: str = ""
    fitted: bool = True
    before: str = ""
    auxiliary: bool = False

    @property
    def value_mm(self) -> float:
        """What is printed."""
        return abs(self.b_mm - self.a_mm)


def x_of(a_mm: float, b_mm: float, after: str = "", fitted: bool = True) -> Told:
    """A length along x that fits something."""
    return Told(0, a_mm, b_mm, after, fitted)


def y_of(a_mm: float, b_mm: float, after: str = "", fitted: bool = True) -> Told:
    """A length along y that fits something."""
    return Told(1, a_mm, b_mm, after, fitted)


def z_of(a_mm: float, b_mm: float, after: str = "", fitted: bool = True) -> Told:
    """A length along z that fits something."""
    return Told(2, a_mm, b_mm, after, fitted)


@dataclass(frozen=True)
class Callouts:
    """What a part's own file says of its drawing; every other length is read off the solid.

    lengths: that fit something, or that a machinist must see as such. rounds: by diameter in mm,
    what its label adds. fitted: diameters with limits of their own. labels: for faces that are
    neither flat nor round. axes: (axis, coordinate) of places where the same features stand. cut:
    section A-A in place of the left view. rests_on: unverified keys that the part is made from;
    those still open are named on the drawing. details: parts of views drawn larger.
    """

    lengths: tuple[Told, ...] = ()
    rounds: Mapping[float, str] = field(default_factory=dict)
    fitted: tuple[float, ...] = ()
    notes: tuple[str, ...] = ()
    labels: tuple[Leader, ...] = ()
    axes: tuple[tuple[int, float], ...] = ()
    cut: Cut | None = None
    flipped: bool = False
    rests_on: tuple[str, ...] = ()
    details: tuple[Detail, ...] = ()
