"""The force guard stops the real host's stage, on the simulated controller in virtual time."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf

import numpy as np
import pytest

from deltact_fab.bench.rig.force.guard import ForceGuard, GuardLimits
from deltact_fab.bench.rig.interface import ForceSamples
from deltact_fab.bench.rig.stage.grbl import GrblStage
from deltact_fab.bench.rig.tables import ForceConfig, GuardConfig
from deltact_fab.common.errors import InputError
from deltact_fab.sensor.optics.camera import StageFrame
from deltact_fab.simulate.virtual.clock import VirtualClock
from deltact_fab.simulate.virtual.controller import GrblController
from deltact_fab.simulate.virtual.grbl_lines import grbl_settings
from deltact_fab.simulate.virtual.wire import SerialLink

LIMITS = GuardLimits((4.0, 4.0, 8.0), (50.0, 50.0, 50.0), 9.0)


class Bench:
    """A stage that is homed at the clearance plane."""

    def __init__(self) -> None:
        self.clock = VirtualClock()
        sizes = (100.0,) * 3, (1000.0,) * 3, (100.0,) * 3
        self.controller = GrblController(grbl_settings(*sizes), self.clock)
        self.link = SerialLink(self.controller, self.clock)
        frame = StageFrame((-50.0, -50.0, -20.0))
        self.stage = GrblStage(self.link, self.clock, frame)
        self.guard = ForceGuard(self.stage.cancel, LIMITS, self.clock, 0.1)

    def samples(
        self,
        fx: float = 0.0,
        fz: float = 0.0,
        tx: float = 0.0,
        saturated: bool = False,
        old_s: float = 0.0,
    ) -> ForceSamples:
        """Two of them, the last with these values, taken just now or so long ago."""
        now_ns = self.clock.now_ns() - round(old_s * 1e9)
        counts = np.array([[0] * 6, [fx * 1e3, 0, fz * 1e3, tx * 1e3, 0, 0]], np.int32)
        t_ns = np.array([now_ns - 1_000_000, now_ns])
        return ForceSamples(t_ns, counts, np.full(6, 1e3), np.array([False, saturated]))

    def watched(self, for_s: float, **values: float) -> None:
        """The same samples for that long."""
        end_ns = self.clock.now_ns() + round(for_s * 1e9)
        while self.clock.now_ns() < end_ns:
            self.clock.sleep_s(0.002)
            self.guard.watch(self.samples(**values))


@pytest.fixture
def bench() -> Iterator[Bench]:
    it = Bench()
    it.stage.connect()
    it.stage.home()
    it.stage.start_move((0.0, 0.0, 5.0), 900)
    it.stage.wait()
    yield it
    it.stage.close()


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ({"fz": -8.1}, "Fz = -8.10 N, over the guard's 8 N"),
        ({"fx": 4.1}, "Fx = 4.10 N, over the guard's 4 N"),
        ({"fx": 3.9, "fz": -7.9}, None),
        ({"fx": 3.9, "fz": -7.9 - 0.6}, "Fz = -8.50 N, over the guard's 8 N"),
        ({"tx": -51.0}, "Tx = -51.00 N mm, over the guard's 50 N mm"),
        ({"fx": 0.1, "saturated": True}, "the force sensor is saturated"),
    ],
)
def test_force_over_any_limit_stops_stage(
    bench: Bench, values: dict[str, float], why: str | None
) -> None:
    bench.stage.start_move((0.0, 0.0, -10.0), 600)
    bench.watched(0.3, fz=-1.0)
    assert not bench.guard.tripped
    record_ns = bench.clock.now_ns()
    bench.guard.watch(bench.samples(**values))  # type: ignore[arg-type]
    if why is None:
        assert bench.guard.trip is None
        return
    assert bench.guard.tripped == why
    trip = bench.guard.trip
    assert trip is not None
    assert trip.record_ns == record_ns
    assert trip.byte_ns == record_ns
    z_mm = bench.controller.position_mm()[2]
    bench.clock.sleep_s(1.0)
    assert z_mm - bench.controller.position_mm()[2] < 0.6  # braking from 10 mm/s takes 0.5 mm
    bench.stage.stop()
    assert bench.controller.state == "Idle"


def test_resultant_force_has_own_limit(bench: Bench) -> None:
    bench.guard = ForceGuard(
        bench.stage.cancel, GuardLimits((4.0, 4.0, 8.0), resultant_n=8.5), bench.clock
    )
    bench.guard.watch(bench.samples(fx=3.9, fz=-7.9))
    assert bench.guard.tripped == "resultant force 8.81 N, over the guard's 8.5 N"


@pytest.mark.parametrize(("late", "ends"), [(True, "Hold"), (False, "Idle")])
def test_unheard_stop_becomes_feed_hold(bench: Bench, late: bool, ends: str) -> None:
    """A jog that was begun as Run hears no 0x85; its force grows on."""
    bench.guard.hold = bench.stage.hold
    bench.stage.start_move((0.0, 0.0, -10.0), 600)
    bench.stage.listen(0.4)
    if late:
        bench.controller.fault("late jog")
        while bench.controller.state != "Run":
            bench.stage.listen(0.005)
    for k in range(30):
        bench.clock.sleep_s(0.002)
        bench.guard.watch(bench.samples(fz=-8.1 - 0.1 * (k if late else min(k, 5))))
    bench.clock.sleep_s(0.2)
    assert bench.controller.state == ends


def test_byte_before_its_jog_is_repeated(bench: Bench) -> None:
    """GRBL drops 0x85 while it still reads the line; a spike must not be stopped by luck."""
    bench.stage.start_move((0.0, 0.0, 4.9), 900)
    bench.stage.wait()
    bench.guard.watch(bench.samples(fz=-9.0))  # nothing moves: the byte does nothing
    bench.stage.start_move((0.0, 0.0, -10.0), 600)
    bench.watched(0.09, fz=-1.0)
    bench.clock.sleep_s(0.5)
    assert bench.controller.state == "Idle"
    assert bench.controller.position_mm()[2] + 20.0 > 4.0


def test_only_rearm_clears_a_trip(bench: Bench) -> None:
    bench.guard.watch(bench.samples(fz=-9.0))
    bench.watched(0.5, fz=0.0)
    assert bench.guard.tripped
    bench.guard.rearm()
    assert not bench.guard.tripped
    bench.stage.start_move((0.0, 0.0, 4.0), 900)
    bench.watched(0.2, fz=-1.0)
    bench.stage.wait()
    bench.guard.watch(bench.samples(fz=-8.3))
    assert bench.guard.tripped == "Fz = -8.30 N, over the guard's 8 N"


def test_lift_continues_unless_force_grows(bench: Bench) -> None:
    bench.guard.watch(bench.samples(fz=-9.0))
    with bench.guard.easing():
        bench.stage.start_move((0.0, 0.0, 10.0), 600)
        bench.watched(0.2, fz=-9.0)
        bench.watched(0.1, saturated=True)
        bench.guard.on_sensor_lost("the force sensor is silent")
        bench.stage.wait()
        assert bench.stage.position_mm()[2] == pytest.approx(10.0)
        bench.stage.start_move((0.0, 0.0, 15.0), 600)
        bench.watched(0.1, fz=-9.0 * 1.3)
        bench.clock.sleep_s(0.5)
        bench.stage.stop()
        assert bench.stage.position_mm()[2] < 13.0


@pytest.mark.parametrize(
    ("values", "goes_on"),
    [
        ({"fz": -9.0 * 1.2}, True),  # over the limit and over what tripped it
        ({"fz": -9.0 * 1.3}, False),
        ({"fx": 3.9, "fz": -9.0}, True),
        ({"fx": 4.1}, False),
        ({"tx": 51.0}, False),
    ],
)
def test_lift_margin_only_on_tripped_axis(
    bench: Bench, values: dict[str, float], goes_on: bool
) -> None:
    bench.guard.watch(bench.samples(fz=-9.0))
    with bench.guard.easing():
        bench.stage.start_move((0.0, 0.0, 10.0), 600)
        bench.watched(0.1, **values)
        bench.clock.sleep_s(1.0)
    assert (bench.controller.position_mm()[2] + 20.0 > 9.9) == goes_on


def test_lift_restores_guard_limits(bench: Bench) -> None:
    bench.guard.watch(bench.samples(fz=-20.0))
    with bench.guard.easing():
        bench.watched(0.01, fz=-20.0)
    bench.guard.rearm()
    bench.guard.watch(bench.samples(fz=-8.3))
    assert bench.guard.tripped == "Fz = -8.30 N, over the guard's 8 N"
    with bench.guard.easing():
        bench.stage.start_move((0.0, 0.0, 10.0), 600)
        bench.watched(0.1, fz=-12.0)
        bench.clock.sleep_s(1.0)
    assert bench.controller.position_mm()[2] + 20.0 < 9.0


def test_lost_sensor_and_homing_are_stopped(bench: Bench) -> None:
    bench.stage.start_move((0.0, 0.0, -10.0), 600)
    bench.clock.sleep_s(0.3)
    bench.guard.on_sensor_lost("force sensor: no sample within 50 ms")
    bench.clock.sleep_s(0.5)
    assert bench.controller.state == "Idle"
    assert bench.guard.tripped == "force sensor: no sample within 50 ms"
    trip = bench.guard.trip
    assert trip is not None
    assert trip.record_ns is None


def test_blind_guard_stops_short_delay_noted(bench: Bench) -> None:
    bench.stage.start_move((0.0, 0.0, -10.0), 600)
    bench.watched(0.2, old_s=0.09)
    assert not bench.guard.tally.total
    bench.watched(0.08, old_s=0.15)
    bench.watched(0.1)
    assert not bench.guard.tripped
    (note,) = bench.guard.tally.pop_notes(bench.clock.now_ns())
    assert note.id == "behind"
    assert note.text.startswith("guard behind the force stream 40 times")
    bench.watched(0.08, old_s=0.3)
    assert not bench.guard.tripped
    bench.watched(0.05, old_s=0.3)
    assert bench.guard.tripped.startswith("force sensor: the host is 300 ms behind its stream; ")
    bench.clock.sleep_s(0.5)
    assert bench.controller.state == "Idle"


def test_limits_from_rig_file_or_range() -> None:
    force = ForceConfig()
    limits = GuardLimits((20.0, 20.0, 28.0), (200.0, 200.0, 200.0))
    assert GuardLimits.from_config(None, force) == limits
    own = GuardConfig(force_n=5.0, resultant_n=6.0, torque_nmm=100.0)
    assert GuardLimits.from_config(own, force) == GuardLimits((5.0,) * 3, (100.0,) * 3, 6.0)
    each = GuardLimits.from_config(GuardConfig(axes_n=(1.0, 2.0, 3.0)), force)
    assert each == GuardLimits((1.0, 2.0, 3.0), (200.0, 200.0, 200.0), inf)
    with pytest.raises(InputError, match=r"guard: the limit 30 of Fx is over .* range of 25"):
        GuardLimits.from_config(GuardConfig(force_n=30.0), force)
    with pytest.raises(ValueError, match="give either force_n"):
        GuardConfig(force_n=1.0, axes_n=(1.0, 1.0, 1.0))
