"""A simulated ATI Net F/T box: the same 36-byte records, its newest sample at virtual time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..rig.config import ForceConfig
from ..rig.force import BIAS, COMMAND, HEADER, RECORD, SATURATED, STREAM, NetFTSettings
from ..rig.interface import Clock

COUNTS_PER_N = 1_000_000.0
COUNTS_PER_NMM = 100_000.0
MOST_COUNTS = 1e9  # of a range: a record holds twice that, so a sample less its bias fits
Vector = tuple[float, float, float]
Wrench = tuple[Vector, Vector]


class NetFTBox:
    """Answers RDT commands with records made from the scene's wrench, noise and range.

    wrench: returns (force_n, torque_nmm) on the sensor at this moment.
    The bias is software bias, as the real box does it: it is subtracted from the gauges.
    """

    def __init__(
        self,
        config: ForceConfig,
        clock: Clock,
        seed: int,
        wrench: Callable[[], Wrench],
        noise_n: float = 0.0,
    ) -> None:
        self._rate_hz = config.rate_hz
        self._noise_n = noise_n
        self._limits = np.asarray([*config.range_n, *config.range_nmm])
        self._counts_per_n = min(COUNTS_PER_N, MOST_COUNTS / max(config.range_n))
        self._counts_per_nmm = min(COUNTS_PER_NMM, MOST_COUNTS / max(config.range_nmm))
        self._clock = clock
        self._seed = seed
        self._wrench = wrench
        self._bias = np.zeros(6)
        self._rng = np.random.default_rng(np.random.SeedSequence([seed, 0]))
        self._sequence = 0
        self._out: list[bytes] = []

    def reseed(self, stream: int) -> None:
        """Start the noise of a press anew, so that a press redone alone gives the same samples."""
        self._rng = np.random.default_rng(np.random.SeedSequence([self._seed, 1, stream]))

    def settings(self) -> NetFTSettings:
        """What the box's configuration page tells."""
        return NetFTSettings(self._counts_per_n, self._counts_per_nmm, "simulated")

    def send(self, command: bytes) -> None:
        """Take one command datagram; unknown headers are ignored, as on the wire."""
        header, word, count = COMMAND.unpack(command)
        if header != HEADER:
            return
        if word == BIAS:
            self._bias = np.clip(self._gauges(), -self._limits, self._limits)
        elif word == STREAM:
            self._out += [self._record() for _ in range(count)]

    def receive(self, timeout_s: float) -> bytes:
        """The next record, or nothing once the time-out has passed in virtual time."""
        if not self._out:
            self._clock.sleep_s(timeout_s)
            return b""
        return self._out.pop(0)

    def close(self) -> None:
        """Forget what was not read."""
        self._out.clear()

    def _gauges(self) -> np.ndarray:
        force_n, torque_nmm = self._wrench()
        noise_nmm = self._noise_n * 10.0  # a 10 mm arm
        scale = np.repeat([self._noise_n, noise_nmm], 3)
        return np.asarray([*force_n, *torque_nmm]) + scale * self._rng.standard_normal(6)

    def _record(self) -> bytes:
        # The clock of the box, not the host's: samples are numbered at the box's own rate.
        self._sequence = max(self._sequence + 1, round(self._clock.now_s() * self._rate_hz))
        gauges = self._gauges()
        status = SATURATED if np.any(np.abs(gauges) > self._limits) else 0
        values = np.clip(gauges, -self._limits, self._limits) - self._bias
        scale = np.repeat([self._counts_per_n, self._counts_per_nmm], 3)
        counts = np.rint(values * scale).astype(int)
        return RECORD.pack(self._sequence, self._sequence, status, *(int(c) for c in counts))
