"""What must hold between dimensions: an inequality of nominal values, and a pair of parts that go
together with the least and most play that their makers leave.

That is the worst case: every length at that limit which is worst, all at once. No statistics: a lab
makes one sensor, and that one has to go together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from deltact_fab.common import Check, graded

RULE_SLACK = 1e-9  # sums of decimal fractions
MAX_SHOWN_RULES = 4  # one line has room for no more


def below(
    id: str, name: str, a: float, limit_name: str, b: float, rests_on: tuple[str, ...] = ()
) -> Check:
    """The check that a is less than b, each with its name; NaN fails.

    id: unique among the rules of its part. rests_on: keys of unverified values that it uses.
    """
    status = graded(a < b - RULE_SLACK)
    return Check(id, f"{name} < {limit_name}", "", a, b, status, rests_on, sign="<", margin=b - a)


def at_most(
    id: str, name: str, a: float, limit_name: str, b: float, rests_on: tuple[str, ...] = ()
) -> Check:
    """The check that a is no more than b, to rounding; else as `below`."""
    status = graded(a <= b + RULE_SLACK)
    return Check(id, f"{name} <= {limit_name}", "", a, b, status, rests_on, sign="<=", margin=b - a)


def statement(rule: Check) -> str:
    """An inequality in words and in numbers."""
    return f"{rule.name}: {rule.value:.4g} {rule.sign} {rule.limit:.4g}"


def first_of(texts: Sequence[str], between: str) -> str:
    """The first SHOWN texts, and how many more there are."""
    rest = len(texts) - MAX_SHOWN_RULES
    return between.join([*texts[:MAX_SHOWN_RULES], *([f"and {rest} more"] if rest > 0 else [])])


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

    id: unique among the fits of its part. name: what goes where. parts: whose it is, by commas.
    least_mm: the play that must be left when all lengths are at their worst.
    """

    id: str
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

    def check(self) -> Check:
        """Least and most play, every length at its worst, against the least; NaN fails."""
        low, high = self.range_mm
        lengths = (*self.room, *self.body)
        return Check(
            self.id, "fit at its limits", self.parts,
            f"{self.name}: {round(low, 3) + 0.0:.3f} to {high:.3f} mm",
            f">= {self.least_mm:g} mm",
            graded(low >= self.least_mm - RULE_SLACK),
            tuple(dict.fromkeys(key for length in lengths for key in length.rests_on)),
            margin=low - self.least_mm,
        )  # fmt: skip
