"""How long the rest takes: from what jobs of this kind took before, then from those that ended."""

from __future__ import annotations

import time
from collections.abc import Sequence

from .. import cache

KIND = "study-pace"


class Pace:
    """Of the jobs that are to do.

    costs: of each, in one unit, all of them or the jobs count alike. work: what they do, under
    which their pace is kept. width: how many at a time.
    """

    def __init__(self, costs: Sequence[float], work: str, width: int) -> None:
        self._known = all(cost > 0 for cost in costs)
        self._costs = list(costs) if self._known else [1.0] * len(costs)
        self._shares = [0.0] * len(costs)
        self._ended = 0
        self._width = max(1, min(width, len(costs)))
        self._key = {"work": work, "known": self._known}
        self._began = time.monotonic()

    def share(self, index: int, share: float) -> None:
        """That much of a job is done, 0 to 1."""
        self._shares[index] = max(self._shares[index], min(1.0, share))

    def ended(self, index: int) -> None:
        """A job is done, or failed."""
        self._shares[index] = 1.0
        self._ended += 1

    def done(self) -> float:
        """The share of all that is done."""
        whole = sum(self._costs)
        part = sum(c * s for c, s in zip(self._costs, self._shares, strict=True))
        return part / whole if whole else 1.0

    def beforehand(self) -> str:
        """What to expect, in words; empty where nothing is known."""
        entry = cache.get(KIND, self._key)
        rate = entry.get("seconds_per_cost") if isinstance(entry, dict) else None
        if rate is None and not self._known:
            return ""
        # Of one process: several share the jobs, and no job is shared.
        cost = max(sum(self._costs) / self._width, *self._costs)
        if rate is None:
            return f"about {spelled(cost)}"
        return f"about {spelled(rate * cost)} at the pace of earlier ones"

    def left_s(self, now_s: float | None = None) -> float | None:
        """Seconds to go at the pace so far; None before anything is done."""
        spent = (time.monotonic() if now_s is None else now_s) - self._began
        done = self.done()
        return spent * (1.0 - done) / done if done > 0 else None

    def left(self) -> str:
        """Time to go, in words; empty where nothing is known, and at the end."""
        seconds = self.left_s()
        return "" if seconds is None or self.done() >= 1.0 else f"about {spelled(seconds)} left"

    def keep(self) -> None:
        """Keep the pace for the next time."""
        if self._ended >= self._width and self._costs:
            spent = time.monotonic() - self._began
            rate = spent * self._width / sum(self._costs)
            cache.put(KIND, self._key, {"seconds_per_cost": rate})


def spelled(seconds: float) -> str:
    """A time in the words of a clock: '40 s', '12 min', '3 h 20 min'."""
    if seconds < 90:
        return f"{max(1, round(seconds))} s"
    minutes = round(seconds / 60)
    if seconds < 5400:
        return f"{minutes} min"
    return f"{minutes // 60} h {minutes % 60} min"
