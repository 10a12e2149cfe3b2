"""A fault in mid-move stops the carriage before it is told, and one homing mends it.

The real host on the simulated controller; what is asserted is where the carriage comes to rest.
"""

from __future__ import annotations

import math

import hosted
import pytest
from hosted import FEED_MM_MIN, MACHINE_MM, TARGET_MM

from deltact_fab.bench.rig.run.contact import end_contact
from deltact_fab.bench.rig.stage.grbl import GrblStage
from deltact_fab.common.errors import StageError
from deltact_fab.sensor.optics.camera import StageFrame
from deltact_fab.simulate.virtual.fault_bench import NoisyController


class Bench(hosted.Bench):
    def __init__(self, *, resets_on_open: bool = True) -> None:
        super().__init__(resets_on_open=resets_on_open, controller=NoisyController)
        self.homed(2.0)

    def insert(self, text: bytes, in_s: float = 0.0) -> None:
        """The host hears these words, which the controller never said."""
        self.grbl.inject(text, self.clock.now_s() + in_s)

    def replace(self, begins: bytes, words: bytes) -> None:
        """Every line that begins so arrives as other words."""
        self.grbl.clear_line_faults()
        self.grbl.alter_lines(lambda line: words, begins)

    def drop(self, unwanted: bytes) -> None:
        """Every line that begins so is lost."""
        self.grbl.clear_line_faults()
        self.grbl.lose(unwanted)

    def came_to_rest(self) -> float:
        """How far from where the fault was the carriage ends up, mm; it must be short of the end.

        The wires work again from here on.
        """
        before = self.grbl.position_mm()
        self.grbl.clear_line_faults()
        self.clock.sleep_s(30)
        after = self.grbl.position_mm()
        assert math.dist(after, MACHINE_MM) > 40
        return math.dist(before, after)

    def there(self, z_mm: float = TARGET_MM[2]) -> Bench:
        """At a height above the centre of the face."""
        self.stage.start_move((*TARGET_MM[:2], z_mm), FEED_MM_MIN)
        z_mm += MACHINE_MM[2] - TARGET_MM[2]
        assert self.stage.wait().machine_mm == (*MACHINE_MM[:2], z_mm)
        return self

    def homes_at_once(self) -> None:
        self.stage.home()
        assert self.grbl.position_mm() == (-1.0, -1.0, -1.0)
        self.there()


COAST_MM = 10**2 / (2 * 50) * 1.3  # v^2/2a along the line, where the axes together brake harder


GREETING = b"\r\nGrbl 1.1h ['$' for help]\r\n"


def test_a_dropped_ok() -> None:
    bench = Bench()
    bench.drop(b"ok")
    with pytest.raises(StageError, match=r"no answer to \$J=.*: stop sent"):
        bench.stage.start_move(TARGET_MM, FEED_MM_MIN)
    assert bench.came_to_rest() < COAST_MM
    bench.homes_at_once()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (GREETING, "the controller restarted"),
        (b"ALARM:1\r\n", "ALARM:1 "),
        (b"ALARM:3\r\n", "ALARM:3 "),
        (b"<Alarm|MPos:0.000,0.000,0.000|FS:0,0>\r\n", "the controller is in Alarm"),
        (b"<Hold:0|MPos:0.000,0.000,0.000|FS:0,0>\r\n", r"Hold:0 \(feed hold\) during a move"),
        (b"<Run|MPos:0.000,0.000,0.000|FS:0,0>\r\n", "Run during a move"),
        (b"<Idle|WPos:0.000,0.000,0.000|FS:0,0>\r\n", "status reports give the work position"),
    ],
)
def test_words_that_the_controller_never_said(words: bytes, said: str) -> None:
    bench = Bench().moving()
    if words.startswith(b"<"):
        bench.replace(b"<", words)
    else:
        bench.insert(words)
    with pytest.raises(StageError, match=f"{said}.*: stop sent"):
        bench.stage.wait()
    assert bench.came_to_rest() < COAST_MM
    bench.homes_at_once()


def test_silence() -> None:
    bench = Bench().moving()
    bench.drop(b"")
    silent_mm = bench.grbl.position_mm()
    with pytest.raises(StageError, match=r"no answer to '\?' within 1 s; .*: stop sent"):
        bench.stage.wait()
    assert bench.came_to_rest() == 0  # a second and the braking after the silence began
    assert math.dist(silent_mm, bench.grbl.position_mm()) < 1.2 * FEED_MM_MIN / 60 + COAST_MM
    bench.homes_at_once()


