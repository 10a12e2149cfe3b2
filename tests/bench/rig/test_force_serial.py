"""A serial scale on a pseudo terminal, written to by a thread as a scale does."""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Callable

import numpy as np
import pytest
from scale_on_pty import scale

from deltact_fab.bench.rig.check import force_rows
from deltact_fab.bench.rig.force.watchdog import open_force
from deltact_fab.bench.rig.interface import ForceSamples, ForceSensor, WallClock
from deltact_fab.bench.rig.tables import ForceConfig, SerialScaleConfig
from deltact_fab.common.aliases import Note
from deltact_fab.common.errors import InputError, SensorError


def until(sensor: ForceSensor, what: Callable[[ForceSamples], bool]) -> ForceSamples:
    """Read until samples are so; they must be within 10 s."""
    end_s = time.monotonic() + 10
    while time.monotonic() < end_s:
        samples = sensor.read()
        if what(samples):
            return samples
    raise AssertionError("waited 10 s for nothing")


def test_line_is_tared_sample_in_newtons() -> None:
    with scale() as it:
        sensor = it.opened(unit="g", scale=-1.0)
        sensor.begin("p1")
        it.line = lambda k: "+  101.01 g\n"  # 100 g more than the tare of 1.01 g
        samples = until(sensor, lambda s: s.force_n[-1, 2] < -0.5)
        assert samples.force_n[-1] == pytest.approx((0, 0, -0.980665), abs=2e-4)
        before = sensor.read().t_ns[-1]
        sensor.stop()
        sensor.start()
        after = sensor.read()
        assert after.t_ns[0] > before
        assert after.force_n[-1, 2] == pytest.approx(-0.980665, abs=2e-4)  # on the same tare
        assert sensor.identity()["columns"] == ["fz"]
        sensor.close()
        sensor.close()


def test_six_axes_behind_time_column() -> None:
    with scale() as it:
        columns = ("-", "fx", "fy", "fz", "tx", "ty", "tz")
        sensor = it.opened(columns=columns, torque_unit="Nm")
        it.line = lambda k: f"{k},0,0,0,0,0,0\n"
        sensor.begin("p1")
        it.line = lambda k: f"{k}, 1.5, -2e-1, -.5, .01, 0, -0.02\n"
        samples = until(sensor, lambda s: s.force_n[-1, 0] > 1)
        assert samples.force_n[-1] == pytest.approx((1.5, -0.2, -0.5), abs=1e-5)
        assert samples.torque_nmm[-1] == pytest.approx((10.0, 0.0, -20.0), abs=1e-3)
        sensor.close()


def test_lines_have_own_times_and_rate() -> None:
    with scale() as it:
        sensor = it.opened()
        sensor.begin("p1")
        t_ns = []
        while len(t_ns) <= 20:
            time.sleep(0.05)  # several lines wait
            t_ns += sensor.read().t_ns.tolist()
        assert all(a < b for a, b in itertools.pairwise(t_ns))
        assert t_ns[-1] <= time.monotonic_ns()
        assert 20 < sensor.identity()["rate_hz"] < 210  # a busy machine writes more slowly
        sensor.close()


@pytest.mark.slow
def test_garbage_is_counted_never_a_reading() -> None:
    with scale() as it:
        sensor = it.opened()
        sensor.begin("p1")
        it.line = lambda k: [f"{1 + k % 3 / 100}\n", "OL\n", "1.01 1.01\n", "\x00\x7f\n"][k % 4]
        notes: list[Note] = []
        forces = []
        end_s = time.monotonic() + 1.3
        while time.monotonic() < end_s:
            samples = sensor.read()
            notes += samples.notes
            forces += samples.force_n[:, 2].tolist()
        assert np.abs(forces).max() < 0.02
        assert all(note.id == "garbage" for note in notes)
        assert 1 <= len(notes) <= 3
        sensor.close()


