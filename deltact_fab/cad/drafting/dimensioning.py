"""What can stand around a view, as data: dimensions, labels, centre lines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from .projection import Vector, View

Side = Literal["left", "right", "top", "bottom"]


def shown(value_mm: float) -> str:
    """A length as it is printed: hundredths, no trailing zeros."""
    return f"{round(value_mm, 2) + 0.0:.2f}".rstrip("0").rstrip(".")


@dataclass(frozen=True)
class Linear:
    """A distance between two points, along the paper's horizontal (top, bottom) or vertical.

    a, b: points in the part's frame, in mm; the printed value is their distance. before, after:
    what stands around it (`Ø`, `(2×)`).
    """

    view: str
    a: Vector
    b: Vector
    side: Side
    before: str = ""
    after: str = ""

    def value_mm(self, view: View) -> float:
        """The distance as it is printed."""
        along = 0 if self.side in ("top", "bottom") else 1
        return float(abs(view.flat(self.b)[along] - view.flat(self.a)[along]))

    def words(self, view: View) -> str:
        """What is printed."""
        return f"{self.before}{shown(self.value_mm(view))}{self.after}"


@dataclass(frozen=True)
class Leader:
    """A label and an arrow to a circle of radius_mm about a point, or to the point itself (0)."""

    view: str
    at: Vector
    radius_mm: float
    words: str
    side: Literal["left", "right"] = "right"


@dataclass(frozen=True)
class Centres:
    """Centre marks: crosses over circles of radius_mm."""

    view: str
    at: tuple[Vector, ...]
    radius_mm: float


@dataclass(frozen=True)
class Circle:
    """A thin circle of radius_mm on which something else lies."""

    view: str
    at: Vector
    radius_mm: float


@dataclass(frozen=True)
class Axis:
    """A centre line between two points, drawn a little beyond both."""

    view: str
    a: Vector
    b: Vector


@dataclass(frozen=True)
class Cut:
    """Section A-A in place of the left view: the plane x = x_mm, seen from -x."""

    x_mm: float


Item = Linear | Leader | Centres | Circle | Axis