@pytest.mark.parametrize("resets_on_open", [True, False])
def test_cable_reconnected_within_a_second(resets_on_open: bool) -> None:
    bench = Bench(resets_on_open=resets_on_open).moving()
    bench.link.unplug(for_s=0.5)
    with pytest.raises(StageError, match=r"the link is lost .*: stop sent"):
        bench.stage.wait()
    assert bench.came_to_rest() < COAST_MM
    with pytest.raises(StageError, match=r"no motion after a fault .*the link is lost"):
        bench.stage.start_move(TARGET_MM, FEED_MM_MIN)
    bench.stage.connect()
    bench.homes_at_once()


def test_unplugged_cable_finishes_buffered_motion() -> None:
    bench = Bench().moving()
    from_mm = bench.grbl.position_mm()
    bench.link.unplug()
    begin = bench.clock.now_s()
    with pytest.raises(StageError, match=r"the link is lost .*; the move to .* continues"):
        bench.stage.wait()
    assert bench.clock.now_s() - begin < 2
    bench.clock.sleep_s(30)
    gone_mm = math.dist(bench.grbl.position_mm(), from_mm)
    assert 0 < gone_mm < 0.6 * 10
    bench.link.plug()
    bench.stage.connect()
    bench.homes_at_once()


def test_first_fault_reason_is_kept() -> None:
    bench = Bench().moving()
    bench.grbl.fault("limit")
    with pytest.raises(StageError, match="ALARM:1"):
        bench.stage.wait()
    bench.drop(b"")
    with pytest.raises(StageError, match=r"no banner after a reset \(0x18\)"):
        bench.stage.home()
    with pytest.raises(StageError, match=r"no motion after a fault \(ALARM:1"):
        bench.stage.start_move(TARGET_MM, FEED_MM_MIN)


def test_port_closed_mid_move() -> None:
    bench = Bench().moving()
    bench.stage.close()
    assert bench.came_to_rest() < COAST_MM


@pytest.mark.parametrize("wait_s", [0.0, 2.0])
@pytest.mark.parametrize("when", ["moving", "resting"])
def test_hard_limit_needs_one_homing(wait_s: float, when: str) -> None:
    bench = Bench()
    if when == "moving":
        bench.moving()
    bench.grbl.fault("limit")
    with pytest.raises(StageError, match=r"ALARM:1 \(hard limit.*\); home again"):
        bench.stage.wait()
    bench.clock.sleep_s(wait_s)
    for ask in (bench.stage.timed_position, bench.stage.position_mm, bench.stage.stop):
        with pytest.raises(StageError, match=r"ALARM:1 \(hard limit"):
            ask()
    bench.homes_at_once()


@pytest.mark.parametrize("wait_s", [0.0, 0.6])
def test_reset_in_motion_needs_one_homing(wait_s: float) -> None:
    bench = Bench().moving()
    bench.stage.abort()
    with pytest.raises(StageError, match="the controller was reset: home again"):
        bench.stage.wait()
    bench.clock.sleep_s(wait_s)
    bench.homes_at_once()


@pytest.mark.parametrize("asleep", [False, True])
def test_unresponsive_board_connects_after_reset(asleep: bool) -> None:
    bench = Bench(resets_on_open=False)
    if asleep:
        bench.grbl.write(b"$SLP\n")
    else:
        bench.grbl.fault("limit")
        bench.clock.sleep_s(1)
    other = GrblStage(bench.link, bench.clock, StageFrame((-60.0, -50.0, -40.0)))
    other.connect()
    assert other.identity()["banner"].startswith("Grbl 1.1h")
    other.home()
    assert bench.grbl.position_mm() == (-1.0, -1.0, -1.0)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (b"ALARM:9\r\n", r"ALARM:9 \(homing: no switch found\); .*homing: stop sent"),
        (b"error:5\r\n", r"was refused: error:5 \(homing is off"),
        (GREETING, "restarted .*homing: stop sent"),
    ],
)
def test_failed_homing_is_reset(words: bytes, said: str) -> None:
    bench = Bench()
    bench.there().insert(words, 0.3)
    with pytest.raises(StageError, match=said):
        bench.stage.home()
    assert bench.sent()[-1] == b"\x18"
    begin_mm = bench.grbl.position_mm()
    bench.clock.sleep_s(30)
    assert math.dist(begin_mm, bench.grbl.position_mm()) < 2
    assert bench.grbl.position_mm()[2] < -10  # Z was on its way to its switch
    bench.homes_at_once()


