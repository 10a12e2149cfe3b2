"""Data of a drawing: callouts of the part, title block of the lab, items around the views.

Views: `front` looks along +y, `top` along -z, `left` along +x. With `flipped` the part is first
turned by 180 degrees about x, so that its back or its tips are seen from above.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import partial
from typing import Any, Literal

from deltact_fab.common import Point
from deltact_fab.sensor import Bounded, ShapeError

PaperSide = Literal["left", "right", "top", "bottom"]
MAX_TITLE_CHARS = 60  # of one cell, by hand: more text would become unreadably small


def fmt(value_mm: float) -> str:
    """Format a number in hundredths, without trailing zeros."""
    return f"{round(value_mm, 2) + 0.0:.2f}".rstrip("0").rstrip(".")


def toleranced(value_mm: float, off_mm: float = 0.0) -> str:
    """Format a length with its limits (ISO 129-1), `3 ±0.1`; 0: the general tolerance."""
    return fmt(value_mm) + (f" ±{fmt(off_mm)}" if off_mm else "")


@dataclass(frozen=True)
class Linear:
    """A placed dimension between two points, horizontal (side top, bottom) or vertical."""

    view: str
    a: Point
    b: Point
    side: PaperSide
    text: str


@dataclass(frozen=True)
class Leader:
    """A label with an arrow to a circle of radius_mm about a point, or to the point (0).

    alternatives: points of equal features, of which the label may point to any.
    """

    view: str
    point: Point
    radius_mm: float
    text: str
    alternatives: tuple[Point, ...] = ()


@dataclass(frozen=True)
class CentreLine:
    """A centre line between two points, extended by beyond_mm (paper) at both ends."""

    view: str
    a: Point
    b: Point
    beyond_mm: float = 2.0


Item = Linear | Leader | CentreLine


GENERAL_TOLERANCE = "ISO 2768-m"
SCREWS_CUT = "Screws cut their threads in the pilots: do not tap."
SQUARE_EDGES = "Sharp edges broken 0.2 at most."


@dataclass(frozen=True)
class Span:
    """A length along an axis (0, 1, 2) between two coordinates.

    prefix, suffix: text around the number. fitted: shown with the process's limits, because it
    mates with another part. auxiliary: follows from others, printed in brackets.
    """

    axis: int
    a_mm: float
    b_mm: float
    suffix: str = ""
    fitted: bool = True
    prefix: str = ""
    auxiliary: bool = False

    @property
    def value_mm(self) -> float:
        """Absolute length."""
        return abs(self.b_mm - self.a_mm)

    def text(self, off_mm: float) -> str:
        """Text of the dimension; off_mm: limit of a fitted length."""
        length = toleranced(self.value_mm, off_mm if self.fitted else 0.0)
        words = f"{self.prefix}{length}{self.suffix}"
        return f"({words})" if self.auxiliary else words


# A fitted length along one axis.
x_of, y_of, z_of = (partial(Span, axis) for axis in range(3))


@dataclass(frozen=True)
class Callouts:
    """Callouts from the part's own file; every other length is read off the solid.

    lengths: fitted ones, or those a machinist must see. rounds: text added to a label, by
    diameter, mm; the label stands in its braces if it has some. fitted: diameters with limits.
    labels: for faces neither flat nor round. axes: (axis, coordinate) of repeated groups of
    features. cut_x_mm: plane of section A-A, seen from -x, which replaces the left view.
    rests_on: keys the part depends on; unverified ones are named on the drawing.
    """

    lengths: tuple[Span, ...] = ()
    rounds: Mapping[float, str] = field(default_factory=dict)
    fitted: tuple[float, ...] = ()
    notes: tuple[str, ...] = ()
    labels: tuple[Leader, ...] = ()
    axes: tuple[tuple[int, float], ...] = ()
    cut_x_mm: float | None = None
    flipped: bool = False
    rests_on: tuple[str, ...] = ()


def _line(meaning: str) -> Any:
    """Field of the title block, empty by default."""
    return field(default="", metadata={"description": meaning})


@dataclass(frozen=True)
class TitleBlock(Bounded):
    """Title block fields of the lab; no clock is read, so equal designs give equal bytes.

    An empty field is drawn as a dash.
    """

    number: str = _line("drawing number; a hyphen and the part's name follow")
    revision: str = _line("revision, such as A or 02")
    date: str = _line("date of issue, such as 2026-11-23")
    owner: str = _line("legal owner: the lab")
    drawn_by: str = _line("author of the drawing")
    approved_by: str = _line("name of the approver")

    def __post_init__(self) -> None:
        for f in fields(self):
            if not (text := getattr(self, f.name)):
                continue
            from ...pdf import width_em  # opens the font

            if len(text) > MAX_TITLE_CHARS or not text.isprintable():
                raise ShapeError(
                    f"{f.name}: expected one line of at most {MAX_TITLE_CHARS} characters: {text!r}"
                )
            try:
                width_em(text)
            except ValueError as error:
                raise ShapeError(f"{f.name}: {error}; expected Latin letters") from error
