"""A simulated ATI Net F/T box: the same commands and records, at its own rate in virtual time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..errors import DeltactFabError
from ..rig.config import ForceConfig
from ..rig.force.netft import (
    BIAS,
    COMMAND,
    HEADER,
    RECORD,
    SATURATED,
    STOP,
    STREAM,
    NetFTSettings,
)
from .clock import Ticks, VirtualClock, to_ns

COUNTS_PER_N = 1_000_000.0
COUNTS_PER_NMM = 100_000.0
MOST_COUNTS = 1e9  # of a range: a record holds twice that, so a sample less its bias fits
Wrenches = Callable[[NDArray[np.int64]], NDArray[np.float64]]


class NetFTBox:
    """Streams records made from the scene's wrench, noise and range.

    wrenches: forces (N) and torques (N mm) on the sensor (n, 6) at times (n,) ns up to now.
    noise_n: standard deviation of a sample.
    The bias is software bias, as the real box does it: it is subtracted from the gauges.
    """

    def __init__(
        self,
        config: ForceConfig,
        clock: VirtualClock,
        seed: int,
        wrenches: Wrenches,
        noise_n: float = 0.0,
    ) -> None:
        self._rate_hz = config.rate_hz
        self._noise_n = noise_n
        self._limits = np.array([*config.range_n, *config.range_nmm])
        counts_per_n = min(COUNTS_PER_N, MOST_COUNTS / max(config.range_n))
        counts_per_nmm = min(COUNTS_PER_NMM, MOST_COUNTS / max(config.range_nmm))
        self._per_unit = np.repeat([counts_per_n, counts_per_nmm], 3)
        self._clock = clock
        self._seed = seed
        self._wrenches = wrenches
        self._bias = np.zeros(6)
        self._rng = np.random.default_rng(np.random.SeedSequence([seed, 0]))
        self._ticks: Ticks | None = None
        self._left: int | None = None  # of the records asked for; None: without end
        self._sent = 0  # of the stream under way
        self._taken = 0  # since power-on
        self._out: deque[bytes] = deque()
        self._trouble: DeltactFabError | None = None

    def reseed(self, stream: int) -> None:
        """Start the noise of a press anew, so that a press redone alone gives the same samples."""
        self._rng = np.random.default_rng(np.random.SeedSequence([self._seed, 1, stream]))

    def settings(self) -> NetFTSettings:
        """What the box's configuration page tells."""
        counts_per_n, counts_per_nmm = self._per_unit[[0, 3]].tolist()
        return NetFTSettings(counts_per_n, counts_per_nmm, self._rate_hz, "simulated")

    def send(self, command: bytes) -> None:
        """Take one command datagram; unknown headers are ignored, as on the wire."""
        header, word, count = COMMAND.unpack(command)
        if header != HEADER:
            return
        if word == BIAS:
            gauges = self._gauges(np.array([self._clock.now_ns()]))[0]
            self._bias = np.clip(gauges, -self._limits, self._limits)
        elif word == STREAM:
            self._stop()
            self._sent, self._left = 0, count or None
            self._ticks = self._clock.every(self._rate_hz, self._sample)
        elif word == STOP:
            self._stop()

    def receive(self, timeout_s: float) -> bytes:
        """The next record, or nothing once the time-out has passed in virtual time.

        Raises what the scene raised when it was asked for a sample, after those before it.
        """
        if not self._out and self._trouble is None and timeout_s > 0:
            deadline_ns = self._clock.now_ns() + to_ns(timeout_s)
            next_ns = deadline_ns if self._ticks is None else self._ticks.next_ns
            self._clock.advance_to_ns(min(deadline_ns, next_ns))
        if self._out:
            return self._out.popleft()
        trouble, self._trouble = self._trouble, None
        if trouble is not None:
            raise trouble
        return b""

    def close(self) -> None:
        """Forget what was not read."""
        self._stop()
        self._out.clear()

    def _stop(self) -> None:
        if self._ticks is not None:
            self._ticks.cancel()
        self._ticks = None

    def _sample(self, t_ns: NDArray[np.int64]) -> None:
        """The clock's ticks: a record each."""
        if self._left is not None:
            t_ns = t_ns[: self._left]
            self._left -= len(t_ns)
        try:
            gauges = self._gauges(t_ns)
        except DeltactFabError as why:
            # It is no fault of whoever lets time pass just now, but of who reads the sensor.
            self._trouble = why
            self._stop()
            return
        limits = self._limits
        values = np.clip(gauges, -limits, limits) - self._bias
        records = np.zeros(len(t_ns), RECORD)
        k = np.arange(1, len(t_ns) + 1)
        records["rdt"], records["ft"] = self._sent + k, self._taken + k
        records["status"] = np.where((np.abs(gauges) > limits).any(axis=1), SATURATED, 0)
        records["counts"] = np.rint(values * self._per_unit)
        self._sent += len(t_ns)
        self._taken += len(t_ns)
        data = records.tobytes()
        self._out += [data[i : i + RECORD.itemsize] for i in range(0, len(data), RECORD.itemsize)]
        if self._left == 0:
            self._stop()

    def _gauges(self, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        noise_nmm = self._noise_n * 10.0  # a 10 mm arm
        scale = np.repeat([self._noise_n, noise_nmm], 3)
        noise = self._rng.standard_normal((len(t_ns), 6))
        return np.asarray(self._wrenches(t_ns) + scale * noise, float)
