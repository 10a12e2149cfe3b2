"""Moves with force feedback: every sample of the force sensor is checked."""

from __future__ import annotations

from contextlib import AbstractContextManager

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Field, Point, SensorError, to_ns

from ..interface import MAX_SAMPLE_AGE_S, Clock, ForceSamples, ForceSensor, Guard, Stage
from ..run.contact import FeltForce, streaming

STREAM_NAME = "touch-off"
# By hand: longer times average more noise, and make a touch slower and deeper.
PROBE_POLL_S = 0.004
MEAN_WINDOW_NS = 5_000_000  # averaged in a move
PROBE_TARE_S = 0.25
PROBE_SETTLE_S = 0.02  # after a move
PROBE_MEAN_S = 0.05  # averaged at rest
MIN_MEAN_SAMPLES = 3
LINK_TRIALS = 3  # before a descent, their median counts
CATCH_UP_S = 0.25  # for reading what was queued; by hand: two lines of a scale at 10 Hz


def rest_duration_s(sample_s: float) -> float:
    """Duration of `ForceProbe.at_rest` with a force sensor of that period."""
    return max(PROBE_SETTLE_S + PROBE_MEAN_S + PROBE_POLL_S, MIN_MEAN_SAMPLES * sample_s)


class ForceProbe:
    """Moves a stage while reading the force sensor, with the guard active.

    Forces are relative to `tare` (N, on the sensor). Raises SensorError for a saturated sample or a
    tripped guard, after stopping the stage.
    """

    def __init__(self, stage: Stage, force: ForceSensor, clock: Clock, guard: Guard | None) -> None:
        self.stage, self.guard = stage, guard
        self._force = force
        self._clock = clock
        self._zero_n = np.zeros(3)
        self._t_ns: NDArray[np.int64] = np.empty(0, np.int64)
        self._tail_n: Field = np.empty((0, 3))
        self.peak_n = 0.0
        """Largest force since the tare, averaged as for a contact."""

    def tare(self) -> float:
        """Start the stream and tare without contact; return the noise, one sigma (N)."""
        self._force.begin(STREAM_NAME)
        self._zero_n = np.zeros(3)
        samples_n = self._since(self._clock.now_ns(), PROBE_TARE_S)
        self._zero_n = samples_n.mean(axis=0)
        self.peak_n = 0.0
        return float(samples_n.std(axis=0).max())

    def restarted_force(self) -> AbstractContextManager[FeltForce]:
        """Restart the stream with its last tare, for a lift; see `run.contact.streaming`."""
        return streaming(self._clock, self._force)

    def delay_s(self) -> float:
        """Return the time from a contact to its stop: age and wait of a sample, and an answer."""
        times_s = [self._clock.now_s()]
        for _ in range(LINK_TRIALS):
            self._read()
            self.stage.position_mm()
            times_s.append(self._clock.now_s())
        return MAX_SAMPLE_AGE_S + float(np.median(np.diff(times_s)))

    def release(self) -> None:
        """Stop the stream."""
        self._force.stop()

    def move(self, target_mm: Point, feed_mm_min: float, over_n: float) -> bool:
        """Make one straight move; return True if a force over over_n ended it.

        No part of it is sent without a look at the newest sample, however slow the link is.
        """
        contact = False

        def is_contact() -> bool:
            nonlocal contact
            contact = contact or self._force_size_n() > over_n
            return contact

        try:
            self.stage.start_move(target_mm, feed_mm_min)
            self.stage.wait(is_contact)
            return is_contact()
        except BaseException:
            self.stage.cancel()
            raise

    def at_rest(self) -> Field:
        """Return the mean force (3,), N, at rest."""
        self._clock.sleep_s(PROBE_SETTLE_S)
        return np.asarray(self._since(self._clock.now_ns(), PROBE_MEAN_S).mean(axis=0))

    def _force_size_n(self) -> float:
        """Read to the newest sample; return the magnitude of the mean force of the last ones."""
        end_s = self._clock.now_s() + CATCH_UP_S
        while (age_s := self._clock.now_s() - self._read().t_ns[-1] / 1e9) > MAX_SAMPLE_AGE_S:
            if self._clock.now_s() > end_s:
                raise SensorError(
                    f"the link is too slow: the newest force sample is {age_s:.2f} s old, "
                    f"{MAX_SAMPLE_AGE_S:g} s are allowed"
                )
        size = float(np.linalg.norm(self._tail_n.mean(axis=0)))
        self.peak_n = max(self.peak_n, size)
        return size

    def _since(self, start_ns: int, seconds: float) -> Field:
        """Return samples (n, 3), N, of an interval; at least MIN_MEAN_SAMPLES."""
        parts: list[Field] = []
        end_ns = start_ns + to_ns(seconds)
        while True:
            samples = self._read()
            fresh = samples.t_ns >= start_ns
            parts.append(np.asarray(samples.force_n[fresh] - self._zero_n))
            if samples.t_ns[-1] >= end_ns and sum(len(part) for part in parts) >= MIN_MEAN_SAMPLES:
                return np.concatenate(parts)
            self._clock.sleep_s(PROBE_POLL_S)

    def _read(self) -> ForceSamples:
        samples = self._force.read()
        if self.guard is not None:
            self.guard.watch(samples)
            if self.guard.tripped:
                raise SensorError(f"touch-off: {self.guard.tripped}")
        if samples.saturated.any():
            raise SensorError("touch-off: the force sensor is saturated")
        t_ns = np.concatenate((self._t_ns, samples.t_ns))
        force = np.concatenate((self._tail_n, samples.force_n - self._zero_n))
        last = t_ns > t_ns[-1] - MEAN_WINDOW_NS
        self._t_ns, self._tail_n = t_ns[last], force[last]
        return samples
