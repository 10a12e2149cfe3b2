"""The room that a design takes, from its dimensions alone: no solid is built."""

from __future__ import annotations

from .assembly import places
from .build import expected
from .dimensions import Design
from .registry import SENSOR_PARTS


def size_mm(design: Design) -> tuple[float, float, float]:
    """Sides of the box around all parts of the sensor, (x, y, z).

    From the closed forms that every part's solid is held against. Raises InputError where a
    dimension breaks an inequality.
    """
    corners = [
        tuple(edge + shift for edge, shift in zip(corner, place, strict=True))
        for part in SENSOR_PARTS
        for place in places(part, design)
        for corner in expected(part, design).box_mm
    ]
    x, y, z = (max(axis) - min(axis) for axis in zip(*corners, strict=True))
    return x, y, z
