"""One inequality, and what is raised when it does not hold."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from ..errors import InputError

Side = tuple[str, float]
SLACK = 1e-9  # sums of decimal fractions
SHOWN = 4  # one line has room for no more


@dataclass(frozen=True)
class Rule:
    """`left < right` or `left <= right`, of one part; NaN fails.

    rests_on: keys of unverified values that it uses.
    """

    part: str
    left: Side
    relation: Literal["<", "<="]
    right: Side
    rests_on: tuple[str, ...] = ()

    @property
    def holds(self) -> bool:
        """Whether it holds, `<=` to rounding."""
        a, b = self.left[1], self.right[1]
        return a < b - SLACK if self.relation == "<" else a <= b + SLACK

    @property
    def text(self) -> str:
        """The inequality in words and in numbers."""
        a, b = self.left, self.right
        return f"{a[0]} {self.relation} {b[0]}: {a[1]:.4g} {self.relation} {b[1]:.4g}"


def enforce(rules: Iterable[Rule], source: str = "") -> None:
    """Raise InputError in one line with the first rules that fail, unless all hold."""
    broken = [f"{rule.part}: {rule.text} fails" for rule in rules if not rule.holds]
    if broken:
        more = len(broken) - SHOWN
        told = broken[:SHOWN] + ([f"and {more} more"] if more > 0 else [])
        raise InputError((f"{source}: " if source else "") + " | ".join(told))
