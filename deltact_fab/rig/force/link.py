"""The way to a Net F/T box on the network: `pynetft` receives and stamps in its own thread."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from ...errors import SensorError
from ...extras import require
from .config import NetFTConfig
from .netft import ARRIVAL, ERROR, SATURATED, Arrivals, NetFTSettings
from .page import NetFTPage

if TYPE_CHECKING:
    import pynetft

FIRST_S = 1.0  # from the start of a stream to its first record
BIAS_S = 0.02  # from the command to bias to the first record that is less by it
AHEAD = 10  # records that are heard before a start is over
BIAS_SHARE = 0.01  # of the range may be left after a bias
BIASES = 3  # attempts
DEFAULT_N, DEFAULT_NMM = 25.0, 250.0  # ranges of a transducer that does not tell
QUEUE = 1 << 15  # records that wait for a host that does not read: 4 s at 7 kHz
NEVER_S = 3600.0
TAKE_S = 0.02  # so long at most is spent on taking what came: the guard looks in between
HEALTH_NS = 200_000_000  # how often its counters are looked at


class PynetftLink:
    """Implements rig.force.netft.Link.

    After a fault the client does not start anew by itself: a box that was off has lost its bias.
    (Its own policy FAIL_STOP takes a datagram that came twice for a fault, and throws away what was
    received before one; so it is told to reconnect, in an hour.) Its stamps are CLOCK_MONOTONIC, as
    those of `rig.clock.WallClock`. Raises MissingLibrary without pynetft.
    """

    def __init__(self, config: NetFTConfig, page: NetFTPage) -> None:
        require("netft", "a Net F/T box", "pynetft")
        import pynetft

        self._lib = pynetft
        self._settings = page.settings
        s = self._settings
        # What the page says, once: the client would fetch it anew at every start.
        calibration = pynetft.Calibration(
            s.counts_per_n,
            s.counts_per_nmm,
            pynetft.ForceUnit.NEWTON,
            pynetft.TorqueUnit.NEWTON_MILLIMETER,
        )
        self._where = f"{config.host}:{config.rdt_port}"
        self._client = pynetft.Client(
            pynetft.Config(
                sensor_host=config.host,
                rdt_port=config.rdt_port,
                http_port=config.http_port,
                receive_timeout=2 * FIRST_S,  # who reads finds silence sooner
                deliver_samples_with_error_status=True,
                recovery_policy=pynetft.RecoveryPolicy.RECONNECT,
                reconnect_initial_delay=NEVER_S,
                reconnect_max_delay=NEVER_S,
                calibration_override=calibration,
            ),
            queue_size=QUEUE,
        )
        ranges = [*(page.range_n or [DEFAULT_N] * 3), *(page.range_nmm or [DEFAULT_NMM] * 3)]
        per_unit = np.repeat([s.counts_per_n, s.counts_per_nmm], 3)
        self._bias_most = BIAS_SHARE * np.array(ranges) * per_unit
        self._looked_ns = 0
        self._counted: dict[str, int] = {}
        self._bias_due = False
        self._ahead: list[pynetft.Sample] = []  # heard at the start, not given yet

    def settings(self) -> NetFTSettings:
        """From the configuration page."""
        return self._settings

    def bias(self) -> None:
        """Bias on the box, which hears it while it streams only: with the next start."""
        self._bias_due = True

    def start(self) -> None:
        """Start the stream, hear its first records, and bias where that is due."""
        self._restart()
        tries = BIASES
        while self._bias_due:
            # The client starts the stream anew behind a bias, and takes the box's numbers from 1
            # on for old ones if a record is still under way: so it starts from the start itself.
            try:
                self._client.bias()
            except self._lib.NetFTError as why:
                raise SensorError(f"{self._where}: force sensor: {why}") from why
            time.sleep(BIAS_S)
            self._restart()
            left = self._left()
            tries -= 1
            self._bias_due = bool(left)
            if self._bias_due and not tries:
                raise SensorError(
                    f"{self._where}: force sensor: {left} are left after a bias; something "
                    "pulls at it, or the box does not hear commands"
                )

    def _restart(self) -> None:
        """The first record may be slow to come: the earliest of some tells when they were taken."""
        self._client.stop()
        self._counted, self._ahead = {}, []
        try:
            self._client.start()
            heard = self._client.wait_for_first_sample(FIRST_S)
        except self._lib.NetFTError as why:
            raise SensorError(f"{self._where}: force sensor: {why}") from why
        while heard and len(self._ahead) < AHEAD:
            if (sample := self._next(FIRST_S)) is None:
                break
            self._ahead.append(sample)
        self._require_streaming()
        if len(self._ahead) < AHEAD:
            self._client.stop()
            raise SensorError(
                f"{self._where}: force sensor: no record within {FIRST_S:g} s of the start; check "
                "[force.netft] rdt_port, and that no fire wall holds UDP back"
            )

    def _left(self) -> str:
        """What is still felt after a bias, "" within bounds: a command may be lost unanswered."""
        left = np.abs(np.mean([sample.raw_wrench for sample in self._ahead], axis=0))
        if (left <= self._bias_most).all():
            return ""
        s = self._settings
        return (
            f"{max(left[:3]) / s.counts_per_n:.2f} N, {max(left[3:]) / s.counts_per_nmm:.1f} N mm"
        )

    def stop(self) -> None:
        """Stop the stream and close its socket: what is under way comes to nobody."""
        self._client.stop()

    def receive(self, timeout_s: float) -> Arrivals:
        """All that came; of a stream that is faster than this host, what it takes in TAKE_S."""
        samples, self._ahead = self._ahead, []
        end_s = time.monotonic() + timeout_s + TAKE_S
        while (sample := self._next(0.0 if samples else timeout_s)) is not None:
            if not samples:
                end_s = time.monotonic() + TAKE_S
            samples.append(sample)
            if time.monotonic() > end_s:
                break
        if not samples:
            self._require_streaming()
        rows = [(s.received_at_ns, s.rdt_sequence, s.status, s.raw_wrench) for s in samples]
        return np.array(rows, ARRIVAL)

    def troubles(self) -> dict[str, int]:
        """From the client's counters, looked at a few times a second."""
        now_ns = time.monotonic_ns()
        if now_ns - self._looked_ns < HEALTH_NS:
            return {}
        self._looked_ns = now_ns
        health = self._client.health()
        counts = {
            "garbage": health.malformed_count,
            "duplicate": health.duplicate_count,
            "order": health.out_of_order_count,
            "overrun": health.python_queue_dropped_count,
        }
        before, self._counted = self._counted, counts
        return {name: n - before.get(name, 0) for name, n in counts.items()}

    def close(self) -> None:
        """Stop streaming."""
        self._client.stop()

    def _next(self, wait_s: float) -> pynetft.Sample | None:
        try:
            return next(self._client.samples(max(wait_s, 0.0)), None)
        except TimeoutError:
            return None

    def _require_streaming(self) -> None:
        """Raise SensorError when the client has ended the stream, with what the box said."""
        health = self._client.health()
        state = self._lib.ClientState
        if health.state in (state.STREAMING, state.CONNECTING):
            return
        why = health.last_error or "it was not started"
        if health.last_status & (ERROR | SATURATED):
            what = "saturated" if health.last_status & SATURATED else "a fault of the box"
            why = f"{what}, status word 0x{health.last_status:08x}"
        raise SensorError(f"{self._where}: force sensor: the stream ended: {why}")
