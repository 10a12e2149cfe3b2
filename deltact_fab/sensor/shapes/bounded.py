"""Dimensions with description and limits, for checks and display."""

from __future__ import annotations

import math
from dataclasses import Field, dataclass, field, fields
from typing import Any


class ShapeError(ValueError):
    """Violated inequality of dimensions; the text states it with its numbers."""


def bounded_number(
    default: float, meaning: str, low: float, high: float, *, unverified: bool = False
) -> Any:
    """Create a field of a frozen dimension record.

    meaning: one-line description. low, high: limits, inclusive. unverified: the default is assumed,
    not measured; checks that depend on it report it.
    """
    return field(
        default=default,
        metadata={  # pydantic's names, for files and schema
            "description": meaning,
            "ge": low,
            "le": high,
            "json_schema_extra": {"unverified": unverified},
        },
    )


@dataclass(frozen=True)
class Bounded:
    """Record of numbers with descriptions and limits, read by `catalog.validate`.

    A record with unverified keys has a field `measured` listing those measured by the lab.
    Raises ShapeError for a number out of its limits, NaN, and an invalid key in `measured`.
    """

    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012 - read by pydantic

    def __post_init__(self) -> None:
        for f in fields(self):
            if "ge" not in f.metadata:
                continue
            value, low, high = getattr(self, f.name), f.metadata["ge"], f.metadata["le"]
            if not (math.isfinite(value) and low <= value <= high):
                raise ShapeError(f"{low:g} <= {f.name} <= {high:g}: {value:g} fails")
        open_keys = [f.name for f in fields(self) if self.is_unverified(f)]
        for key in getattr(self, "measured", ()):
            if key not in open_keys:
                raise ShapeError(f"measured: of {', '.join(open_keys)}: {key!r} fails")

    @staticmethod
    def is_unverified(f: Field[Any]) -> bool:
        """True if the default of a record's field is assumed, not measured."""
        return bool(f.metadata.get("json_schema_extra", {}).get("unverified"))
