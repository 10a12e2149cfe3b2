"""One line of the table; and what mends a failed one of arithmetic on the design.

Which number to change, and which way, is found by trying each alone. No words of a check say it:
whatever gives a margin for a design (at least 0 where it passes) can ask. First come numbers that
stand away from their defaults and whose default mends the failure; only where there are none every
number is moved.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

from ...shapes.bounded import ShapeError, is_unverified
from ..dimensions import Design
from ..parts.camera import BOARD_KEYS

Margin = Callable[[Design], float]
SLACK = 1e-9
NAMED = 3  # a line has room for no more
STEP = 0.01
# What a machine can do, and the room there is, are not changed to please a check.
GIVEN = ("resin_printer", "laser", "envelope", "drawing")
NOT_RUN = "checks on solids"
"""The one row that counts what a failure left undone: it has not passed and is no failure."""


@dataclass(frozen=True)
class Row:
    """What was checked, of which part, what was found, what would be right.

    rests_on: keys (`camera.focal_length_mm`) that the finding rests on, the measured ones too until
    `verified`. margin: what is left to the limit, of a row that is arithmetic on the design alone.
    """

    check: str
    part: str
    found: str
    limit: str
    passed: bool
    rests_on: tuple[str, ...] = ()
    margin: float | None = None

    @property
    def verdict(self) -> str:
        """`pass`, `FAIL`, `not run`, or `pass (unverified: focal length, lens height)`."""
        if self.check == NOT_RUN:
            return "not run"
        if not self.passed:
            return "FAIL"
        if not self.rests_on:
            return "pass"
        named = dict.fromkeys(plain(key) for key in self.rests_on)
        return f"pass (unverified: {', '.join(named)})"


def plain(key: str) -> str:
    """A key as it is read: `camera.focal_length_mm` is `focal length`.

    The many lengths of the camera's board are one thing to measure, and so is what a machine does.
    """
    if key in BOARD_KEYS:
        return "camera board"
    if key.startswith(("resin_printer.", "laser.")):
        return key.partition(".")[0].replace("_", " ")
    name = key.rpartition(".")[2]
    return name.removesuffix("_mm").removesuffix("_mpa").replace("_", " ")


def verified(rows: Iterable[Row], design: Design) -> Iterator[Row]:
    """The rows, each resting on those of its keys alone that nobody has measured.

    A key that ends in `.` stands for its section.
    """
    for row in rows:
        if row.rests_on:
            known = design.unverified()
            held = (
                k
                for key in row.rests_on
                for k in known
                if k == key or (key.endswith(".") and k.startswith(key))
            )
            row = replace(row, rests_on=tuple(dict.fromkeys(held)))
        yield row


def advised(rows: Callable[[Design], Iterable[Row]], design: Design) -> Iterator[Row]:
    """The rows of arithmetic on a design; one that fails says which key to change, and which way.

    A changed design that has another number of rows tells nothing.
    """
    found = list(rows(design))
    for index, row in enumerate(found):
        if not row.passed:

            def margin(changed: Design, index: int = index) -> float:
                others = list(rows(changed))
                left = others[index].margin if len(others) == len(found) else None
                return math.nan if left is None else left

            mend = advice(design, margin)
            row = replace(row, limit=f"{row.limit}: {mend}") if mend else row
        yield row


def at_least(
    check: str, part: str, found: str, limit: str, margin: float, rests_on: tuple[str, ...] = ()
) -> Row:
    """The row of a margin, which is arithmetic on a design; NaN fails."""
    return Row(check, part, found, limit, margin >= -SLACK, rests_on, margin)


def at(point_mm: Iterable[float]) -> str:
    """A place as `(16.30, -2.00, -14.00)`; no minus before a zero."""
    return "(" + ", ".join(f"{round(float(v), 2) + 0.0:.2f}" for v in point_mm) + ")"


def advice(design: Design, margin: Margin) -> str:
    """`shell.wall_mm: 0.6 or more`, the least change first; empty where no single number helps."""
    keys = [
        _Key(design, margin, section.name, f)
        for section in fields(design)
        for f in fields(getattr(design, section.name))
    ]
    found = [text for key in keys if (text := key.back())]
    if not found:
        moved = sorted(way for key in keys if (way := key.moved()))
        found = [text for _, text in moved]
    return ", ".join(found[:NAMED])


class _Key:
    """One key of a design, and what a margin becomes when it alone is changed."""

    def __init__(self, design: Design, margin: Margin, section: str, f: Any) -> None:
        self._design, self._margin, self._section, self._field = design, margin, section, f
        self._value: Any = getattr(getattr(design, section), f.name)
        self._is_number = isinstance(self._value, int | float) and not isinstance(self._value, bool)

    def _at(self, value: Any) -> float:
        """The margin with this value; nan where its record does not allow it."""
        section = getattr(self._design, self._section)
        try:
            changed = replace(section, **{self._field.name: value})
        except ShapeError:
            return math.nan
        return self._margin(replace(self._design, **{self._section: changed}))

    def back(self) -> str:
        """How far a key that left its default must go back; empty where that mends nothing."""
        default = self._field.default
        if self._value == default or not self._at(default) >= -SLACK:
            return ""
        if not self._is_number:
            return f"{self._section}.{self._field.name}: {default}"
        return self._nearest(default)[1]

    def moved(self) -> tuple[float, str] | None:
        """The change that mends the failure, as a share of the value, and how to say it."""
        value, bounds = self._value, self._field.metadata
        if not self._is_number or "ge" not in bounds or is_unverified(self._field):
            return None
        if self._section in GIVEN:
            return None
        step = 1 if isinstance(value, int) else max(abs(value) * STEP, STEP)
        have = self._at(value)
        sign = next((s for s in (1, -1) if self._at(value + s * step) > have + SLACK), 0)
        while sign:
            end = min(max(value + sign * step, bounds["ge"]), bounds["le"])
            if self._at(end) >= -SLACK:
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
            if self._at(middle) >= -SLACK:
                right = middle
            else:
                wrong = middle
        value = self._value
        share = abs(right - value) / max(abs(value), abs(right), STEP)
        # To three figures, away from the wrong value.
        more = right > value
        if isinstance(right, float):
            unit = 10.0 ** (math.floor(math.log10(abs(right))) - 2) if right else 1.0
            right = (math.ceil if more else math.floor)(round(right / unit, 6)) * unit
        name = f"{self._section}.{self._field.name}"
        return share, f"{name}: {right:.6g} or {'more' if more else 'less'}"
