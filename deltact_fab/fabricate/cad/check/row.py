"""Basis of a design check, and remedies for a failed check by arithmetic.

The remedy is found by changing one number at a time, from the margin alone (at least 0 where the
check passes) and not from the check's text. Numbers that differ from their default and pass at it
come first; only if there are none is every number varied.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import fields, replace
from typing import Any

from deltact_fab.common import Check, graded
from deltact_fab.sensor import ShapeError

from ..dimensions import Design
from ..parts.camera import BOARD_KEYS
from ..rule import RULE_SLACK

Margin = Callable[[Design], float]
MAX_NAMED_KEYS = 3  # by hand: one line has no room for more
SEARCH_STEP = 0.01  # by hand, first relative step: smaller takes longer, larger may skip a solution
# Properties of machines and the envelope are given: they are no remedies.
FIXED_SECTIONS = ("resin_printer", "laser", "envelope", "drawing")


def shorten_key(key: str) -> str:
    """Shorten a key for display: `camera.focal_length_mm` becomes `focal length`.

    All lengths of the camera's board share one name, and so do all keys of a machine.
    """
    if key in BOARD_KEYS:
        return "camera board"
    if key.startswith(("resin_printer.", "laser.")):
        return key.partition(".")[0].replace("_", " ")
    name = key.rpartition(".")[2]
    return name.removesuffix("_mm").removesuffix("_mpa").replace("_", " ")


def mark_unverified(rows: Iterable[Check], design: Design) -> Iterator[Check]:
    """Reduce the basis of each row to its unverified keys.

    A key that ends in `.` stands for its section.
    """
    for row in rows:
        if row.basis:
            unverified = design.unverified()
            keys = (
                k
                for key in row.basis
                for k in unverified
                if k == key or (key.endswith(".") and k.startswith(key))
            )
            row = replace(row, basis=tuple(dict.fromkeys(keys)))
        yield row


def add_remedies(rows: Callable[[Design], Iterable[Check]], design: Design) -> Iterator[Check]:
    """Add a remedy to each failed row of a check by arithmetic: key and direction to change.

    A changed design without the row counts as unknown (NaN).
    """
    for row in rows(design):
        if row.failed:

            def margin(changed: Design, id: str = row.id) -> float:
                new_margin = next((check.margin for check in rows(changed) if check.id == id), None)
                return math.nan if new_margin is None else new_margin

            row = replace(row, remedy=advice(design, margin))
        yield row


def margin_check(
    id: str, name: str, part: str, value: str, limit: str, margin: float,
    rests_on: tuple[str, ...] = (),
) -> Check:  # fmt: skip
    """Return a check that passes if margin >= 0, to rounding; NaN fails."""
    status = graded(margin >= -RULE_SLACK)
    return Check(id, name, part, value, limit, status, rests_on, margin=margin)


def format_point(point_mm: Iterable[float]) -> str:
    """Format a point as `(16.30, -2.00, -14.00)`; no minus before a zero."""
    return "(" + ", ".join(f"{round(float(v), 2) + 0.0:.2f}" for v in point_mm) + ")"


def advice(design: Design, margin: Margin) -> str:
    """Return e.g. `shell.wall_mm: 0.6 or more`, smallest change first; empty if none helps."""
    keys = [
        _Key(design, margin, section.name, f)
        for section in fields(design)
        for f in fields(getattr(design, section.name))
    ]
    texts = [text for key in keys if (text := key.revert_text())]
    if not texts:
        changes = sorted(change for key in keys if (change := key.nearest_change()))
        texts = [text for _, text in changes]
    return ", ".join(texts[:MAX_NAMED_KEYS])


class _Key:
    """One key of a design, and the margin as a function of it alone."""

    def __init__(self, design: Design, margin: Margin, section: str, f: Any) -> None:
        self._design, self._margin, self._section, self._field = design, margin, section, f
        self._value: Any = getattr(getattr(design, section), f.name)
        self._is_number = isinstance(self._value, int | float) and not isinstance(self._value, bool)

    def _margin_with(self, value: Any) -> float:
        """Return the margin with this value; nan if the value is out of bounds."""
        section = getattr(self._design, self._section)
        try:
            changed = replace(section, **{self._field.name: value})
        except ShapeError:
            return math.nan
        return self._margin(replace(self._design, **{self._section: changed}))

    def revert_text(self) -> str:
        """Return the change towards the default that passes; empty if the default fails too."""
        default = self._field.default
        if self._value == default or not self._margin_with(default) >= -RULE_SLACK:
            return ""
        if not self._is_number:
            return f"{self._section}.{self._field.name}: {default}"
        return self._nearest(default)[1]

    def nearest_change(self) -> tuple[float, str] | None:
        """Return the relative change that passes, with its text; None if there is none."""
        value, bounds = self._value, self._field.metadata
        if not self._is_number or "ge" not in bounds or Design.is_unverified(self._field):
            return None
        if self._section in FIXED_SECTIONS:
            return None
        step = 1 if isinstance(value, int) else max(abs(value) * SEARCH_STEP, SEARCH_STEP)
        better = self._margin_with(value) + RULE_SLACK
        sign = next((s for s in (1, -1) if self._margin_with(value + s * step) > better), 0)
        while sign:
            end = min(max(value + sign * step, bounds["ge"]), bounds["le"])
            if self._margin_with(end) >= -RULE_SLACK:
                return self._nearest(end)
            if end in (bounds["ge"], bounds["le"]):
                break
            step *= 2
        return None

    def _nearest(self, right: Any) -> tuple[float, str]:
        """Return relative change and text of the nearest passing value; `right` passes."""
        wrong = self._value
        for _ in range(30):
            middle = type(right)((wrong + right) / 2)
            if middle in (wrong, right):
                break
            if self._margin_with(middle) >= -RULE_SLACK:
                right = middle
            else:
                wrong = middle
        value = self._value
        share = abs(right - value) / max(abs(value), abs(right), SEARCH_STEP)
        # Rounded to three digits, away from the failing value.
        upward = right > value
        if isinstance(right, float):
            unit = 10.0 ** (math.floor(math.log10(abs(right))) - 2) if right else 1.0
            right = (math.ceil if upward else math.floor)(round(right / unit, 6)) * unit
        name = f"{self._section}.{self._field.name}"
        return share, f"{name}: {right:.6g} or {'more' if upward else 'less'}"
