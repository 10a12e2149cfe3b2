"""Single moves that somebody asks for at a terminal, bounded so that a slip breaks nothing.

What goes into the gel, or sideways near it, has to be asked for twice.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

from ...aliases import Vector
from ...errors import InputError, Stopped
from ...protocols.motion import plus
from ..interface import Stage, go
from ..run.interrupt import interruptible

CLEARANCE_MM = 5.0
MAX_MM = 10.0
FEED_MM_MIN = 300.0
NEAR_FEED_MM_MIN = 30.0
"""Below the clearance height."""
SAME_MM = 2e-3


@contextmanager
def stopped_by_ctrl_c(stage: Stage) -> Iterator[None]:
    """Ctrl-C, SIGTERM and SIGHUP stop the motion, the second one resets; raises Stopped then."""
    with interruptible(stage.abort):
        try:
            yield
        except KeyboardInterrupt as why:
            stage.stop()
            where = f" at {in_words(stage.position_mm())}" if stage.homed else ""
            raise Stopped(f"stopped by the operator{where}") from why


def jog(
    stage: Stage,
    by_mm: Vector,
    feed_mm_min: float = FEED_MM_MIN,
    *,
    most_mm: float = MAX_MM,
    clearance_mm: float = CLEARANCE_MM,
    into_gel: bool = False,
) -> Vector:
    """One straight move by so much (sensor frame); returns where the tip is then.

    Raises InputError, with nothing sent, for one that is longer than most_mm or, without into_gel,
    ends below clearance_mm or goes sideways there; straight up is always allowed.
    """
    go(stage, *wanted(stage, by_mm, feed_mm_min, most_mm, clearance_mm, into_gel))
    return stage.position_mm()


def wanted(
    stage: Stage,
    by_mm: Vector,
    feed_mm_min: float,
    most_mm: float,
    clearance_mm: float,
    into_gel: bool,
) -> tuple[Vector, float]:
    """Where such a jog leads, and how fast; nothing moves. Raises as `jog`."""
    require_short(by_mm, most_mm)
    here = stage.position_mm()
    there = plus(here, by_mm)
    low_mm, up = min(here[2], there[2]), by_mm[0] == by_mm[1] == 0 and by_mm[2] >= 0
    near = low_mm < clearance_mm and not up
    if near and not into_gel:
        raise InputError(_too_low(low_mm, clearance_mm))
    return there, min(feed_mm_min, NEAR_FEED_MM_MIN) if near else feed_mm_min


def require_short(by_mm: Vector, most_mm: float = MAX_MM) -> None:
    """Raise InputError for a way that is longer than most_mm, or none."""
    length_mm = math.hypot(*by_mm)
    if not length_mm <= most_mm:
        raise InputError(
            f"DX DY DZ: {length_mm:g} mm is more than {most_mm:g}; give --most {length_mm:g} if "
            "that is meant"
        )


def goto(
    stage: Stage,
    target_mm: Vector,
    feed_mm_min: float = FEED_MM_MIN,
    *,
    clearance_mm: float = CLEARANCE_MM,
    into_gel: bool = False,
) -> Vector:
    """To a place (sensor frame): up to the clearance height, sideways, then down.

    Raises InputError, with nothing sent, for one below clearance_mm without into_gel.
    """
    if not all(map(math.isfinite, target_mm)):
        raise InputError(f"X Y Z: {target_mm} mm is not a place")
    x, y, z = target_mm
    if z < clearance_mm and not into_gel:
        raise InputError(_too_low(z, clearance_mm))
    here = stage.position_mm()
    if math.dist(here[:2], (x, y)) > SAME_MM:
        high_mm = max(here[2], clearance_mm)
        for place in ((here[0], here[1], high_mm), (x, y, high_mm)):
            go(stage, place, feed_mm_min)
    if z < clearance_mm:
        if stage.position_mm()[2] > clearance_mm:
            go(stage, (x, y, clearance_mm), feed_mm_min)
        feed_mm_min = min(feed_mm_min, NEAR_FEED_MM_MIN)
    go(stage, target_mm, feed_mm_min)
    return stage.position_mm()


def in_words(position_mm: Vector) -> str:
    """A tip position for a person."""
    x, y, z = (round(p, 3) + 0.0 for p in position_mm)
    return f"x {x:.3f}, y {y:.3f}, z {z:.3f} mm (sensor)"


def _too_low(z_mm: float, clearance_mm: float) -> str:
    return (
        f"z = {z_mm:g} mm is below {clearance_mm:g} mm over the face, where the tip may touch the "
        "gel: give --into-gel (slow), or go up first"
    )
