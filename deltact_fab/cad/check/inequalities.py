"""The inequalities between dimensions, one row for each part that they belong to."""

from __future__ import annotations

from collections.abc import Iterator

from ..dimensions import Design
from ..feasibility import rules as all_rules
from ..rule import Rule, first_of
from .row import Row

NAME = "inequalities"


def rows(design: Design) -> Iterator[Row]:
    """A part's rules: how many hold, and the tightest one or those that fail."""
    groups: dict[str, list[Rule]] = {}
    for rule in all_rules(design):
        groups.setdefault(rule.part, []).append(rule)
    for part, rules in groups.items():
        broken = [rule for rule in rules if not rule.holds]
        if broken:
            told = first_of([rule.text for rule in broken], "; ")
            found = f"{len(broken)} of {len(rules)} fail: {told}"
        else:
            found = f"{len(rules)} of {len(rules)} hold, closest: {min(rules, key=_margin).text}"
        rests_on = tuple(dict.fromkeys(key for rule in rules for key in rule.rests_on))
        yield Row(NAME, part, found, "all hold", not broken, rests_on)


def _margin(rule: Rule) -> float:
    """What is left between both sides, as a share of the larger one."""
    left, right = rule.left.value, rule.right.value
    return (right - left) / max(abs(left), abs(right), 1e-9)
