"""Rules between dimensions: inequalities of nominal values, and fits of mating parts with their
minimum and maximum play.

Fits are worst case: every length at its worst limit at once. No statistics: a lab makes one sensor,
and that one has to assemble.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from deltact_fab.common import Check, graded

RULE_SLACK = 1e-9  # by hand: rounding in sums of decimal fractions; larger lets a failure pass
MAX_SHOWN_RULES = 4  # by hand: one line has no room for more


def below(
    id: str, name: str, a: float, limit_name: str, b: float, rests_on: tuple[str, ...] = ()
) -> Check:
    """Check that a is less than b, each with its name; NaN fails.

    id: unique among the rules of its part. rests_on: keys of unverified values that it uses.
    """
    status = graded(a < b - RULE_SLACK)
    return Check(id, f"{name} < {limit_name}", "", a, b, status, rests_on, sign="<", margin=b - a)


def at_most(
    id: str, name: str, a: float, limit_name: str, b: float, rests_on: tuple[str, ...] = ()
) -> Check:
    """Check that a is at most b, to rounding; otherwise as `below`."""
    status = graded(a <= b + RULE_SLACK)
    return Check(id, f"{name} <= {limit_name}", "", a, b, status, rests_on, sign="<=", margin=b - a)


def statement(rule: Check) -> str:
    """Format an inequality with names and numbers."""
    return f"{rule.name}: {rule.value:.4g} {rule.sign} {rule.limit:.4g}"


def first_of(texts: Sequence[str], between: str) -> str:
    """Join the first MAX_SHOWN_RULES texts, and the number of further ones."""
    rest = len(texts) - MAX_SHOWN_RULES
    return between.join([*texts[:MAX_SHOWN_RULES], *([f"and {rest} more"] if rest > 0 else [])])


@dataclass(frozen=True)
class Length:
    """A manufactured length in mm: mean and tolerance, +-.

    rests_on: keys of a design that it depends on.
    """

    mean_mm: float
    spread_mm: float = 0.0
    rests_on: tuple[str, ...] = ()

    def half(self) -> Length:
        """Return half the length with half the tolerance."""
        return Length(self.mean_mm / 2, self.spread_mm / 2, self.rests_on)


@dataclass(frozen=True)
class PlayFit:
    """Fit of mating parts: play = sum(room) - sum(body), outer minus inner lengths.

    id: unique among the fits of its part. name: description. parts: comma-separated names.
    least_mm: required minimum play in the worst case.
    """

    id: str
    name: str
    parts: str
    room: tuple[Length, ...]
    body: tuple[Length, ...]
    least_mm: float = 0.0

    @property
    def play_mm(self) -> float:
        """Play of the mean lengths."""
        return sum(a.mean_mm for a in self.room) - sum(b.mean_mm for b in self.body)

    @property
    def spread_mm(self) -> float:
        """Worst-case tolerance of the stack, +-."""
        return sum(length.spread_mm for length in (*self.room, *self.body))

    @property
    def range_mm(self) -> tuple[float, float]:
        """Minimum and maximum play."""
        return self.play_mm - self.spread_mm, self.play_mm + self.spread_mm

    def check(self) -> Check:
        """Check the worst-case play against least_mm; NaN fails."""
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
