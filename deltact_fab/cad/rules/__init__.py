"""Inequalities between dimensions, checked before the kernel runs: it fails silently on most.

Each states itself with its numbers, so that a refusal says what to change.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from ..dimensions import BOARD_KEYS, Design
from . import inner, outer, tools, view
from .rule import SHOWN, Rule, enforce

__all__ = ["SHOWN", "Rule", "enforce", "of_design", "stock_note"]


def of_design(design: Design) -> list[Rule]:
    """Every rule of the sensor, the mold and the test bench."""
    unverified = set(design.unverified())
    kept = []
    for rule in _all(design):
        rests_on = tuple(key for key in rule.rests_on if key in unverified)
        kept.append(replace(rule, rests_on=rests_on))
    return kept


def _all(d: Design) -> Iterator[Rule]:
    # What cannot be made smaller comes first: it is what a reader must hear of.
    yield from _on_board(inner.camera(d))
    yield from outer.skin(d)
    yield from outer.screw(d)
    yield from outer.shell(d)
    yield from inner.light(d)
    yield from _on_board(inner.holder(d))
    yield from inner.cover(d)
    yield from view.view(d)
    yield from tools.tools(d)


def _on_board(rules: Iterable[Rule]) -> Iterator[Rule]:
    """Rules that rest on the camera's board, whose outline and holes nobody has measured."""
    for rule in rules:
        yield replace(rule, rests_on=(*rule.rests_on, *BOARD_KEYS))


def stock_note(d: Design) -> str:
    """What to say, and to do, about a screw length that no shop stocks; empty when it is."""
    screw, row = d.screw, d.screw.row
    if screw.length_mm in row.stock_mm:
        return ""
    name = f"{screw.thread} x {screw.length_mm:g} is not stocked"
    longer = next((length for length in row.stock_mm if length > screw.length_mm), None)
    if longer is not None:
        return f"{name}: cut one of {longer:g} mm down and dress the thread"
    longest = row.stock_mm[-1]
    other = "the design screws-16mm" if screw.thread == "M1.6" else f"screw.length_mm={longest:g}"
    return (
        f"{name}; the longest sold is {longest:g} mm: make it from {screw.thread} threaded rod "
        f"with a nut as head (glued on, corners filed to pass the {row.bore_mm:g} mm bore, a slot "
        f"sawn across), or use {other}"
    )
