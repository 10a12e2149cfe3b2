"""What must hold between dimensions: an inequality of nominal values, and a pair of parts that go
together with the least and most play that their makers leave.

That is the worst case: every length at that limit which is worst, all at once. No statistics: a lab
makes one sensor, and that one has to go together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

SLACK = 1e-9  # sums of decimal fractions
SHOWN = 4  # one line has room for no more


@dataclass(frozen=True)
class Quantity:
    """One side of an inequality: what it is called, and its value."""

    name: str
    value: float

    def below(self, name: str, value: float, rests_on: tuple[str, ...] = ()) -> Rule:
        """The rule that it is less than another one."""
        return Rule(self, "<", Quantity(name, value), rests_on)

    def at_most(self, name: str, value: float, rests_on: tuple[str, ...] = ()) -> Rule:
        """The rule that it is no more than another one."""
        return Rule(self, "<=", Quantity(name, value), rests_on)


@dataclass(frozen=True)
class Rule:
    """`left < right` or `left <= right`; NaN fails.

    rests_on: keys of unverified values that it uses. part: whose it is; where empty, that part's
    which states it.
    """

    left: Quantity
    relation: Literal["<", "<="]
    right: Quantity
    rests_on: tuple[str, ...] = ()
    part: str = ""

    @property
    def holds(self) -> bool:
        """Whether it holds, `<=` to rounding."""
        a, b = self.left.value, self.right.value
        return a < b - SLACK if self.relation == "<" else a <= b + SLACK

    @property
    def text(self) -> str:
        """The inequality in words and in numbers."""
        a, b = self.left, self.right
        return f"{a.name} {self.relation} {b.name}: {a.value:.4g} {self.relation} {b.value:.4g}"


def first_of(texts: Sequence[str], between: str) -> str:
    """The first SHOWN texts, and how many more there are."""
    more = len(texts) - SHOWN
    return between.join([*texts[:SHOWN], *([f"and {more} more"] if more > 0 else [])])


@dataclass(frozen=True)
class Length:
    """A length as it is made: where it lies about, and what it may be off either way, in mm.

    rests_on: keys of the figures that this rests on.
    """

    mean_mm: float
    spread_mm: float = 0.0
    rests_on: tuple[str, ...] = ()

    def half(self) -> Length:
        """Half of it, with half of what it may be off."""
        return Length(self.mean_mm / 2, self.spread_mm / 2, self.rests_on)


@dataclass(frozen=True)
class PlayFit:
    """Play = what the inner lengths leave of the outer ones = sum(room) - sum(body).

    name: what goes where. parts: whose it is, by commas.
    least_mm: the play that must be left when all lengths are at their worst.
    """

    name: str
    parts: str
    room: tuple[Length, ...]
    body: tuple[Length, ...]
    least_mm: float = 0.0

    @property
    def play_mm(self) -> float:
        """Play of the lengths as they are made on average."""
        return sum(a.mean_mm for a in self.room) - sum(b.mean_mm for b in self.body)

    @property
    def spread_mm(self) -> float:
        """What it may be off either way: the sum of all."""
        return sum(length.spread_mm for length in (*self.room, *self.body))

    @property
    def range_mm(self) -> tuple[float, float]:
        """Least and most play."""
        return self.play_mm - self.spread_mm, self.play_mm + self.spread_mm

    @property
    def holds(self) -> bool:
        """Whether the least play is enough; NaN is not."""
        return self.range_mm[0] >= self.least_mm - SLACK

    @property
    def rests_on(self) -> tuple[str, ...]:
        """Keys of the figures that it rests on, each once."""
        lengths = (*self.room, *self.body)
        return tuple(dict.fromkeys(key for length in lengths for key in length.rests_on))
