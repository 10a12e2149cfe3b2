"""What the `$` settings of a GRBL controller allow, judged before a byte of motion is sent."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ...protocols.motion import Vec3

AXES = "XYZ"
HOMING_MARGIN_S = 10.0


class Limits:
    """settings: `$` numbers to values. A refusal is one line of why, "" where there is none."""

    def __init__(self, settings: Mapping[int, float]) -> None:
        self.settings = dict(settings)

    def axes(self, first: int) -> Vec3:
        """A setting of three axes by the number of its first."""
        s = self.settings
        return (s[first], s[first + 1], s[first + 2])

    def refusal(self, travel_mm: Vec3 | None, feed_mm_min: Vec3 | None) -> str:
        """Why a host cannot work with these settings, or that they fall short of what it needs."""
        s = self.settings
        wanted = (10, 13, 20, 22, *(k + a for k in (100, 110, 120, 130) for a in range(3)))
        missing = [f"${n}" for n in wanted if n not in s]
        if missing:
            return f"the answer to $$ lacks {', '.join(missing)}"
        rules = (
            (10, 1, "status reports give the work position", "$10=1 or $10=3"),
            (13, 0, "status reports are in inches", "$13=0"),
            (20, 1, "soft limits are off", "$20=1"),
            (22, 1, "homing is off", "$22=1"),
        )
        for n, bit, what, needed in rules:
            if int(s[n]) & 1 != bit:
                return f"${n}={s[n]:g} ({what}); set {needed} and connect again"
        for first, unit in ((100, "steps/mm"), (110, "mm/min"), (120, "mm/s2"), (130, "mm")):
            for n in range(first, first + 3):
                if not s[n] > 0:
                    return f"${n}={s[n]:g} {unit}; not > 0"
        for first, need, what in ((130, travel_mm, "mm of travel"), (110, feed_mm_min, "mm/min")):
            for axis, (found, least) in enumerate(zip(self.axes(first), need or (), strict=False)):
                if found < least:
                    return f"{AXES[axis]} has {found:g} {what} (${first + axis}); {least:g} needed"
        return ""

    def target_refusal(self, machine_mm: Vec3) -> str:
        """A target that is no place, or outside of the travel."""
        if not all(math.isfinite(p) for p in machine_mm):
            return f"target {machine_mm} mm (machine) is not finite"
        for axis, p, travel in zip(AXES, machine_mm, self.axes(130), strict=True):
            if not -travel <= p <= 0:
                return (
                    f"target {axis} {p:.3f} mm (machine) is outside of -{travel:g} .. 0, the "
                    "controller's travel"
                )
        return ""

    def feed_refusal(self, delta_mm: Vec3, feed_mm_min: float) -> str:
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

    def same_place(self, a_mm: Vec3, b_mm: Vec3) -> bool:
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