def test_value_beyond_range_is_saturated() -> None:
    with scale() as it:
        sensor = it.opened()
        sensor.begin("p1")
        it.line = lambda k: "-1e300\n"
        assert until(sensor, lambda s: bool(s.saturated.any())).force_n[-1, 2] < -50
        sensor.close()


def test_silence_and_unplugging_are_errors() -> None:
    with scale() as it:
        sensor = it.opened()
        sensor.begin("p1")
        it.line = lambda k: "HX711 not found.\n"
        with pytest.raises(
            SensorError, match=r"no reading within 0.5 s: the last line was 'HX711 not found.': rep"
        ):
            until(sensor, lambda s: False)
        it.done.set()
        time.sleep(0.05)
        os.close(it.ours)
        it.ours = -1
        with pytest.raises(SensorError, match="lost the scale's port"):
            until(sensor, lambda s: False)
        sensor.close()


@pytest.mark.parametrize(("share", "status"), [(1.0, "pass"), (0.5, "warn")])
def test_declared_rate_held_against_measured(share: float, status: str) -> None:
    """A busy machine slows the scale between two measurements: one of five must be even."""
    with scale() as it:
        for _ in range(5):
            sensor = it.opened()
            sensor.begin("p1")
            rate_hz = share * float(sensor.identity()["rate_hz"])
            sensor.close()
            serial = SerialScaleConfig(port=it.port, rate_hz=rate_hz)
            rows = {row.id: row for row in force_rows(ForceConfig(serial=serial), None, 0.1)}
            if rows["force.rate"].status == status:
                break
    assert rows["force.rate"].status == status
    assert ("force.serial.rate_hz =" in rows["force.rate"].remedy) == (status == "warn")


def test_invalid_scale_is_refused() -> None:
    with pytest.raises(SensorError, match="/nowhere/tty: cannot open the scale's port"):
        open_force(ForceConfig(serial=SerialScaleConfig(port="/nowhere/tty")), WallClock())
    with pytest.raises(InputError, match=r"force.serial: port: bad://x: not a serial port"):
        open_force(ForceConfig(serial=SerialScaleConfig(port="bad://x")), WallClock())
    with pytest.raises(InputError, match=r"no connection given; add \[force.netft\]"):
        open_force(ForceConfig(), WallClock())
    for own in ({"columns": ("fz", "fz")}, {"columns": ("-",)}, {"scale": 0.0}, {"rate_hz": 0}):
        with pytest.raises(ValueError, match=r"columns: each axis once|scale: must not|rate_hz"):
            SerialScaleConfig(port="x", **own)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("line", "verdict", "text"),
    [
        (lambda k: "40.8 g\n", "warn", "equal readings: a dead sensor, or a scale at rest"),
        (lambda k: "0.0\n", "warn", "equal readings: a dead sensor, or a scale at rest"),
        (lambda k: f"{40.8 + k % 7 / 10} g\n", "pass", "readings change"),
        (lambda k: f"{40.8 if k < 75 else 940.8} g\n", "pass", "readings change"),
        (lambda k: "HX711 not found.\n", "fail", "'HX711 not found.': reports an error"),
        (lambda k: "0.0408 kg\n", "fail", 'force.serial.unit is "g", and the line is in kg'),
    ],
    ids=["stuck", "zero", "noise", "pressed", "text", "kg"],
)
def test_check_of_scale_asks_for_change(
    line: Callable[[int], str], verdict: str, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("deltact_fab.bench.rig.force.scale.FIRST_LINE_S", 0.5)
    with scale() as it:
        it.line, it.period_s = line, 0.01
        rows = [*force_rows(it.config(unit="g"), None, 0.6)]
    (row,) = (row for row in rows if text in row.value)
    assert row.status == verdict
    others = [other for other in rows if other is not row and other.id != "force.rate"]
    assert all(other.status == "pass" for other in others)  # a busy machine writes more slowly
