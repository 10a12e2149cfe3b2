"""Readings that do not change: a stream that comes in time may still measure nothing."""

from __future__ import annotations

from collections import deque
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import SensorError

from ..interface import ForceSamples

# By hand: shorter times stop a filtered sensor, longer ones let a tip go deeper unfelt.
STILL_NS = 100_000_000
STILL_RECORDS = 10  # the same at a low rate
LEARN_NS = 250_000_000  # from the start of a stream: its longest run of equal samples
RUN_RATIO = 5  # of the longest to be expected in an hour; a 250th of a second has 1/3 of it
# By hand: a ball of 1 mm in a gel of 0.1 MPa gives 2 g there, and a coarse scale shows 1 g.
UNFELT_MM = 0.3
SETTLE_SAMPLES = 5  # by hand: an HX711 settles within 4


class Standstill:
    """Fault of a sensor with noise: all axes equal bit by bit for longer than limit_ns.

    The limit follows the sensor: RUN_RATIO times the longest run of equal samples at the start.
    """

    def __init__(self, limit_ns: float) -> None:
        self._limit_ns = limit_ns
        self._last: NDArray[np.int32] | None = None
        self._begin_ns = self._since_ns = 0

    def check(self, t_ns: NDArray[np.int64], counts: NDArray[np.int32], free: Any) -> None:
        """Raise SensorError for samples (n, 6) that stand still; free (n,): not judged."""
        if self._last is None:
            self._last, self._begin_ns, self._since_ns = counts[:1], int(t_ns[0]), int(t_ns[0])
        changed = _changed(self._last, counts) | free
        times_ns = t_ns[changed]
        self._last = counts[-1:]
        if len(times_ns):
            if times_ns[0] < self._begin_ns + LEARN_NS:
                run_ns = int(np.diff(times_ns, prepend=self._since_ns).max())
                self._limit_ns = max(self._limit_ns, RUN_RATIO * run_ns)
            self._since_ns = int(times_ns[-1])
        still_s = (int(t_ns[-1]) - self._since_ns) / 1e9
        if still_s * 1e9 > self._limit_ns:
            raise SensorError(
                f"force sensor: the readings do not change: all axes equal for {still_s:.2f} s; "
                "check the transducer's plug"
            )


def _changed(last: NDArray[np.int32], counts: NDArray[np.int32]) -> NDArray[np.bool_]:
    """True (n,) for samples that differ from the one before; last (1, 6): before the first."""
    return np.asarray((counts != np.concatenate((last, counts[:-1]))).any(axis=1), bool)


class DepthCheck:
    """Fault of any sensor: the tip went UNFELT_MM deeper into the gel, and no reading changed.

    `watch` and `check` may be called by two threads.
    """

    def __init__(self) -> None:
        self._counts: NDArray[np.int32] | None = None
        self._still = (0, 0, 0)  # times of the last change and the last sample, samples between
        self._poses: deque[tuple[int, float]] = deque(maxlen=1000)
        self._changed_ns, self._least_mm = 0, inf

    def watch(self, samples: ForceSamples) -> None:
        """Note when the readings last changed."""
        counts, t_ns = samples.counts, samples.t_ns
        if not len(t_ns):
            return
        changed = _changed(counts[:1] - 1 if self._counts is None else self._counts, counts)
        since_ns, _, n = self._still
        if changed.any():
            k = len(t_ns) - 1 - int(changed[::-1].argmax())
            since_ns, n = int(t_ns[k]), -k - 1
        self._counts, self._still = counts[-1:], (since_ns, int(t_ns[-1]), n + len(t_ns))

    def check(self, t_ns: int, z_mm: float) -> None:
        """Raise SensorError for a tip that was deeper since the readings last changed."""
        self._poses.append((t_ns, max(-z_mm, 0.0)))
        changed_ns, last_ns, n = self._still
        if changed_ns != self._changed_ns:
            self._changed_ns, self._least_mm = changed_ns, inf
        settled_ns = last_ns - SETTLE_SAMPLES * (last_ns - changed_ns) / max(n, 1)
        while self._poses and self._poses[0][0] <= settled_ns:
            at_ns, depth_mm = self._poses.popleft()
            if at_ns < changed_ns:
                continue
            self._least_mm = min(self._least_mm, depth_mm)
            if depth_mm - self._least_mm > UNFELT_MM:
                raise SensorError(
                    f"force sensor: the readings do not change: {n} equal ones while the tip went "
                    f"from {self._least_mm:.2f} to {depth_mm:.2f} mm below the face; check the "
                    "sensor, and that the tip is as long as the rig file says"
                )
