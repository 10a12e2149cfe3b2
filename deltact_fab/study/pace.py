"""How long the rest takes: from what jobs of this kind took before, then from those that ended."""

from __future__ import annotations

import time
from collections.abc import Sequence

from .. import cache

KIND = "study-pace"
TRUST, FIRST = 0.1, 0.02  # shares of all the work


class JobPace:
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
        entry = cache.get(KIND, self._key)
        rate = entry.get("seconds_per_cost") if isinstance(entry, dict) else None
        self._kept = rate is not None
        self._expected_s: float | None = None
        if costs and (rate is not None or self._known):
            # Of one process: several share the jobs, and no job is shared.
            cost = max(sum(self._costs) / self._width, *self._costs)
            self._expected_s = cost if rate is None else rate * cost

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
        if self._expected_s is None:
            return ""
        kept = " at the pace of earlier ones" if self._kept else ""
        return f"about {spelled(self._expected_s)}{kept}"

    def left_s(self, now_s: float | None = None) -> float | None:
        """Seconds to go; None before anything is done.

        At the pace so far, which the first moments tell badly, for jobs begin with what is done
        once: so what was expected counts as if TRUST of all had been done at its pace. Where
        nothing was expected, the pace counts from FIRST on.
        """
        spent = (time.monotonic() if now_s is None else now_s) - self._began
        done = self.done()
        if done <= 0 or (self._expected_s is None and done < FIRST and not self._ended):
            return None
        before_s, share = (
            (0.0, 0.0) if self._expected_s is None else (TRUST * self._expected_s, TRUST)
        )
        return (1.0 - done) * (spent + before_s) / (done + share)

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
