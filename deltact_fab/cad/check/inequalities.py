"""The inequalities between dimensions, one row for each part that they belong to."""

from __future__ import annotations

import math
from collections.abc import Iterator

from ..dimensions import Design
from ..feasibility import rules as all_rules
from ..rule import Rule, first_of
from .advice import advice
from .row import Row

NAME = "inequalities"


def rows(design: Design) -> Iterator[Row]:
    """A part's rules: how many hold, the tightest one, or those that fail and what mends them."""
    groups: dict[str, list[Rule]] = {}
    for rule in all_rules(design):
        groups.setdefault(rule.part, []).append(rule)
    for part, rules in groups.items():
        broken = [index for index, rule in enumerate(rules) if not rule.holds]
        limit = "all hold"
        if broken:
            told = first_of([rules[index].text for index in broken], "; ")
            found = f"{len(broken)} of {len(rules)} fail: {told}"
            mends = [mend for index in broken if (mend := _mend(design, part, rules, index))]
            limit += f": {first_of(list(dict.fromkeys(mends)), '; ')}" if mends else ""
        else:
            found = f"{len(rules)} of {len(rules)} hold, closest: {min(rules, key=_margin).text}"
        rests_on = tuple(dict.fromkeys(key for rule in rules for key in rule.rests_on))
        yield Row(NAME, part, found, limit, not broken, rests_on)


def _mend(design: Design, part: str, rules: list[Rule], index: int) -> str:
    """What mends one rule; a changed design that has other rules tells nothing."""

    def margin(changed: Design) -> float:
        others = [rule for rule in all_rules(changed) if rule.part == part]
        if len(others) != len(rules):
            return math.nan
        rule = others[index]
        left = rule.right.value - rule.left.value
        return left if rule.holds else min(left, -1e-6)

    return advice(design, margin)


def _margin(rule: Rule) -> float:
    """What is left between both sides, as a share of the larger one."""
    left, right = rule.left.value, rule.right.value
    return (right - left) / max(abs(left), abs(right), 1e-9)
