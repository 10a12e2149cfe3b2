"""What can stand around a view, as data: dimensions, labels, centre lines."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Literal

from ...aliases import Vector
from .projection import View

Side = Literal["left", "right", "top", "bottom"]
Limits = tuple[float, float]


_DIGITS: ContextVar[int] = ContextVar("digits", default=2)


def shown(value_mm: float) -> str:
    """A length as it is printed: hundredths, no trailing zeros."""
    digits = _DIGITS.get()
    return f"{round(value_mm, digits) + 0.0:.{digits}f}".rstrip("0").rstrip(".")


@contextmanager
def exactly() -> Iterator[None]:
    """Inside, lengths are printed with ten digits: for what compares drawings, not for paper."""
    token = _DIGITS.set(10)
    try:
        yield
    finally:
        _DIGITS.reset(token)


def toleranced(value_mm: float, limits: Limits | None = None) -> str:
    """A length with its own limits (ISO 129-1): `35.8 +0.1/−0.05`, `3 ±0.1`, `35.8 0/−0.1`.

    limits: lower and upper deviation in mm; None where the general tolerance holds. Raises
    ValueError when the lower one is above the upper one.
    """
    if limits is None:
        return shown(value_mm)
    low, high = limits
    if low > high:
        raise ValueError(f"limits: lower {low} above upper {high}")
    if shown(-low) == shown(high):
        return f"{shown(value_mm)} ±{shown(high)}"
    return f"{shown(value_mm)} {_deviation(high)}/{_deviation(low)}"


def _deviation(value_mm: float) -> str:
    size = shown(abs(value_mm))
    if size == "0":
        return size
    return f"+{size}" if value_mm > 0 else f"−{size}"


@dataclass(frozen=True)
class Linear:
    """A distance between two points, along the paper's horizontal (top, bottom) or vertical.

    a, b: points in the part's frame, in mm; the printed value is their distance. before, after:
    what stands around it (`Ø`, `(2×)`). limits: lower and upper deviation in mm where the length
    does not go by the general tolerance. auxiliary: it follows from others and is bracketed.
    """

    view: str
    a: Vector
    b: Vector
    side: Side
    before: str = ""
    after: str = ""
    limits: Limits | None = None
    auxiliary: bool = False

    def value_mm(self, view: View) -> float:
        """The distance as it is printed."""
        along = 0 if self.side in ("top", "bottom") else 1
        return float(abs(view.flat(self.b)[along] - view.flat(self.a)[along]))

    def words(self, view: View) -> str:
        """What is printed."""
        words = f"{self.before}{toleranced(self.value_mm(view), self.limits)}{self.after}"
        return f"({words})" if self.auxiliary else words


@dataclass(frozen=True)
class Leader:
    """A label and an arrow to a circle of radius_mm about a point, or to the point itself (0).

    flatness_mm: width of the zone that the surface there lies in, in a frame of its own
    (ISO 1101). roughness_um: Ra (ISO 21920). 0 leaves either out.
    """

    view: str
    at: Vector
    radius_mm: float
    words: str
    side: Literal["left", "right"] = "right"
    flatness_mm: float = 0.0
    roughness_um: float = 0.0


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


@dataclass(frozen=True)
class Detail:
    """What a circle of radius_mm about a point of a view holds, drawn larger beside the views.

    letter: its name, which is also the `view` of the items that stand around it.
    """

    letter: str
    view: str
    at: Vector
    radius_mm: float


Item = Linear | Leader | Centres | Circle | Axis
