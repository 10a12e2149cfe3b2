"""The room that a design takes, from its dimensions alone: no solid is built."""

from __future__ import annotations

from .build import expected
from .dimensions import Design
from .registry import of_group


def size_mm(design: Design) -> tuple[float, float, float]:
    """Sides of the box around all parts of the sensor, (x, y, z).

    From the closed forms that every part's solid is held against. Raises InputError where a
    dimension breaks an inequality.
    """
    corners = [
        tuple(edge + shift for edge, shift in zip(corner, place, strict=True))
        for part in of_group("sensor")
        for place in part.places(design)
        for corner in expected(part, design).box_mm
    ]
    x, y, z = (max(axis) - min(axis) for axis in zip(*corners, strict=True))
    return x, y, z
