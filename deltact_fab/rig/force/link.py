"""The way to a Net F/T box on the network: `pynetft` receives and stamps in its own thread."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from ...errors import MissingLibrary, SensorError
from .config import NetFTConfig
from .netft import ARRIVAL, ERROR, SATURATED, Arrivals, NetFTSettings
from .page import NetFTPage

if TYPE_CHECKING:
    import pynetft

FIRST_S = 1.0  # from the start of a stream to its first record
BIAS_S = 0.02  # from the command to bias to the first record that is less by it
BIAS_MEAN = 10  # records
BIAS_SHARE = 0.01  # of the range may be left after a bias
BIASES = 3  # attempts
DEFAULT_N, DEFAULT_NMM = 25.0, 250.0  # ranges of a transducer that does not tell
QUEUE = 1 << 15  # records that wait for a host that does not read: 4 s at 7 kHz
NEVER_S = 3600.0
HEALTH_NS = 200_000_000  # how often its counters are looked at


class PynetftLink:
    """Implements rig.force.netft.Link.

    After a fault the client does not start anew by itself: a box that was off has lost its bias.
    (Its own policy FAIL_STOP takes a datagram that came twice for a fault, and throws away what was
    received before one; so it is told to reconnect, in an hour.) Its stamps are CLOCK_MONOTONIC, as
    those of `rig.clock.WallClock`. Raises MissingLibrary without pynetft.
    """

    def __init__(self, config: NetFTConfig, page: NetFTPage) -> None:
        try:
            import pynetft
        except ImportError as why:
            raise MissingLibrary(
                "a Net F/T box is read with pynetft, which is missing: "
                "pip install 'deltact-fab[netft]'"
            ) from why
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
                receive_timeout=FIRST_S,
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

    def settings(self) -> NetFTSettings:
        """From the configuration page."""
        return self._settings

    def bias(self) -> None:
        """Bias on the box, which hears it while it streams only: with the next start."""
        self._bias_due = True

    def start(self) -> None:
        """Start the stream, wait for its first record, and bias where that is due."""
        self._restart()
        tries = BIASES
        while self._bias_due:
            # The client starts the stream anew behind a bias, and takes the box's numbers from 1
            # on for old ones if a record is still under way: so it starts from the start itself.
            self._require_well()
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
        self._client.stop()
        self._counted = {}
        try:
            self._client.start()
            heard = self._client.wait_for_first_sample(FIRST_S)
        except self._lib.NetFTError as why:
            raise SensorError(f"{self._where}: force sensor: {why}") from why
        if not heard:
            said = self._client.health().last_error
            self._client.stop()
            raise SensorError(
                f"{self._where}: force sensor: no record within {FIRST_S:g} s of the start"
                f"{f' ({said})' if said else ''}; check [force.netft] rdt_port, and that no "
                "fire wall holds UDP back"
            )

    def _require_well(self) -> None:
        """No box is tared in a fault, nor beyond its range."""
        sample = self._client.latest_sample()
        if sample is not None and sample.status & (ERROR | SATURATED):
            what = "saturated with nothing touching" if sample.status & SATURATED else "fault"
            raise SensorError(
                f"{self._where}: force sensor: {what}, status word 0x{sample.status:08x}"
            )

    def _left(self) -> str:
        """What is still felt after a bias, "" within bounds: a command may be lost unanswered."""
        counts: list[tuple[int, ...]] = []
        while len(counts) < BIAS_MEAN:
            if (sample := self._next(FIRST_S)) is None:
                self._require_streaming()
            else:
                counts.append(sample.raw_wrench)
        left = np.abs(np.mean(counts, axis=0))
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
        """All that came."""
        rows: list[tuple[int, int, int, tuple[int, ...]]] = []
        while (sample := self._next(0.0 if rows else timeout_s)) is not None:
            rows.append(
                (sample.received_at_ns, sample.rdt_sequence, sample.status, sample.raw_wrench)
            )
        if not rows:
            self._require_streaming()
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
        health = self._client.health()
        if health.state is not self._lib.ClientState.STREAMING:
            why = health.last_error or "it was not started"
            raise SensorError(f"{self._where}: force sensor: the stream ended: {why}")
