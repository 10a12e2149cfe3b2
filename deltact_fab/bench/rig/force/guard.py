"""Force guard: stops the stage directly when a limit is exceeded."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import inf

import numpy as np

from deltact_fab.common import Field, InputError, Note, Point

from ..interface import Clock, ForceSamples
from ..tables import ForceConfig, GuardConfig
from .netft import NoteCounts

# Decision 0031; the times by hand: a byte before its jog has begun is lost, more load the line.
GUARD_SHARE = 0.8  # of the sensor's range, where the rig file sets no limit
BYTE_PERIOD_NS = 20_000_000  # between two stop bytes
BYTE_REPEAT_NS = 100_000_000  # the byte is repeated at least so long after a trip
GROWTH_NS = 40_000_000  # a force that grows so long after the byte: it was not heard
EASE_RATIO = 1.25  # of the peak: limit while the tip is lifted after a trip
GUARD_AXES = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")


@dataclass(frozen=True)
class GuardLimits:
    """Largest force (N) and torque (N mm) of either sign on each axis, and of the whole force."""

    force_n: Point
    torque_nmm: Point = (inf, inf, inf)
    resultant_n: float = inf

    @classmethod
    def from_config(cls, guard: GuardConfig | None, force: ForceConfig) -> GuardLimits:
        """Limits of a rig file; default: `GUARD_SHARE` of the sensor's range.

        Raises InputError for a limit that the sensor cannot measure.
        """
        config = guard or GuardConfig()
        x, y, z = (GUARD_SHARE * n for n in force.range_n)
        force_n = config.axes_n or (x, y, z)
        if config.axes_n is None and config.force_n is not None:
            force_n = (config.force_n,) * 3
        x, y, z = (GUARD_SHARE * n for n in force.range_nmm)
        torque_nmm = (x, y, z) if config.torque_nmm is None else (config.torque_nmm,) * 3
        ranges = (*force.range_n, *force.range_nmm)
        for name, limit, range_max in zip(GUARD_AXES, (*force_n, *torque_nmm), ranges, strict=True):
            if limit > range_max:
                raise InputError(
                    f"guard: the limit {limit:g} of {name} is over the sensor's range of "
                    f"{range_max:g} ([force] range_n, range_nmm), so it would never trip"
                )
        return cls(force_n, torque_nmm, inf if config.resultant_n is None else config.resultant_n)

    @staticmethod
    def keys(guard: GuardConfig | None) -> tuple[str, str]:
        """Names of the rig file's keys behind the axis limits of force and torque."""
        configured = {} if guard is None else guard.model_dump(exclude_none=True)
        force, torque = (
            f"the guard, {GUARD_SHARE:g} of [force] {key}" for key in ("range_n", "range_nmm")
        )
        force_keys = [key for key in ("axes_n", "force_n") if key in configured]
        force = f"[guard] {force_keys[0]}" if force_keys else force
        return force, "[guard] torque_nmm" if "torque_nmm" in configured else torque


@dataclass(frozen=True)
class Trip:
    """Reason of a stop, time of the excess sample and time of the stop byte.

    Times are ns of the host's clock; record_ns is None if no sample caused it.
    """

    reason: str
    record_ns: int | None
    byte_ns: int


