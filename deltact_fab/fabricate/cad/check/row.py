"""Basis of a design check, and remedies for a failed check.

The remedy is found by changing one number at a time, from the margin alone (at least 0 where the
check passes) and not from the check's text. Numbers that differ from their default and pass at it
come first; only if there are none is every number varied, for a check by arithmetic. A value that
the lab measured is never changed. Defaults are those of the design that was changed: its file
without the changes, then the file's base, then the paper's.
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
Bases = tuple[Design, ...]
"""Designs that a design was changed from, nearest first."""
PAPER_BASES: Bases = (Design(),)
MAX_NAMED_KEYS = 3  # by hand: one line has no room for more
SEARCH_STEP = 0.01  # by hand, first relative step: smaller takes longer, larger may skip a solution
# Properties of machines and the envelope are given: they are no remedies.
FIXED_SECTIONS = ("resin_printer", "laser", "envelope", "drawing")
FREE_TEXT = ("str", "tuple[str, ...]")  # types of names, sources and lists of measured keys


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


def add_remedies(
    rows: Callable[[Design], Iterable[Check]], design: Design, bases: Bases = PAPER_BASES
) -> Iterator[Check]:
    """Add a remedy to each failed row of a check by arithmetic: key and direction to change.

    bases: designs that it was changed from, nearest first. A changed design without the row counts
    as unknown (NaN).
    """
    margins: dict[Design, dict[str, float | None]] = {}
    for row in rows(design):
        if row.failed and not row.remedy:

            def margin(changed: Design, id: str = row.id) -> float:
                if changed not in margins:
                    margins[changed] = {check.id: check.margin for check in rows(changed)}
                new_margin = margins[changed].get(id)
                return math.nan if new_margin is None else new_margin

            row = replace(row, remedy=advice(design, margin, bases))
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


def advice(design: Design, margin: Margin, bases: Bases = PAPER_BASES) -> str:
    """Return e.g. `shell.wall_mm: 0.6 or more`, smallest change first; empty if none helps.

    A machine's changed number comes last, after what the design can do about it.
    """
    texts: dict[bool, list[str]] = {True: [], False: []}
    for base in bases:
        keys = list(_keys(design, margin, base))
        for key in keys:
            if key.is_changed and (text := key.revert_text()):
                texts[key.is_given].append(text)
        if texts[False]:
            break
    else:
        changes = sorted(change for key in keys if (change := key.nearest_change()))
        texts[False] = [text for _, text in changes]
    last = texts[True][:1]
    return ", ".join([*texts[False][: MAX_NAMED_KEYS - len(last)], *last])


def name_culprits(
    rows: Iterable[Check], design: Design, passes: Callable[[Design, Check], bool], bases: Bases
) -> Iterator[Check]:
    """Add a remedy to each failed row on solids: the changed key at whose default it passes.

    passes: True if the row of a changed design passes. Keys of earlier rows are tried first.
    """
    names: list[str] = []
    for row in rows:
        if row.failed and not row.remedy:

            def margin(changed: Design, row: Check = row) -> float:
                return 0.0 if passes(changed, row) else -1.0

            keys = []
            for base in bases:
                changed = [key for key in _keys(design, margin, base) if key.is_changed]
                keys += sorted(changed, key=lambda key: (key.name not in names, key.is_given))
            if culprit := next((key for key in keys if key.default_passes), None):
                names.append(culprit.name)
                row = replace(row, remedy=culprit.default_text)
        yield row


def fails(rows: Iterable[Check], row: Check) -> bool:
    """Return whether rows of a changed design repeat the failure of a row."""
    return any(r.failed and (r.name, r.subject) == (row.name, row.subject) for r in rows)


def _keys(design: Design, margin: Margin, base: Design) -> Iterator[_Key]:
    """Yield the keys that may be changed: neither measured nor free text."""
    for section in fields(design):
        record = getattr(design, section.name)
        for f in fields(record):
            if f.type not in FREE_TEXT and f.name not in getattr(record, "measured", ()):
                default = getattr(getattr(base, section.name), f.name)
                yield _Key(design, margin, section.name, f, default)


class _Key:
    """One key of a design, and the margin as a function of it alone."""

    def __init__(self, design: Design, margin: Margin, section: str, f: Any, default: Any) -> None:
        self._design, self._margin, self._section, self._field = design, margin, section, f
        self._value: Any = getattr(getattr(design, section), f.name)
        self._is_number = isinstance(self._value, int | float) and not isinstance(self._value, bool)
        self.name, self.default = f"{section}.{f.name}", default
        self.is_given = section in FIXED_SECTIONS
        self.is_changed = self._value != default

    @property
    def default_passes(self) -> bool:
        """True if the default alone makes the check pass."""
        return self._margin_with(self.default) >= -RULE_SLACK

    @property
    def default_text(self) -> str:
        """Key and default, as in `shell.wall_mm: 1.5`."""
        return f"{self.name}: {self.default}".removesuffix(".0")

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
        if not self.default_passes:
            return ""
        if not self._is_number:
            return self.default_text
        return self._nearest(self.default)[1]

    def nearest_change(self) -> tuple[float, str] | None:
        """Return the relative change that passes, with its text; None if there is none."""
        value, bounds = self._value, self._field.metadata
        if not self._is_number or "ge" not in bounds or Design.is_unverified(self._field):
            return None
        if self.is_given or "limit" in self.name:
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
        return share, f"{self.name}: {right:.6g} or {'more' if upward else 'less'}"
