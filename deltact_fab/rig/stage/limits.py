"""What a GRBL controller's `$` settings allow a move, judged before a byte of it is sent."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ...aliases import Vector
from ...protocols.limits import ends_mm
from .settings import AXES

HOMING_MARGIN_S = 10.0
ROUNDING_MM = 0.002  # of a step and of three decimals


class Limits:
    """Of one controller, and of the rig file where that allows less.

    settings: `$` numbers to values. A refusal is one line of why, "" where there is none.
    """

    def __init__(self, settings: Mapping[int, float], travel_mm: Vector | None = None) -> None:
        self.settings = dict(settings)
        self._travel_mm = travel_mm

    def axes(self, first: int) -> Vector:
        """A setting of three axes by the number of its first."""
        s = self.settings
        return (s[first], s[first + 1], s[first + 2])

    @property
    def travel_mm(self) -> Vector:
        """How far each axis goes down from 0."""
        x, y, z = map(min, self.axes(130), self._travel_mm or self.axes(130))
        return (x, y, z)

    def ends_mm(self, axis: int) -> tuple[float, float]:
        """How low and how high an axis may go: homing leaves it $27 off its switch."""
        at_top = not int(self.settings.get(23, 0)) >> axis & 1
        return ends_mm(self.travel_mm[axis], at_top, self.settings.get(27, 0.0))

    def target_refusal(self, machine_mm: Vector) -> str:
        """A target that is no place, or outside of the travel."""
        if not all(math.isfinite(p) for p in machine_mm):
            return f"target {machine_mm} mm (machine) is not finite"
        for axis, p in enumerate(machine_mm):
            low, high = self.ends_mm(axis)
            if not low - ROUNDING_MM <= p <= high + ROUNDING_MM:
                return (
                    f"target {AXES[axis]} {p:.3f} mm (machine) is outside of {low:g} .. {high:g}, "
                    f"the travel less {self.settings.get(27, 0.0):g} mm at the switch"
                )
        return ""

    def feed_refusal(self, delta_mm: Vector, feed_mm_min: float) -> str:
        """GRBL clips a feed silently; here it is refused."""
        if not (math.isfinite(feed_mm_min) and feed_mm_min >= 0.001):
            return f"feed {feed_mm_min} mm/min; at least 0.001 is needed"
        length = math.hypot(*delta_mm)
        for axis, d, limit in zip(AXES, delta_mm, self.axes(110), strict=True):
            if abs(d) * feed_mm_min > limit * length * (1 + 1e-9):
                return (
                    f"feed {feed_mm_min:g} mm/min moves {axis} at "
                    f"{feed_mm_min * abs(d) / length:g}; its limit is {limit:g}"
                )
        return ""

    def same_place(self, a_mm: Vector, b_mm: Vector) -> bool:
        """Within half a step, and the rounding of the line sent and of the report."""
        return all(
            abs(p - t) <= 0.5 / steps + 0.0006
            for p, t, steps in zip(a_mm, b_mm, self.axes(100), strict=True)
        )

    def braking_s(self) -> float:
        """Longest that a stop can take."""
        feeds, ramps = ([self.settings.get(n + a, 0.0) for a in range(3)] for n in (110, 120))
        return max(feeds) / 60 / min(ramps) if min(ramps) > 0 else 0.0

    def homing_s(self) -> float:
        """Longest that the firmware searches: 1.5 travels and back for Z, then X and Y together."""
        s = self.settings
        seek, feed, pull = (max(s.get(n, 0.0), 1e-3) for n in (25, 24, 27))
        travel = 1.5 * (s[132] + max(s[130], s[131]))
        pause_s = 8 * s.get(26, 0.0) / 1000
        slow = 2 * 5 * pull / feed + 4 * pull / seek
        ramps = 16 * seek / 60 / min(self.axes(120))
        return 60 * (travel / seek + slow) + pause_s + ramps + HOMING_MARGIN_S