@dataclass
class ForceGuard:
    """Guard of the stage, which checks every sample first; usable in any thread, as it only writes.

    The reader of the sensor passes each batch to `watch` and a failure to `on_sensor_lost`. A trip
    lasts until `rearm`: the stop byte is repeated while samples are over the limit, because GRBL
    ignores one that arrives before its jog has begun.

    stop: writes the byte that ends the present move. hold: writes the one that ends any motion;
    used once if the force still grows GROWTH_NS after a trip.
    behind_s: on the wall clock, a guard whose newest sample stays older than that for as long
    again is blind, and stops the stage; a shorter delay is only counted in `tally`.
    None: ages are not checked, as in lockstep.
    """

    stop: Callable[[], None]
    limits: GuardLimits
    clock: Clock
    behind_s: float | None = None
    hold: Callable[[], None] | None = None

    def __post_init__(self) -> None:
        limits = self.limits
        self._bounds = np.array([*limits.force_n, *limits.torque_nmm, limits.resultant_n])
        self._peak = np.zeros(7)  # since the trip: six axes and the resultant
        self._easing = False
        self._byte_ns = 0
        self._held = False  # the other byte was written
        self._behind_ns: int | None = None  # time since samples are old
        self.tally = NoteCounts()
        self.trip: Trip | None = None

    @property
    def tripped(self) -> str:
        return self.trip.reason if self.trip is not None else ""

    def watch(self, samples: ForceSamples) -> None:
        """Write the stop byte for a sample over a limit or saturated, or if all are old."""
        if not len(samples.t_ns):
            return
        self._check_age(int(samples.t_ns[-1]))
        values = samples.counts / samples.per_unit
        sizes = np.column_stack((np.abs(values), np.sqrt((values[:, :3] ** 2).sum(axis=1))))
        bad = (sizes > self._bounds).any(axis=1) | samples.saturated
        if bad.any():
            self._trip_on(samples, sizes, int(bad.argmax()))
            since_ns = self.clock.now_ns() - self.trip.byte_ns if self.trip is not None else 0
            grows = since_ns > GROWTH_NS and sizes[-1, 6] > self._peak[6]
            if grows and self.hold is not None and not self._held:  # the first byte was not heard
                self.hold()
                self._held = True
            self._peak = np.maximum(self._peak, sizes.max(axis=0))
        elif (
            self.trip is not None
            and not self._easing
            and self.clock.now_ns() - self.trip.byte_ns < BYTE_REPEAT_NS
        ):
            self._write()

    def on_sensor_lost(self, reason: str) -> None:
        if not self._easing:
            self._write()
        if self.trip is None:
            self.trip = Trip(reason, None, self._byte_ns)

    def pop_notes(self) -> tuple[Note, ...]:
        return self.tally.pop_notes(self.clock.now_ns())

    def rearm(self) -> None:
        self.trip = None
        self._peak = np.zeros(7)
        self._byte_ns = 0
        self._held = False
        self._behind_ns = None

    @contextmanager
    def easing(self) -> Iterator[None]:
        """Raise the limits while the tip is lifted after a trip, to EASE_RATIO of the peak.

        A saturated or lost sensor does not stop the lift.
        """
        bounds = self._bounds
        self._bounds = np.maximum(self._bounds, EASE_RATIO * self._peak)
        self._easing = True
        try:
            yield
        finally:
            self._easing = False
            self._bounds = bounds

    def _check_age(self, newest_ns: int) -> None:
        """Stop the stage if samples stay older than behind_s for behind_s: the guard is blind."""
        if self.behind_s is None:
            return
        now_ns = self.clock.now_ns()
        old_ns, limit_ns = now_ns - newest_ns, self.behind_s * 1e9
        if old_ns <= limit_ns:
            self._behind_ns = None
            return
        self.tally.add("behind", 1, old_ns / 1e6)
        if self._behind_ns is None:
            self._behind_ns = now_ns
        elif now_ns - self._behind_ns > limit_ns:
            self.on_sensor_lost(
                f"force sensor: the host is {old_ns / 1e6:.0f} ms behind its stream; end other "
                "programs, check the network, or set a lower rate on the box"
            )

    def _trip_on(self, samples: ForceSamples, sizes: Field, k: int) -> None:
        """Write the byte, then record the reason. sizes: (n, 7) magnitudes; k: first excess."""
        if samples.saturated.any() and self._easing:
            return
        self._write()
        if self.trip is not None:
            return
        axis = int((sizes[k, :6] / self._bounds[:6]).argmax())
        value, unit = (samples.counts[k] / samples.per_unit)[axis], "N" if axis < 3 else "N mm"
        if samples.saturated[k]:
            reason = "the force sensor is saturated"
        elif sizes[k, axis] > self._bounds[axis]:
            limit = f"the guard's {self._bounds[axis]:g} {unit}"
            reason = f"{GUARD_AXES[axis]} = {value:.2f} {unit}, over {limit}"
        else:
            reason = f"resultant force {sizes[k, 6]:.2f} N, over the guard's {self._bounds[6]:g} N"
        self.trip = Trip(reason, int(samples.t_ns[k]), self._byte_ns)

    def _write(self) -> None:
        """Write the stop byte, at most every BYTE_PERIOD_NS."""
        now_ns = self.clock.now_ns()
        if not self._byte_ns or now_ns - self._byte_ns >= BYTE_PERIOD_NS:
            self.stop()
            self._byte_ns = now_ns
