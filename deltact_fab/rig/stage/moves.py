"""Single moves that are over on return."""

from __future__ import annotations

from ...aliases import Vector
from ..interface import Stage

LIFT_FEED_MM_MIN = 120.0
"""Out of the gel: slow enough for one that sticks."""


def go(stage: Stage, target_mm: Vector, feed_mm_min: float) -> None:
    """One straight move (sensor frame) to its end. Raises InputError, StageError."""
    stage.start_move(target_mm, feed_mm_min)
    stage.wait()


def rise(stage: Stage, height_mm: float, feed_mm_min: float) -> None:
    """Straight up to that height, or stay where the tip is higher. Raises as `go`."""
    x, y, z = stage.position_mm()
    go(stage, (x, y, max(z, height_mm)), feed_mm_min)
