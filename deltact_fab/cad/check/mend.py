"""What mends a row that fails on solids: the check again, with one key put back at a time.

Only keys that stand away from their defaults are tried, for each costs a part or two.
"""

from __future__ import annotations

from collections.abc import Iterable
from types import SimpleNamespace
from typing import Any

from ...errors import DeltactFabError
from ..assembly import assemble, common_mm3
from ..dimensions import Design
from ..registry import of_design
from . import bending, space, thickness
from .advice import advice
from .built import BuiltDesign
from .row import Row, change


def mended(row: Row, design: Design) -> Row:
    """The row, with what to change where a key that left its default explains it."""
    measure = {
        thickness.NAME: _wall,
        space.INTERFERENCE: _clash,
        space.ENVELOPE: _envelope,
        **dict.fromkeys(bending.NAMES, _bends),
    }.get(row.check)
    if row.passed or measure is None:
        return row

    def margin(changed: Design) -> float:
        try:
            return 0.0 if measure(row, changed) else -1.0
        except DeltactFabError:
            return -1.0

    return change(row, advice(design, margin, try_all=False))


def _wall(row: Row, design: Design) -> bool:
    name = row.part.partition(",")[0]
    part = next(p for p in of_design() if p.name == name)
    built = BuiltDesign(design, tuple(of_design(design)))
    return _holds(row, thickness.of_part(built, part))


def _clash(row: Row, design: Design) -> bool:
    names = row.part.split(", ")
    pieces = assemble(design, parts=[p for p in of_design(design) if p.name in names])
    one, other = ([p for p in pieces if p.part.name == name] for name in names)
    return all(common_mm3(a, b) <= space.TOUCH_MM3 for a in one for b in other)


def _envelope(row: Row, design: Design) -> bool:
    room = design.envelope
    sides = (room.width_mm, room.length_mm, room.height_mm)
    return all(a <= b + space.SLACK_MM for a, b in zip(design.outer_mm, sides, strict=True))


def _bends(row: Row, design: Design) -> bool:
    of_plate: Any = SimpleNamespace(design=design)
    return _holds(row, bending.rows(of_plate))


def _holds(row: Row, again: Iterable[Row]) -> bool:
    return any(r.passed for r in again if (r.check, r.part) == (row.check, row.part))
