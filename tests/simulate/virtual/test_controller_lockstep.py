"""The real host on the simulated controller: real drivers, virtual time, no threads."""

from __future__ import annotations

import math
from typing import Any

import hosted
import pytest
import serial

from deltact_fab.bench.rig.stage.grbl import GrblStage
from deltact_fab.common.errors import InputError, StageError
from deltact_fab.sensor.optics.camera import StageFrame

BYTE_NS = 10 * 10**9 / 115200


def bench_of(**options: Any) -> hosted.Bench:
    return hosted.Bench(angle_deg=90.0, **options)


def test_connect_home_move_in_sensor_coordinates() -> None:
    bench = bench_of().homed()
    stage, clock = bench.stage, bench.clock
    assert bench.sent() == [b"$I\n", b"$$\n", b"$H\n"]
    planned = stage.start_move((3.0, -2.0, 5.0), 600.0)
    begin = clock.now_s()
    state = stage.wait()
    assert bench.sent()[-1] == b"$J=G90G21G53X-58.0000Y-47.0000Z-35.0000F600.000\n"
    assert state.state == "Idle"
    assert state.machine_mm == (-58.0, -47.0, -35.0)
    assert planned <= clock.now_s() - begin <= planned + 0.03
    assert stage.position_mm() == pytest.approx((3.0, -2.0, 5.0), abs=1e-12)
    assert bench.grbl.position_mm() == pytest.approx((-58.0, -47.0, -35.0), abs=1e-12)
    who = stage.identity()
    assert who["banner"] == "Grbl 1.1h ['$' for help]"
    assert who["info"] == ["[VER:1.1h.20190830:]", "[OPT:V,15,128]"]
    assert who["settings"]["$130"] == 120.0
    stage.close()


@pytest.mark.parametrize("delta", [0.00125, 2.0, 40.0])
def test_planned_time_is_the_controller_s(delta: float) -> None:
    bench = bench_of().homed()
    bench.stage.start_move((0.0, 0.0, 0.0), 900.0)
    bench.stage.wait()
    planned = bench.stage.start_move((delta, 0.0, delta / 4), 900.0)
    bench.stage.wait()
    last = bench.grbl.segments[-1]
    first = next(s for s in bench.grbl.segments if s.block == last.block)
    assert planned == pytest.approx((last.end_ns - first.start_ns) / 1e9, abs=1e-3)


def test_waiting_host_sees_guard_cancel() -> None:
    bench = bench_of().homed()
    stage = bench.stage
    stage.start_move((0.0, 0.0, 5.0), 900.0)
    bench.clock.sleep_s(0.5)
    stage.cancel()
    with pytest.raises(StageError, match=r"stopped at .* short of \(-60.000, -50.000, -35.000\)"):
        stage.wait()
    stage.start_move((0.0, 0.0, 5.0), 900.0)  # nothing is lost
    stage.wait()


def test_interrupt_leaves_no_stale_ok() -> None:
    bench = bench_of().homed()
    stage = bench.stage
    original = bench.link.read

    def interrupted(*args: object) -> bytes:
        bench.link.read = original  # type: ignore[method-assign]
        raise KeyboardInterrupt

    bench.link.read = interrupted  # type: ignore[method-assign,assignment]
    with pytest.raises(KeyboardInterrupt):
        stage.start_move((0.0, 0.0, 5.0), 900.0)
    stage.stop()
    stage.start_move((1.0, 0.0, 5.0), 900.0)
    assert stage.wait().machine_mm == (-60.0, -49.0, -35.0)


def test_interrupted_homing_is_reset() -> None:
    bench = bench_of()
    stage = bench.stage
    stage.connect()
    original = bench.clock.advance_to_ns

    def interrupted(t_ns: int) -> None:
        original(t_ns)
        if bench.grbl.state == "Home" and bench.clock.now_s() > 4:
            bench.clock.advance_to_ns = original  # type: ignore[method-assign]
            raise KeyboardInterrupt

    bench.clock.advance_to_ns = interrupted  # type: ignore[method-assign]
    with pytest.raises(KeyboardInterrupt):
        stage.home()
    stage.stop()
    assert bench.sent()[-1] == b"\x18"
    with pytest.raises(StageError, match="the controller was reset: home again"):
        stage.start_move((0.0, 0.0, 5.0), 900.0)
    stage.home()
    assert bench.grbl.position_mm() == (-1.0, -1.0, -1.0)


