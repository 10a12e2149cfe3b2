"""Positions of three axes, in millimetres and in whole steps."""

from __future__ import annotations

import math

from ..aliases import Vector


def steps(mm: Vector, per_mm: Vector) -> tuple[int, int, int]:
    """Whole steps, halves away from zero as the firmware rounds."""
    x, y, z = (
        int(math.copysign(math.floor(abs(p * k) + 0.5), p)) for p, k in zip(mm, per_mm, strict=True)
    )
    return x, y, z


def divide(steps: tuple[int, int, int], per_mm: Vector) -> Vector:
    """Position of a number of steps, mm."""
    return (steps[0] / per_mm[0], steps[1] / per_mm[1], steps[2] / per_mm[2])


def replaced(mm: Vector, axes: dict[int, float]) -> Vector:
    """The position with some axes, by number, replaced."""
    return (axes.get(0, mm[0]), axes.get(1, mm[1]), axes.get(2, mm[2]))
