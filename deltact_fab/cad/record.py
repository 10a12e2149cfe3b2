"""What the records of a design's sections have in common: limits, standards, measured keys."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

from ..aliases import Point2
from ..shapes.bounded import Bounded, ShapeError, is_unverified, number

__all__ = ["Point2", "Record", "assumed", "check_measured", "measured", "number", "standard_row"]

StandardRow = TypeVar("StandardRow")


@dataclass(frozen=True)
class Record(Bounded):
    """One section of a design: each number carries its meaning and its limits.

    One with keys that count as unverified has a field `measured` for those that a lab has measured.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        if hasattr(self, "measured"):
            check_measured(self)


def assumed(default: float, meaning: str, low: float, high: float) -> Any:
    """A number that nobody has measured: it counts as unverified."""
    return number(default, meaning, low, high, unverified=True)


def measured(what: str) -> Any:
    """The field for keys that a lab has measured: these no longer count as unverified."""
    return field(default=(), metadata={"description": what})


def standard_row(table: Mapping[str, StandardRow], key: str, name: str) -> StandardRow:
    """The row of a table of standards. Raises ShapeError listing the valid names."""
    if name not in table:
        raise ShapeError(f"{key}: expected one of {', '.join(table)}: {name!r} fails")
    return table[name]


def check_measured(record: Any) -> None:
    """Raise ShapeError unless `measured` names only keys of the record that count as unverified."""
    open_keys = [f.name for f in fields(record) if is_unverified(f)]
    for key in record.measured:
        if key not in open_keys:
            raise ShapeError(f"measured: of {', '.join(open_keys)}: {key!r} fails")