@pytest.mark.parametrize(
    ("target", "feed", "said"),
    [
        ((0.0, 0.0, 40.5), 600.0, r"target Z 0.500 mm \(machine\) is outside of -60 .. -1"),
        ((0.0, math.nan, 0.0), 600.0, "is not finite"),
        ((0.0, 0.0, 5.0), -5.0, "feed -5.0 mm/min"),
        ((0.0, 0.0, 5.0), 3000.0, r"feed 3000 mm/min moves X at 2\d+\.?\d*; its limit is 1500"),
    ],
)
def test_bad_moves_are_refused_unsent(
    target: tuple[float, float, float], feed: float, said: str
) -> None:
    bench = bench_of().homed()
    before = len(bench.trace), bench.clock.now_s()
    with pytest.raises(InputError, match=said):
        bench.stage.start_move(target, feed)
    assert (len(bench.trace), bench.clock.now_s()) == before


def test_one_move_at_a_time() -> None:
    bench = bench_of().homed()
    bench.stage.start_move((0.0, 0.0, 5.0), 600.0)
    with pytest.raises(StageError, match=r"a move is in progress.*: stop sent"):
        bench.stage.start_move((0.0, 0.0, 6.0), 600.0)
    bench.stage.start_move((0.0, 0.0, 6.0), 600.0)
    assert bench.stage.wait().machine_mm == (-60.0, -50.0, -34.0)


def test_connecting_stops_a_moving_stage() -> None:
    """A host that was killed left it so: nobody watches that motion."""
    for line, last in ((b"$J=X-50F100\n", b"\x85"), (b"$H\n", b"\x18")):
        bench = bench_of(resets_on_open=False).homed(3.0)
        assert b"\x18" not in b"".join(bench.sent())  # nor was it reset before
        bench.stage.close()
        bench.grbl.write(line)
        bench.clock.sleep_s(1)
        bench.stage.connect()
        assert bench.sent()[-3] == last
        before = bench.grbl.position_mm()
        bench.clock.sleep_s(5)
        assert bench.grbl.position_mm() == before
        bench.stage.home()


def test_nobody_there() -> None:
    bench = bench_of()
    bench.grbl.fault("silence")
    with pytest.raises(StageError, match=r"no banner within 2.5 s and no answer to '\?' at 115200"):
        bench.stage.connect()
    with pytest.raises(InputError, match="not a serial port: invalid URL"):
        GrblStage("nonsense://x", bench.clock, StageFrame((0, 0, 0))).connect()


def test_restart_mid_move_requires_homing() -> None:
    bench = bench_of().homed()
    stage = bench.stage
    stage.start_move((0.0, 0.0, 5.0), 600.0)
    bench.grbl.fault("reboot", at_s=bench.clock.now_s() + 2.0)
    with pytest.raises(StageError, match=r"the controller restarted \(Grbl 1.1h\)"):
        stage.wait()
    sent = len(bench.sent())
    for attempt in (lambda: stage.start_move((0.0, 0.0, 5.0), 600.0), stage.position_mm):
        with pytest.raises(StageError, match=r"no motion after a fault .*restarted"):
            attempt()
    assert len(bench.sent()) == sent
    assert b"$X\n" not in bench.sent()
    stage.home()
    stage.start_move((0.0, 0.0, 5.0), 600.0)
    assert stage.wait().machine_mm == (-60.0, -50.0, -35.0)
    assert bench.grbl.position_mm() == pytest.approx((-60.0, -50.0, -35.0), abs=1e-12)


def test_restart_between_moves_is_noticed() -> None:
    bench = bench_of().homed()
    bench.grbl.fault("reboot")
    bench.clock.sleep_s(5)
    with pytest.raises(StageError, match="restarted"):
        bench.stage.start_move((0.0, 0.0, 5.0), 600.0)
    assert bench.sent()[-1] == b"$H\n"  # the jog was not sent


