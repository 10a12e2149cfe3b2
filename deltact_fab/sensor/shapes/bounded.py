"""Dimensions that carry their meaning and their limits, so that both are checked and shown."""

from __future__ import annotations

import math
from dataclasses import Field, dataclass, field, fields
from typing import Any


class ShapeError(ValueError):
    """A dimension breaks an inequality; the text states the inequality with its numbers."""


def bounded_number(
    default: float,
    meaning: str,
    low: float,
    high: float,
    *,
    unverified: bool = False,
) -> Any:
    """A field of a frozen dimension record.

    meaning: one line for whoever reads it on a screen. low, high: what the record accepts, both
    ends included. unverified: the default was assumed and not measured; every check that rests on
    it says so.
    """
    return field(
        default=default,
        metadata={  # by the names that pydantic takes from a field, for files and schema
            "description": meaning,
            "ge": low,
            "le": high,
            "json_schema_extra": {"unverified": unverified},
        },
    )


@dataclass(frozen=True)
class Bounded:
    """A record of numbers with meaning and limits, which `catalog.validate` reads from a file.

    One with keys that count as unverified has a field `measured` for those that a lab has measured.
    Raises ShapeError for a number beyond its limits, for NaN, and for a key measured in vain.
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
        """Whether the default of a record's field was assumed and not measured."""
        return bool(f.metadata.get("json_schema_extra", {}).get("unverified"))
