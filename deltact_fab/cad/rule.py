"""What must hold between dimensions: an inequality of nominal values, and a pair of parts that go
together with the least and most play that their makers leave.

That is the worst case: every length at that limit which is worst, all at once. No statistics: a lab
makes one sensor, and that one has to go together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

SLACK = 1e-9  # sums of decimal fractions
SHOWN = 4  # one line has room for no more


@dataclass(frozen=True)
class Rule:
    """An inequality in words and in numbers, and whether it holds; NaN does not.

    value, limit: its smaller and its larger side. rests_on: keys of unverified values that it uses.
    part: whose it is; where empty, that part's which states it.
    """

    text: str
    holds: bool
    value: float
    limit: float
    rests_on: tuple[str, ...] = ()
    part: str = ""


def below(name: str, a: float, other: str, b: float, rests_on: tuple[str, ...] = ()) -> Rule:
    """The rule that a is less than b, each with its name."""
    return Rule(f"{name} < {other}: {a:.4g} < {b:.4g}", a < b - SLACK, a, b, rests_on)


def at_most(name: str, a: float, other: str, b: float, rests_on: tuple[str, ...] = ()) -> Rule:
    """The rule that a is no more than b, to rounding."""
    return Rule(f"{name} <= {other}: {a:.4g} <= {b:.4g}", a <= b + SLACK, a, b, rests_on)


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
