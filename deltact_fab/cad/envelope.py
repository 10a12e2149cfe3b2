"""The room that a design takes, from its dimensions alone: no solid is built."""

from __future__ import annotations

from . import feasibility
from .dimensions import Design
from .registry import of_group
from .solid_gate import enclosing, shifted


def size_mm(design: Design) -> tuple[float, float, float]:
    """Sides of the box around all parts of the sensor, (x, y, z).

    From the boxes that every part's solid is held against. Raises InputError where a dimension
    breaks an inequality.
    """
    feasibility.check(design)
    sensor = of_group("sensor", design)
    low, high = enclosing(
        shifted(part.box(design), place) for part in sensor for place in part.places(design)
    )
    x, y, z = (b - a for a, b in zip(low, high, strict=True))
    return x, y, z
