"""Which number to change, and which way, so that what failed passes: found by trying each alone.

No words of a check say it: whatever gives a margin for a design (at least 0 where it passes) can
ask. First come numbers that stand away from their defaults and whose default mends the failure;
only where there are none every number is moved.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from typing import Any

from ...shapes.bounded import ShapeError, is_unverified
from ..dimensions import Design

Margin = Callable[[Design], float]
SLACK = 1e-9
NAMED = 3  # a line has room for no more
STEP = 0.01
# What a machine can do, and the room there is, are not changed to please a check.
GIVEN = ("resin_printer", "laser", "envelope", "drawing")


def advice(design: Design, margin: Margin, try_all: bool = True) -> str:
    """`shell.wall_mm: 0.6 or more`, the least change first; empty where no single number helps.

    try_all: also what has its default.
    """
    keys = list(_keys(design))
    # A margin that is arithmetic costs nothing; one on solids costs a part a step.
    steps = 30 if try_all else 8
    found = [text for key in keys if (text := _back(design, margin, steps, *key))]
    if not found and try_all:
        moved = [m for key in keys if (m := _moved(design, margin, *key)) is not None]
        found = [text for _, text in sorted(moved, key=lambda m: m[0])]
    return ", ".join(found[:NAMED])


def _with_key(design: Design, section: str, key: str, value: Any) -> Design | None:
    """The design with another value; None where its record does not allow it."""
    try:
        return replace(design, **{section: replace(getattr(design, section), **{key: value})})
    except ShapeError:
        return None


def _keys(design: Design) -> Iterator[tuple[str, Any]]:
    for section in fields(design):
        for f in fields(getattr(design, section.name)):
            yield section.name, f


def _holds(design: Design | None, margin: Margin) -> bool:
    return design is not None and margin(design) >= -SLACK


def _back(design: Design, margin: Margin, steps: int, section: str, f: Any) -> str:
    """A key that left its default: how far it must go back."""
    value, right = getattr(getattr(design, section), f.name), f.default
    if value == right or not _holds(_with_key(design, section, f.name, right), margin):
        return ""
    if not _is_number(value):
        return f"{section}.{f.name}: {right}"
    wrong, kind = value, type(right)
    for _ in range(steps):
        middle = kind((wrong + right) / 2)
        if middle in (wrong, right):
            break
        if _holds(_with_key(design, section, f.name, middle), margin):
            right = middle
        else:
            wrong = middle
    return _text(section, f.name, value, right)


def _moved(design: Design, margin: Margin, section: str, f: Any) -> tuple[float, str] | None:
    """The change of one number that mends the failure, as a share of it, and how to say it."""
    value, bounds = getattr(getattr(design, section), f.name), f.metadata
    if not _is_number(value) or "ge" not in bounds or section in GIVEN or is_unverified(f):
        return None
    whole = isinstance(value, int)
    at, have = value, margin(design)
    step = 1 if whole else max(abs(value) * STEP, STEP)
    for _ in range(6):
        changed = next(
            (d for s in (step, -step) if (d := _with_key(design, section, f.name, at + s))), None
        )
        if changed is None:
            return None
        there = getattr(getattr(changed, section), f.name)
        slope = (margin(changed) - have) / (there - at)
        if not math.isfinite(slope) or abs(slope) < SLACK:
            return None
        wanted = at - 1.001 * have / slope
        wanted = min(max(wanted, bounds["ge"]), bounds["le"])
        if whole:
            wanted = (math.ceil if wanted > value else math.floor)(wanted)
        moved = _with_key(design, section, f.name, wanted)
        if moved is None:
            return None
        if _holds(moved, margin):
            share = abs(wanted - value) / max(abs(value), abs(wanted), STEP)
            return share, _text(section, f.name, value, wanted)
        if wanted == at:
            return None
        at, have = wanted, margin(moved)
    return None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _text(section: str, key: str, value: float, right: float) -> str:
    """Rounded away from the wrong value, to three figures."""
    more = right > value
    if isinstance(right, float):
        unit = 10.0 ** (math.floor(math.log10(abs(right))) - 2) if right else 1.0
        right = (math.ceil if more else math.floor)(round(right / unit, 6)) * unit
    return f"{section}.{key}: {right:.6g} or {'more' if more else 'less'}"
