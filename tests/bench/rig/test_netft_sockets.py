"""A Net F/T box on real sockets: read by our own client, and by pynetft alone."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import numpy as np
import pynetft
import pytest
from numpy.typing import NDArray

from deltact_fab.bench.rig.check import force_rows
from deltact_fab.bench.rig.force.netft import NetFTSensor
from deltact_fab.bench.rig.force.rdt import fetch_settings
from deltact_fab.bench.rig.force.watchdog import open_force
from deltact_fab.bench.rig.interface import ForceSamples, WallClock
from deltact_fab.bench.rig.tables import ForceConfig, GuardConfig, NetFTConfig
from deltact_fab.common.errors import InputError, SensorError
from deltact_fab.simulate.virtual.netft import BoxFaults
from deltact_fab.simulate.virtual.served import NetFTServer

WAIT_S = 2.0  # silence that this busy machine may make by itself


class Hand:
    """A wrench that the test sets."""

    def __init__(self) -> None:
        self.wrench = np.zeros(6)

    def __call__(self, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        return np.tile(self.wrench, (len(t_ns), 1))


def way(box: NetFTServer, **own: Any) -> NetFTConfig:
    return NetFTConfig(host=box.host, rdt_port=box.rdt_port, http_port=box.http_port, **own)


def opened(box: NetFTServer, silent_s: float = WAIT_S) -> NetFTSensor:
    sensor = open_force(ForceConfig(netft=way(box, silent_s=silent_s)), WallClock())
    assert isinstance(sensor, NetFTSensor)
    return sensor


def until(sensor: NetFTSensor, what: Callable[[ForceSamples], bool]) -> list[ForceSamples]:
    """Read until samples are so, within 10 s; all of them."""
    parts = []
    end_s = time.monotonic() + 10
    while time.monotonic() < end_s:
        parts.append(sensor.read())
        if what(parts[-1]):
            return parts
    raise AssertionError("waited 10 s for nothing")


# ---- strangers ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "data", [b"", b"short", b"\0\1" + bytes(18)], ids=["empty", "short", "STUN"]
)
def test_foreign_datagram_takes_no_stream(data: bytes) -> None:
    with NetFTServer(Hand()) as box:
        sensor = opened(box)
        sensor.begin("p1")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            for _ in range(3):
                stranger.sendto(data, (box.host, box.rdt_port))
                until(sensor, lambda s: len(s.force_n) > 0)
            stranger.settimeout(0.1)
            with pytest.raises(TimeoutError):
                stranger.recv(64)
        sensor.close()


def test_idle_connections_block_no_page() -> None:
    """A browser opens connections in advance, on which nothing comes."""
    with NetFTServer(Hand()) as box, ExitStack() as idle:
        for _ in range(6):
            idle.enter_context(socket.create_connection((box.host, box.http_port)))
        assert fetch_settings(way(box)).rate_hz > 0


# ---- our client ---------------------------------------------------------------------------------


def test_samples_unique_with_units_tare_times() -> None:
    hand = Hand()
    hand.wrench = np.array([0.3, 0.0, -0.2, 1.0, 0.0, 0.0])
    with NetFTServer(hand) as box:
        sensor = opened(box)
        before_ns = time.monotonic_ns()
        sensor.begin("p1")
        hand.wrench = np.array([1.3, 0.0, -2.2, 3.0, 0.0, 0.0])
        parts = until(sensor, lambda s: s.force_n[-1, 0] > 0.9)
        parts += [sensor.read() for _ in range(200)]
        after_ns = time.monotonic_ns()
        assert parts[0].force_n[0] == pytest.approx((0, 0, 0), abs=1e-6) or len(parts) < 210
        assert parts[-1].force_n[-1] == pytest.approx((1.0, 0.0, -2.0), abs=1e-6)
        assert parts[-1].torque_nmm[-1] == pytest.approx((2.0, 0.0, 0.0), abs=1e-5)
        t_ns = np.concatenate([part.t_ns for part in parts])
        assert before_ns < t_ns[0]
        assert t_ns[-1] <= after_ns
        assert (np.diff(t_ns) > 0).all()
        lost = sum(part.n_lost for part in parts)
        assert len(t_ns) + lost == pytest.approx((t_ns[-1] - t_ns[0]) / 1e6 + 1, abs=2)
        about = sensor.identity()
        assert (about["serial"], about["rate_hz"]) == ("FT00001", 1000.0)
        sensor.stop()
        sensor.start()
        assert sensor.read().t_ns[0] > t_ns[-1]
        sensor.close()
        sensor.close()


def test_kernel_clock_set_while_reading(monkeypatch: pytest.MonkeyPatch) -> None:
    """The kernel stamps by the time of day, which may be set forward by half a second."""
    with NetFTServer(Hand()) as box:
        sensor, time_ns = opened(box), time.time_ns
        sensor.start()
        sensor.read()
        monkeypatch.setattr(time, "time_ns", lambda: time_ns() + 500_000_000)
        end_ns = time.monotonic_ns() + 300_000_000
        samples = until(sensor, lambda s: time.monotonic_ns() > end_ns)[-1]
        assert time.monotonic_ns() - samples.t_ns[-1] < 2.5e8
        sensor.close()


class Network(BoxFaults):
    """Of every twentieth record: what becomes of it on its way."""

    def __init__(self, what: str) -> None:
        super().__init__(drop_every=20 if what == "gap" else 0)
        self.what, self.held = what, list[bytes]()

    def payloads(self, number: int, record: bytes) -> list[bytes]:
        held, self.held = self.held, []
        if number % 20 or self.what == "gap":
            return [*super().payloads(number, record), *held]
        if self.what == "order":  # it comes after the next one
            self.held = [record]
            return []
        return [record, record] if self.what == "duplicate" else [record[:20], record]


@pytest.mark.parametrize("name", ["duplicate", "order", "garbage", "gap", "stray"])
def test_network_faults_are_counted_never_readings(name: str) -> None:
    hand = Hand()
    hand.wrench = np.array([0.0, 0.0, -2.0, 0.0, 0.0, 0.0])
    with NetFTServer(hand) as box, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        sensor = opened(box)
        sensor.start()
        if name == "stray":  # a plausible record with a huge force, from somebody else
            parts, ours = [], sensor._link._socket.getsockname()  # type: ignore[attr-defined]
            for _ in range(100):
                other.sendto(b"\x00\x00\xff\x00" * 3 + b"\x7f" * 24, ours)
                parts.append(sensor.read())
        else:
            box._box.faults = Network(name)
            parts = until(sensor, lambda s: any(n.id == name for n in s.notes))
        assert all((part.force_n[:, 2] == -2.0).all() for part in parts)
        assert (np.diff(np.concatenate([part.t_ns for part in parts])) > 0).all()
        sensor.close()


def test_late_datagrams_noted_with_true_times() -> None:
    hand = Hand()
    with NetFTServer(hand) as box:
        sensor = opened(box)
        sensor.start()
        until(sensor, lambda s: s.t_ns[-1] > time.monotonic_ns() - 5_000_000)
        box.faults.late_s = 0.2
        parts = until(sensor, lambda s: s.n_late > 0 and time.monotonic_ns() - s.t_ns[-1] > 150e6)
        assert any(note.id == "late" for note in parts[-1].notes) or sensor.tally.total["late"]
        box.faults.late_s = 0.0
        until(sensor, lambda s: time.monotonic_ns() - s.t_ns[-1] < 50e6)  # and is over with it
        sensor.close()


@pytest.mark.parametrize("fault", ["error", pytest.param("saturated", marks=pytest.mark.slow)])
def test_faulted_box_gives_no_reading(fault: str) -> None:
    hand = Hand()
    hand.wrench = np.array([0.0, 0.0, -2.0, 0.0, 0.0, 0.0])
    with NetFTServer(hand) as box:
        sensor = opened(box)
        sensor.start()
        sensor.read()
        setattr(box.faults, fault, True)
        if fault == "saturated":
            parts = until(sensor, lambda s: bool(s.saturated.any()))
            assert parts[-1].saturated[-1]
        else:
            with pytest.raises(SensorError, match=r"status word 0x80000000"):
                until(sensor, lambda s: False)
        setattr(box.faults, fault, False)
        sensor.start()
        assert sensor.read().force_n[-1, 2] == -2.0
        sensor.close()


@pytest.mark.slow
def test_silence_is_error_within_its_limit() -> None:
    with NetFTServer(Hand()) as box:
        sensor = opened(box, 0.3)
        sensor.start()
        sensor.read()
        box.faults.silent = True
        before_s = time.monotonic()
        with pytest.raises(SensorError, match="no sample within 300 ms"):
            until(sensor, lambda s: False)
        assert time.monotonic() - before_s < 5
        with pytest.raises(SensorError, match="no record within 1 s of the start"):
            sensor.start()
        sensor.close()


def test_unreachable_disabled_or_wrong_box_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with NetFTServer(Hand()) as box:
        with pytest.raises(InputError, match=r"serial number 'FT00001'.*serial = 'FT11564'"):
            fetch_settings(way(box, serial="FT11564"))
        assert fetch_settings(way(box, serial="FT00001")).range_n == (25.0, 25.0, 35.0)
        box.page["comrdte"] = "Disabled"
        with pytest.raises(SensorError, match="comrdte: RDT is disabled; enable it"):
            fetch_settings(way(box))
        box.page["comrdte"] = "Enabled"
        box.page["scfgfu"] = "furlong"
        with pytest.raises(SensorError, match="scfgfu: unknown unit 'furlong'"):
            fetch_settings(way(box))
        box.page["scfgfu"] = "N"
        monkeypatch.setenv("http_proxy", "http://127.0.0.1:9")
        assert fetch_settings(way(box)).range_n is not None
        box.path = "/elsewhere.xml"
        with pytest.raises(SensorError, match=r"cannot be read \(HTTP Error 404"):
            fetch_settings(way(box))
        nobody = way(box)
    with pytest.raises(
        SensorError, match=r"netftapi2.xml: cannot be read .* check the box's power"
    ):
        fetch_settings(nobody)


@pytest.mark.parametrize(
    ("force", "torque"),
    [(("lbf", 4.4482216152605), ("lbf-in", 112.9848290276167)), (("kN", 1e3), ("Nm", 1e3))],
)
def test_other_box_units_become_newtons(
    force: tuple[str, float], torque: tuple[str, float]
) -> None:
    hand = Hand()
    hand.wrench = np.array([2.0, 0.0, -3.0, 40.0, 0.0, 0.0])
    with NetFTServer(hand) as box:
        for key, counts, (unit, scale) in (("f", 1e6, force), ("t", 1e5, torque)):
            box.page |= {f"scfg{key}u": unit, f"cfgcp{key}": f"{counts * scale:.0f}"}
        sensor = opened(box)
        sensor.start()
        samples = sensor.read()
        assert samples.force_n[-1] == pytest.approx((2.0, 0.0, -3.0), rel=1e-5)
        assert samples.torque_nmm[-1] == pytest.approx((40.0, 0.0, 0.0), rel=1e-5, abs=2e-5)
        sensor.close()


# ---- what `rig check` finds ----


def found(box: NetFTServer, guard: GuardConfig | None = None, **own: object) -> dict[str, bool]:
    config = ForceConfig(netft=way(box, silent_s=2), **own)  # type: ignore[arg-type]
    return {row.value: row.status == "pass" for row in force_rows(config, guard, 0.3)}


@pytest.mark.slow
def test_wrong_range_is_reported_with_right() -> None:
    with NetFTServer(Hand(), noise_n=0.0) as box:
        box.faults.stuck = True
        lines = found(box, GuardConfig(force_n=60.0), range_n=(50.0, 50.0, 70.0))
        wrong = "\n".join(text for text, passed in lines.items() if not passed)
        assert "[50.0, 50.0, 70.0]; the transducer has [25.0, 25.0, 35.0]: use that" in wrong
        assert "the readings do not change: all axes equal for " in wrong
        assert "guard: the limit 60 of Fx is over the sensor's range of 50" in wrong
        box.faults.stuck, box.faults.error = False, True
        assert "fault, status word 0x80000000" in "\n".join(found(box))
        box.page["comrdte"] = "Disabled"
        assert list(found(box).values()) == [False, True]  # and the guard


# ---- pynetft by itself, which knows nothing of ours ----


@pytest.mark.slow
def test_pynetft_reads_the_simulated_box() -> None:
    hand = Hand()
    hand.wrench = np.array([1.5, -0.25, -2.0, 10.0, 0.0, 5.0])
    with NetFTServer(hand) as box:
        config = pynetft.Config(
            sensor_host=box.host,
            rdt_port=box.rdt_port,
            http_port=box.http_port,
            receive_timeout=WAIT_S,
        )
        with pynetft.Client(config, queue_size=8192) as client:
            samples = client.samples(timeout=WAIT_S)
            first = next(samples)
            before_s = time.monotonic()
            taken = [next(samples) for _ in range(600)]
            took_s = time.monotonic() - before_s
            assert first.force_unit == pynetft.ForceUnit.NEWTON
            assert first.wrench == pytest.approx((1.5, -0.25, -2.0, 10.0, 0.0, 5.0), abs=1e-5)
            health = client.health()
            assert (health.malformed_count, health.duplicate_count) == (0, 0)
            numbers = [sample.rdt_sequence for sample in taken]
            assert numbers[-1] - numbers[0] == 599 + client.health().lost_count
            assert 0.55 < took_s < 5  # 1000 a second
            client.bias()
            assert any(
                next(samples).wrench == pytest.approx((0,) * 6, abs=1e-5) for _ in range(2000)
            )
