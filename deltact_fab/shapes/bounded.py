"""Dimensions that carry their meaning and their limits, so that both are checked and shown."""

from __future__ import annotations

import math
from dataclasses import Field, field, fields
from typing import Any


class ShapeError(ValueError):
    """A dimension breaks an inequality; the text states the inequality with its numbers."""


def number(
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


def is_unverified(f: Field[Any]) -> bool:
    """Whether the default of a record's field was assumed and not measured."""
    return bool(f.metadata.get("json_schema_extra", {}).get("unverified"))


def check_limits(record: object) -> None:
    """Raise ShapeError unless every number of the record lies within its limits (NaN fails)."""
    for f in fields(record):  # type: ignore[arg-type]
        if "ge" not in f.metadata:
            continue
        value, low, high = getattr(record, f.name), f.metadata["ge"], f.metadata["le"]
        if not (math.isfinite(value) and low <= value <= high):
            raise ShapeError(f"{low:g} <= {f.name} <= {high:g}: {value:g} fails")
