"""What a part's drawing says beside its lines, and short ways to say it.

Views: `front` looks along +y, `top` along -z, `left` along +x; a part whose drawing is `flipped` is
turned half about x first, so that its back or its tips are seen from above.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from .dimensioning import Centres, Cut, Detail, Item, Leader, Limits, Linear, Side, toleranced

GENERAL_TOLERANCE = "ISO 2768-m"
SQUARE_EDGES = "Sharp edges broken 0.2 at most."


@dataclass(frozen=True)
class Callouts:
    """A part's dimensions and notes.

    cut: section A-A in place of the left view. rests_on: unverified keys that the part is made
    from; those still open are named on the drawing. details: parts of views drawn larger. silent:
    keys of the part's table that make no length on its drawing, with the reason.
    """

    items: tuple[Item, ...]
    notes: tuple[str, ...]
    cut: Cut | None = None
    flipped: bool = False
    rests_on: tuple[str, ...] = ()
    details: tuple[Detail, ...] = ()
    silent: Mapping[str, str] = field(default_factory=dict)


def x_of(view: str, a: float, b: float, side: Side, y: float = 0.0, z: float = 0.0,
       before: str = "", after: str = "", limits: Limits | None = None) -> Linear:  # fmt: skip
    return Linear(view, (a, y, z), (b, y, z), side, before, after, limits)


def y_of(view: str, a: float, b: float, side: Side, x: float = 0.0, z: float = 0.0,
       before: str = "", after: str = "", limits: Limits | None = None) -> Linear:  # fmt: skip
    return Linear(view, (x, a, z), (x, b, z), side, before, after, limits)


def z_of(view: str, a: float, b: float, side: Side, x: float = 0.0, y: float = 0.0,
       before: str = "", after: str = "", limits: Limits | None = None) -> Linear:  # fmt: skip
    return Linear(view, (x, y, a), (x, y, b), side, before, after, limits)


def holes(at: Sequence[tuple[float, float]], z: float, diameter_mm: float, words: str = "",
           side: str = "right", mark: bool = True,
           limits: Limits | None = None) -> Iterator[Item]:  # fmt: skip
    """Crosses on equal holes along z and one label, at the hole nearest to the label."""
    if mark:
        yield Centres("top", tuple((x, y, z) for x, y in at), diameter_mm / 2)
    sign = 1 if side == "right" else -1
    x, y = max(at, key=lambda p: (round(sign * p[0], 6), p[1]))
    count = f"{len(at)}× " if len(at) > 1 else ""
    label = f"{count}Ø{toleranced(diameter_mm, limits)}{words}"
    yield Leader("top", (x, y, z), diameter_mm / 2, label, "right" if sign > 0 else "left")
