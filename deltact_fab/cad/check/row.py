"""One line of the table."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

from ..dimensions import Design
from ..parts.camera import BOARD_KEYS
from .advice import SLACK, advice

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

            row = change(row, advice(design, margin))
        yield row


def change(row: Row, what: str) -> Row:
    """The row, its limit followed by what to change; as it is where nothing is known to help."""
    return replace(row, limit=f"{row.limit}: {what}") if what else row


def at_least(
    check: str, part: str, found: str, limit: str, margin: float, rests_on: tuple[str, ...] = ()
) -> Row:
    """The row of a margin, which is arithmetic on a design; NaN fails."""
    return Row(check, part, found, limit, margin >= -SLACK, rests_on, margin)


def at(point_mm: Iterable[float]) -> str:
    """A place as `(16.30, -2.00, -14.00)`; no minus before a zero."""
    return "(" + ", ".join(f"{round(float(v), 2) + 0.0:.2f}" for v in point_mm) + ")"
