"""Headlines of figures with their intervals."""

from __future__ import annotations

from typing import Any

from deltact_fab.estimate import Interval
from deltact_fab.present import Headline


def headline(label: str, unit: str, ci: Interval, factor: float = 1.0, **fields: Any) -> Headline:
    """Headline of a figure and its interval. factor: to `unit`, from the figure's own."""
    low, high = (None if end is None else factor * end for end in (ci.low, ci.high))
    return Headline(label, factor * ci.value, unit, low, high, ci.over, **fields)