def test_refused_settings_block_homing() -> None:
    bench = Bench()
    bench.grbl.settings[20] = 0
    with pytest.raises(StageError, match=r"\$20=0 \(soft limits are off\)"):
        bench.stage.connect()
    before = len(bench.trace)
    with pytest.raises(StageError, match="its settings were refused"):
        bench.stage.home()
    assert len(bench.trace) == before
    bench.stage.stop()  # this it can always be asked for
    assert bench.sent()[-1] == b"\x85"


def lifted_mm(bench: Bench) -> float | None:
    """Height above the face after a lift to 5 mm at least; None without one."""
    with bench.stage.recovery() as at_mm:
        if at_mm is None or bench.stage.lift(5.0 - at_mm[2], 300.0) is None:
            return None
    return bench.grbl.position_mm()[2] - MACHINE_MM[2] + TARGET_MM[2]


@pytest.mark.parametrize(
    "fault", ["lost ok", "false banner", "false alarm", "silence that ends", "cable back"]
)
def test_tip_lifts_if_position_is_kept(fault: str) -> None:
    bench = Bench(resets_on_open="cable" not in fault).there(1.0)
    if fault == "lost ok":
        bench.drop(b"ok")
    else:
        bench.stage.start_move((0.0, 0.0, -2.0), 60.0)
        bench.clock.sleep_s(1.5)
    if fault == "silence that ends":
        bench.drop(b"")
    elif "cable" in fault:
        bench.link.unplug(for_s=4.0)
    elif fault != "lost ok":
        bench.insert(b"ALARM:1\r\n" if "alarm" in fault else GREETING)
    with pytest.raises(StageError, match=" continues" if "cable" in fault else ": stop sent"):
        bench.stage.start_move((0.0, 0.0, -2.0), 60.0) if "ok" in fault else bench.stage.wait()
    assert bench.grbl.position_mm()[2] > MACHINE_MM[2] - 6.7  # short of the end, at 7
    bench.grbl.clear_line_faults()
    assert lifted_mm(bench) == pytest.approx(5.0, abs=0.002)
    with pytest.raises(StageError, match="no motion after a fault"):
        bench.stage.start_move(TARGET_MM, FEED_MM_MIN)
    bench.stage.home()


def in_the_gel(bench: Bench) -> Bench:
    """In a slow press, 1.5 s after its start."""
    bench.there(0.0).stage.start_move((0.0, 0.0, -3.0), 60.0)
    bench.stage.listen(1.5)
    return bench


def test_late_jog_is_waited_for() -> None:
    bench = in_the_gel(Bench())
    waits = bench.stage.identity()["waits"]
    bench.grbl.fault("late jog")
    bench.stage.wait()
    assert bench.stage.position_mm()[2] == pytest.approx(-3.0, abs=0.002)
    assert bench.stage.identity()["waits"] > waits
    assert b"error:8" in b"".join(data for _, who, data in bench.trace if who != "host")


@pytest.mark.parametrize("state", ["Jog", "Run"])
def test_stop_ends_every_state(state: str) -> None:
    bench = in_the_gel(Bench())
    if state == "Run":
        bench.grbl.fault("late jog")
        while bench.grbl.state != "Run":
            bench.stage.listen(0.005)
    at_mm = bench.grbl.position_mm()[2]
    bench.stage.cancel()
    felt = iter((4.0, 0.01))
    outcome = end_contact(bench.stage, lambda: next(felt))
    assert outcome == "the tip was lifted by 3.00 mm, force 0.01 N"
    lowest_mm = min(segment.end_mm[2] for segment in bench.grbl.segments)
    assert lowest_mm > at_mm - 0.25
    assert bench.stage.homed, "the count is kept"


@pytest.mark.parametrize("fault", ["reboot", "limit", "cable", "silence"])
def test_no_lift_if_position_uncertain(fault: str) -> None:
    bench = Bench().moving()
    if fault == "cable":
        bench.link.unplug()
    elif fault == "silence":
        bench.drop(b"")
    else:
        bench.grbl.fault(fault)  # type: ignore[arg-type]
    with pytest.raises(StageError):
        bench.stage.wait()
    bench.clock.sleep_s(30)
    before_s, before_mm = bench.clock.now_s(), bench.grbl.position_mm()
    assert lifted_mm(bench) is None
    assert bench.grbl.position_mm() == before_mm
    assert bench.clock.now_s() - before_s < 12


def test_second_homing_trips_no_switch() -> None:
    bench = Bench()
    for _ in range(5):
        assert bench.stage.lift(25.0, 300.0) is not None
        bench.stage.home()
    assert bench.grbl.position_mm() == (-1.0, -1.0, -1.0)
    assert bench.there().stage.lift(100.0, 300.0) == pytest.approx(34.0)
    assert bench.grbl.position_mm()[2] == -1.0
