"""What a drawing is made of, as data: what part and lab say of it, and what is around its views.

Views: `front` looks along +y, `top` along -z, `left` along +x; a part whose drawing is `flipped` is
turned half about x first, so that its back or its tips are seen from above.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import partial
from typing import Any, Literal

from deltact_fab.common import Point
from deltact_fab.sensor import Bounded, ShapeError

Side = Literal["left", "right", "top", "bottom"]
LONGEST = 60  # characters of a line of the title block


def shown(value_mm: float) -> str:
    """A length as it is printed: hundredths, no trailing zeros."""
    return f"{round(value_mm, 2) + 0.0:.2f}".rstrip("0").rstrip(".")


def toleranced(value_mm: float, off_mm: float = 0.0) -> str:
    """A length with what it may be off (ISO 129-1), `3 ±0.1`; 0: the general tolerance holds."""
    return shown(value_mm) + (f" ±{shown(off_mm)}" if off_mm else "")


@dataclass(frozen=True)
class Linear:
    """A distance between two points of the part, along the paper's horizontal (top, bottom) or
    vertical, and what is printed of it.
    """

    view: str
    a: Point
    b: Point
    side: Side
    words: str


@dataclass(frozen=True)
class Leader:
    """A label and an arrow to a circle of radius_mm about a point, or to the point itself (0)."""

    view: str
    at: Point
    radius_mm: float
    words: str
    side: Literal["left", "right"] = "right"


@dataclass(frozen=True)
class CentreLine:
    """A centre line between two points, drawn beyond_mm beyond both on the paper."""

    view: str
    a: Point
    b: Point
    beyond_mm: float = 2.0


Item = Linear | Leader | CentreLine


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
        """Its length."""
        return abs(self.b_mm - self.a_mm)

    def words(self, off_mm: float) -> str:
        """What is printed; off_mm: what a fitted length may be off."""
        length = toleranced(self.value_mm, off_mm if self.fitted else 0.0)
        words = f"{self.before}{length}{self.after}"
        return f"({words})" if self.auxiliary else words


# A length along one axis that fits something.
x_of, y_of, z_of = (partial(Told, axis) for axis in range(3))


@dataclass(frozen=True)
class Callouts:
    """What a part's own file says of its drawing; every other length is read off the solid.

    lengths: that fit something, or that a machinist must see as such. rounds: by diameter in mm,
    what its label adds. fitted: diameters with limits of their own. labels: for faces that are
    neither flat nor round. axes: (axis, coordinate) of places where the same features stand.
    cut_x_mm: section A-A in place of the left view, the plane x = cut_x_mm seen from -x. rests_on:
    unverified keys that the part is made from; those still open are named on the drawing.
    """

    lengths: tuple[Told, ...] = ()
    rounds: Mapping[float, str] = field(default_factory=dict)
    fitted: tuple[float, ...] = ()
    notes: tuple[str, ...] = ()
    labels: tuple[Leader, ...] = ()
    axes: tuple[tuple[int, float], ...] = ()
    cut_x_mm: float | None = None
    flipped: bool = False
    rests_on: tuple[str, ...] = ()


def _line(meaning: str) -> Any:
    """A line of the title block, empty until somebody gives it."""
    return field(default="", metadata={"description": meaning})


@dataclass(frozen=True)
class TitleBlock(Bounded):
    """The title block's fields that come from the lab, never from a clock: equal bytes stay equal.

    An empty one is drawn as a dash.
    """

    number: str = _line("drawing number; a part's is this, a hyphen and its name")
    revision: str = _line("revision, as in A or 02")
    date: str = _line("date of issue, as in 2026-11-23")
    owner: str = _line("legal owner: the lab")
    drawn_by: str = _line("who made it")
    approved_by: str = _line("who approved it")

    def __post_init__(self) -> None:
        for f in fields(self):
            if not (said := getattr(self, f.name)):
                continue
            from ...pdf import width_em  # opens the font

            if len(said) > LONGEST or not said.isprintable():
                raise ShapeError(
                    f"{f.name}: one line of at most {LONGEST} characters: {said!r} fails"
                )
            try:
                width_em(said)
            except ValueError as why:
                raise ShapeError(f"{f.name}: {why}; expected Latin letters") from why
