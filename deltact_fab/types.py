"""Names for plain types that many signatures share; nothing is imported that takes time."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[int, int, str], None]
"""Told how far a job is: steps done, steps in all, what is being done."""

Point2 = tuple[float, float]
Point = tuple[float, float, float]
Vector = tuple[float, float, float]