def test_overlong_move_times_out() -> None:
    bench = bench_of().homed()
    bench.grbl.settings[110] = bench.grbl.settings[111] = 60.0  # slower than it said
    bench.stage.whole_moves = True
    planned = bench.stage.start_move((0.0, 0.0, 5.0), 900.0)
    begin = bench.clock.now_s()
    with pytest.raises(StageError, match=r"still Jog at .* planned to take"):
        bench.stage.wait()
    assert bench.clock.now_s() - begin == pytest.approx(planned * 1.1 + 2, abs=0.2)
    bench.stage.stop()
    assert bench.grbl.state == "Idle"


def script(bench: hosted.Bench) -> list[tuple[float, ...]]:
    stage, clock = bench.homed().stage, bench.clock
    seen = []
    for target, feed in (((0.0, 0.0, 5.0), 900.0), ((0.3, 0.1, -0.7), 61.7), ((4.0, 0, 5), 777.7)):
        stage.start_move(target, feed)
        clock.sleep_s(0.0137)
        seen.append(bench.grbl.position_mm())
        stage.position_mm()
        seen.append(bench.grbl.position_mm())
        stage.wait()
        seen.append(bench.grbl.position_mm())
    stage.start_move((0.0, 5.0, 5.0), 300.0)
    clock.sleep_s(0.5)
    stage.stop()
    seen.append(stage.position_mm())
    return seen


def relative(bench: hosted.Bench) -> list[tuple[int, str, bytes]]:
    start_ns = round(bench.start_s * 1e9)
    return [(t - start_ns, who, data) for t, who, data in bench.trace]


@pytest.mark.parametrize("start_s", [0.0, 12345.678901234])
def test_same_script_gives_same_bytes(start_s: float) -> None:
    a, b = bench_of(), bench_of(start_s=start_s)
    assert script(a) == script(b)
    assert relative(a) == relative(b)
    assert len(a.trace) > 100


def test_time_advances_by_bytes_and_sleeps() -> None:
    bench = bench_of(resets_on_open=False)
    bench.clock.sleep_s(2)
    bench.grbl.read_available()
    port = bench.link.open_link(0.25)
    t0 = bench.clock.now_ns()
    port.write(b"$I\n")
    t1 = bench.clock.now_ns()
    assert t1 - t0 == int(3 * BYTE_NS)
    line = port.read_until(b"\n") + port.read_until(b"\n")
    assert line.endswith(b"]\r\n")
    assert bench.clock.now_ns() - t1 == pytest.approx(len(line) * BYTE_NS, abs=2)
    # What arrived while the host slept is read in no time, byte by byte or not.
    bench.clock.sleep_s(0.1)
    t2 = bench.clock.now_ns()
    assert port.in_waiting == 4
    assert port.read(1) + port.read(10)[:0] == b"o"
    assert bench.clock.now_ns() == t2 + 250_000_000  # read(10) had only 3 to read
    # Nothing comes: the time-out passes, no more and no less.
    t3 = bench.clock.now_ns()
    assert port.read(1) == b""
    assert bench.clock.now_ns() - t3 == 250_000_000
    for _ in range(1000):
        assert port.in_waiting == 0
        assert bench.grbl.state == "Alarm"
    assert bench.clock.now_ns() - t3 == 250_000_000


def test_read_ends_on_controller_output() -> None:
    bench = bench_of()
    port = bench.link.open_link(10)
    t0 = bench.clock.now_ns()
    assert port.read_until(b"\n") == b"\r\n"
    assert bench.clock.now_ns() - t0 == 1_000_000_000 + int(2 * BYTE_NS)  # boot_s and two bytes
    port.timeout = 0.0003  # three bytes' time: 3.4 bytes
    assert port.read(100) == b"Grb"
    port.timeout = None
    assert port.read_until(b"\n") == b"l 1.1h ['$' for help]\r\n"
    unlock = b"[MSG:'$H'|'$X' to unlock]\r\n"
    assert port.read(len(unlock)) == unlock
    with pytest.raises(serial.SerialException, match="nothing will ever come"):
        port.read(1)
