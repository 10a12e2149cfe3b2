"""One line of the table."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

from ..dimensions import Design
from ..parts.camera import BOARD_KEYS


@dataclass(frozen=True)
class Row:
    """What was checked, of which part, what was found, what would be right.

    rests_on: keys (`camera.focal_length_mm`) that the finding rests on, the measured ones too until
    `verified`.
    """

    check: str
    part: str
    found: str
    limit: str
    passed: bool
    rests_on: tuple[str, ...] = ()

    @property
    def verdict(self) -> str:
        """`pass`, `FAIL`, or `pass (unverified: focal length, lens height)`."""
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


def at(point_mm: Iterable[float]) -> str:
    """A place as `(16.30, -2.00, -14.00)`; no minus before a zero."""
    return "(" + ", ".join(f"{round(float(v), 2) + 0.0:.2f}" for v in point_mm) + ")"


def to_plain(rows: Iterable[Row]) -> list[dict[str, Any]]:
    """Rows as JSON holds them."""
    return [{**asdict(row), "passed": bool(row.passed)} for row in rows]


def from_plain(kept: Iterable[dict[str, Any]]) -> list[Row]:
    """The rows of to_plain."""
    return [Row(**{**row, "rests_on": tuple(row["rests_on"])}) for row in kept]
