"""Inequalities between dimensions, checked before the kernel runs: it fails silently on most.

Each states itself with its numbers, so that a refusal says what to change.
"""

from __future__ import annotations

from collections.abc import Iterator

from ..dimensions import Design
from ..standards import CAP_SCREWS
from . import inner, outer, tools, view
from .rule import SHOWN, Rule, enforce

__all__ = ["SHOWN", "Rule", "enforce", "of_design", "stock_note"]


def of_design(design: Design) -> list[Rule]:
    """Every rule of the sensor, the mold and the test bench."""
    unverified = set(design.unverified())
    kept = []
    for rule in _all(design):
        rests_on = tuple(key for key in rule.rests_on if key in unverified)
        kept.append(Rule(rule.part, rule.left, rule.relation, rule.right, rests_on))
    return kept


def _all(d: Design) -> Iterator[Rule]:
    # What cannot be made smaller comes first: it is what a reader must hear of.
    yield from inner.camera(d)
    yield from outer.skin(d)
    yield from outer.screw(d)
    yield from outer.shell(d)
    yield from inner.light(d)
    yield from inner.holder(d)
    yield from inner.cover(d)
    yield from view.view(d)
    yield from tools.tools(d)


def stock_note(d: Design) -> str:
    """What to say of a screw length that no shop stocks; empty when it is stocked."""
    row = CAP_SCREWS[d.screw.thread]
    if d.screw.length_mm in row.stock_mm:
        return ""
    longest = row.stock_mm[-1]
    name = f"{d.screw.thread} x {d.screw.length_mm:g}"
    return f"{name} is not stocked; the longest sold is {longest:g} mm"
