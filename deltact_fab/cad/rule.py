"""One inequality, and what is raised when it does not hold."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from ..errors import InputError

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


def enforce(rules: Iterable[Rule], source: str = "") -> None:
    """Raise InputError in one line with the first rules that fail, unless all hold."""
    broken = [f"{rule.part}: {rule.text} fails" for rule in rules if not rule.holds]
    if broken:
        raise InputError((f"{source}: " if source else "") + first_of(broken, " | "))
