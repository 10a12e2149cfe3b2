"""What a check of a design rests on; and what mends a failed one of arithmetic on the design.

Which number to change, and which way, is found by trying each alone. No words of a check say it:
whatever gives a margin for a design (at least 0 where it passes) can ask. First come numbers that
stand away from their defaults and whose default mends the failure; only where there are none every
number is moved.
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

Margin = Callable[[Design], float]
SLACK = 1e-9
NAMED = 3  # a line has room for no more
STEP = 0.01
# What a machine can do, and the room there is, are not changed to please a check.
GIVEN = ("resin_printer", "laser", "envelope", "drawing")


def shorten_key(key: str) -> str:
    """Shorten a key to how it is read: `camera.focal_length_mm` is `focal length`.

    The many lengths of the camera's board are one thing to measure, and so is what a machine does.
    """
    if key in BOARD_KEYS:
        return "camera board"
    if key.startswith(("resin_printer.", "laser.")):
        return key.partition(".")[0].replace("_", " ")
    name = key.rpartition(".")[2]
    return name.removesuffix("_mm").removesuffix("_mpa").replace("_", " ")


def mark_unverified(rows: Iterable[Check], design: Design) -> Iterator[Check]:
    """The rows, each with those keys alone as its basis that nobody has measured.

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
    """The rows of arithmetic on a design; one that fails says which key to change, and which way.

    A changed design that lacks the row tells nothing.
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
    """The check of a margin, which is arithmetic on a design; NaN fails."""
    status = graded(margin >= -SLACK)
    return Check(id, name, part, value, limit, status, rests_on, margin=margin)


def format_point(point_mm: Iterable[float]) -> str:
    """A place as `(16.30, -2.00, -14.00)`; no minus before a zero."""
    return "(" + ", ".join(f"{round(float(v), 2) + 0.0:.2f}" for v in point_mm) + ")"


def advice(design: Design, margin: Margin) -> str:
    """`shell.wall_mm: 0.6 or more`, the least change first; empty where no single number helps."""
    keys = [
        _Key(design, margin, section.name, f)
        for section in fields(design)
        for f in fields(getattr(design, section.name))
    ]
    texts = [text for key in keys if (text := key.revert_text())]
    if not texts:
        changes = sorted(change for key in keys if (change := key.nearest_change()))
        texts = [text for _, text in changes]
    return ", ".join(texts[:NAMED])


class _Key:
    """One key of a design, and what a margin becomes when it alone is changed."""

    def __init__(self, design: Design, margin: Margin, section: str, f: Any) -> None:
        self._design, self._margin, self._section, self._field = design, margin, section, f
        self._value: Any = getattr(getattr(design, section), f.name)
        self._is_number = isinstance(self._value, int | float) and not isinstance(self._value, bool)

    def _margin_with(self, value: Any) -> float:
        """The margin with this value; nan where its record does not allow it."""
        section = getattr(self._design, self._section)
        try:
            changed = replace(section, **{self._field.name: value})
        except ShapeError:
            return math.nan
        return self._margin(replace(self._design, **{self._section: changed}))

    def revert_text(self) -> str:
        """How far a key that left its default must go back; empty where that mends nothing."""
        default = self._field.default
        if self._value == default or not self._margin_with(default) >= -SLACK:
            return ""
        if not self._is_number:
            return f"{self._section}.{self._field.name}: {default}"
        return self._nearest(default)[1]

    def nearest_change(self) -> tuple[float, str] | None:
        """The change that mends the failure, as a share of the value, and how to say it."""
        value, bounds = self._value, self._field.metadata
        if not self._is_number or "ge" not in bounds or Design.is_unverified(self._field):
            return None
        if self._section in GIVEN:
            return None
        step = 1 if isinstance(value, int) else max(abs(value) * STEP, STEP)
        have = self._margin_with(value)
        sign = next((s for s in (1, -1) if self._margin_with(value + s * step) > have + SLACK), 0)
        while sign:
            end = min(max(value + sign * step, bounds["ge"]), bounds["le"])
            if self._margin_with(end) >= -SLACK:
                return self._nearest(end)
            if end in (bounds["ge"], bounds["le"]):
                break
            step *= 2
        return None

    def _nearest(self, right: Any) -> tuple[float, str]:
        """The nearest value that passes, `right` being one: its share of a change, and in words."""
        wrong = self._value
        for _ in range(30):
            middle = type(right)((wrong + right) / 2)
            if middle in (wrong, right):
                break
            if self._margin_with(middle) >= -SLACK:
                right = middle
            else:
                wrong = middle
        value = self._value
        share = abs(right - value) / max(abs(value), abs(right), STEP)
        # To three figures, away from the wrong value.
        upward = right > value
        if isinstance(right, float):
            unit = 10.0 ** (math.floor(math.log10(abs(right))) - 2) if right else 1.0
            right = (math.ceil if upward else math.floor)(round(right / unit, 6)) * unit
        name = f"{self._section}.{self._field.name}"
        return share, f"{name}: {right:.6g} or {'more' if upward else 'less'}"
