"""The simulated controller answers as GRBL 1.1 does."""

from __future__ import annotations

import math

import pytest

from deltact_fab.simulate.virtual.clock import VirtualClock
from deltact_fab.simulate.virtual.controller import GrblController
from deltact_fab.simulate.virtual.grbl_lines import grbl_settings

LOCK = "[MSG:'$H'|'$X' to unlock]"
BANNER = ["", "Grbl 1.1h ['$' for help]"]


class Bench:
    """A controller and the clock, talked to without a wire."""

    def __init__(self, settings: dict[int, float] | None = None, **options: object) -> None:
        self.clock = VirtualClock()
        self.grbl = GrblController(settings, self.clock, **options)  # type: ignore[arg-type]
        self.clock.sleep_s(1.0)

    def heard(self) -> list[str]:
        text = self.grbl.read_available().decode()
        assert text == "" or text.endswith("\r\n")
        return text.split("\r\n")[:-1]

    def say(self, data: str | bytes, wait_s: float = 0.0) -> list[str]:
        self.grbl.write(data.encode() if isinstance(data, str) else data)
        self.clock.sleep_s(wait_s)
        return self.heard()

    def homed(self) -> Bench:
        self.heard()
        assert self.say("$H\n", 60) == ["ok"]
        return self

    def mpos(self) -> tuple[float, ...]:
        (line,) = self.say("?")
        return tuple(float(p) for p in line.split("MPos:")[1].split("|")[0].split(","))


def test_homing_ends_at_the_pull_off() -> None:
    bench = Bench(start_mm=(-20, -25, -10))
    bench.heard()
    assert bench.say("$H\n?", 1) == []  # no status is given while homing
    assert bench.grbl.state == "Home"
    lines = bench.say("", 60)
    assert lines[0] == "ok"
    assert lines[1].startswith("<Idle|MPos:-1.000,-1.000,-1.000|")
    assert bench.grbl.position_mm() == (-1.0, -1.0, -1.0)
    # Z first and alone; then X and Y, each at the seek rate: 10/600, 25/600 min and the rest.
    (z, *_), last = bench.grbl.segments, bench.grbl.segments[-1]
    assert z.end_mm == (-20, -25, 0)
    assert z.end_ns - z.start_ns == math.ceil((10 / 10 + 10 / 50) * 1e9)
    assert 4.5 < last.end_ns / 1e9 < 10


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("G1X-2F600", 20), ("$J=12", 1), ("$J=X", 2), ("$J1", 3), ("$J=X-2F-5", 4),
        ("$J=X-1000F100", 15), ("$J=Z-61F100", 15), ("$J=A1F100", 20), ("$J=G20X-2F9", 16),
        ("$J=G90G91X-2F9", 21), ("$J=X-2X-3F10", 25), ("$J=X-2F10S1", 36),
    ],
)  # fmt: skip
def test_errors_have_the_firmware_s_codes(line: str, code: int) -> None:
    bench = Bench().homed()
    assert bench.say(line + "\n", 1) == [f"error:{code}"]
    assert bench.grbl.position_mm() == (-1.0, -1.0, -1.0)


@pytest.mark.parametrize("length", [80, 128, 1000])
def test_line_of_any_length_answered_once(length: int) -> None:
    bench = Bench().homed()
    assert bench.say("G21" * (length // 3 + 1) + "\n") == ["error:11"]
    assert bench.say("\n") == ["ok"]


def test_the_lock_refuses_motion_until_unlocked() -> None:
    bench = Bench()
    bench.heard()
    info = ["[VER:1.1h.20190830:]", "[OPT:V,15,128]", "ok"]
    assert bench.say("G1X-1F10\n$J=X-1F10\n$I\n") == ["error:9", "error:8", *info]
    assert bench.say("$X\n") == ["[MSG:Caution: Unlocked]", "ok"]
    assert bench.say("$J=G91X-1F100\n") == ["ok"]


def test_jog_blocks_g_code_and_settings() -> None:
    bench = Bench().homed()
    assert bench.say("$J=X-50F600\n", 0.5) == ["ok"]
    assert bench.say("G4P0.1\n$H\n$110=1\n") == ["error:9", "error:8", "error:8"]
    assert bench.say("$J=X-50Y-9F600\n") == ["ok"]  # a second jog queues
    assert "Bf:13,128" in bench.say("?")[0]


def test_jogs_reach_targets_in_all_dialects() -> None:
    bench = Bench().homed()
    for line, there_mm in (
        ("$J=G90G21X-5F600\n", (-5.0, -1.0, -1.0)),
        ("$J=G91Y-25.4F600\n", (-5.0, -26.4, -1.0)),
        ("$J=G90G21G53X-2Y-2Z-2F600\n", (-2.0, -2.0, -2.0)),
    ):
        bench.say(line, 30)
        assert bench.mpos() == there_mm


def test_jog_cancel_decelerates_and_keeps_position() -> None:
    bench = Bench().homed()
    bench.say("$J=X-50F600\n", 1)
    before = bench.grbl.position_mm()[0]
    assert bench.say(b"\x85") == []
    assert bench.say("?")[0].startswith("<Jog|")
    bench.clock.sleep_s(0.2)  # 10 mm/s at 50 mm/s2
    after = bench.grbl.position_mm()[0]
    assert before - after == pytest.approx(10**2 / (2 * 50), abs=1e-9)
    assert bench.grbl.state == "Idle"
    assert bench.mpos()[0] == pytest.approx(after, abs=0.5 / 800 + 0.0005)
    assert bench.say("$J=X-20F600\n", 20) == ["ok"]
    assert bench.grbl.position_mm()[0] == pytest.approx(-20, abs=1e-12)


def test_reset_while_moving_loses_the_position() -> None:
    bench = Bench().homed()
    bench.say("$J=X-50F600\n", 1)
    assert bench.say(b"\x18") == ["ALARM:3"]
    assert bench.say(b"?\x18", 0.49) == []  # deaf until its message is out
    assert bench.say("", 0.02) == [*BANNER, LOCK]
    bench.clock.sleep_s(1)
    assert bench.say("?")[0].startswith("<Alarm|")
    bench.say("$X\n")
    lost = bench.mpos()[0] - bench.grbl.position_mm()[0]
    assert lost == pytest.approx(1.0, abs=0.002)  # it coasted v^2/2a further than it knows
    bench.say("$J=X-60F600\n", 20)
    assert bench.mpos()[0] == -60.0
    assert bench.grbl.position_mm()[0] == pytest.approx(-61, abs=0.002)
    bench.say("$H\n", 60)
    assert bench.grbl.position_mm() == (-1.0, -1.0, -1.0)
    assert bench.mpos() == (-1.0, -1.0, -1.0)


def test_line_waits_for_jog_cancel() -> None:
    bench = Bench().homed()
    bench.say("$J=X-50F600\n", 1)
    assert bench.say(b"\x85$J=X-5F600\n", 0.19) == []
    assert bench.say("", 10) == ["ok"]
    assert bench.mpos()[0] == -5.0


def test_planner_buffers_15_blocks() -> None:
    bench = Bench().homed()
    lines = "".join(f"$J=X{-2 - k}Y{-3 + k % 2}F600\n" for k in range(16))
    assert bench.say(lines) == ["ok"] * 15
    assert "Bf:0," in bench.say("?")[0]
    assert bench.say("", 1) == ["ok"]
    bench.clock.sleep_s(30)
    assert bench.mpos()[0] == -17.0


def test_settings_read_back_and_take_effect() -> None:
    bench = Bench(grbl_settings((100, 90, 50), (1000, 1000, 500), (20, 20, 10))).homed()
    lines = bench.say("$$\n")
    assert lines[0] == "$0=10"
    assert {"$110=1000.000", "$122=10.000", "$131=90.000"} < set(lines)
    assert bench.say("$J=Y-95F100\n") == ["error:15"]
    assert bench.say("$131=96\n$J=Y-95F100\n") == ["ok", "ok"]
    with pytest.raises(ValueError, match=r"no such GRBL setting: \$7"):
        Bench({7: 1})


# ---- other builds and boards -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("settings", "options", "there_mm", "count_mm"),
    [
        ({}, {"homing_passes": (3,)}, (-1, -1, -10), (-1, -1, 0)),  # a compile option of GRBL
        ({44: 3, 45: 0}, {"firmware": "grblHAL"}, (-1, -1, -10), (-1, -1, 0)),
        ({}, {"firmware": "grblHAL"}, (-1, -1, -1), (-1, -1, -1)),
        ({}, {"axis_count": 4}, (-1, -1, -1), (-1, -1, -1, 0)),
        ({23: 1}, {}, (-119, -1, -1), (-119, -1, -1)),  # at the far end
    ],
)
def test_homing_leaves_axes_where_due(
    settings: dict[int, float], options: dict[str, object], there_mm: object, count_mm: object
) -> None:
    bench = Bench(settings, **options).homed()
    assert bench.grbl.position_mm() == there_mm
    assert bench.mpos() == count_mm
    assert bench.say("$J=G53Z-5F600\n", 5) == ["ok"]
    assert bench.grbl.position_mm()[2] == there_mm[2] - 5 - count_mm[2]  # type: ignore[index]


@pytest.mark.parametrize("answer", [b"error:9", b""])
def test_pendant_has_control(answer: bytes) -> None:
    bench = Bench().homed()
    bench.grbl.pendant = "refuses" if answer else "mute"
    assert bench.say("$J=G53Z-5F600\n", 5) == ([answer.decode()] if answer else [])
    assert bench.say("?")[0].endswith("|MPG:1>")
    assert bench.grbl.position_mm()[2] == -1


def test_late_jog_runs_and_is_deaf() -> None:
    """Jogs that come as one ends: protocol.c and serial.c of GRBL 1.1h."""
    bench = Bench().homed()
    bench.grbl.fault("late jog")
    assert bench.say("$J=G53Z-5F600\n$J=G53Z-20F600\n", 0.2) == ["ok"]  # the second waits
    assert bench.say("", 0.5) == ["ok"]
    assert bench.say("?")[0].startswith("<Run|")
    before = bench.grbl.segments[-1]
    assert bench.say(b"$J=G53Z-21F600\n\x85$$\n", 0.1) == ["error:8", "error:8"]
    assert bench.grbl.segments[-1] == before
    assert bench.say("!?")[0].startswith("<Hold:1|")
    bench.clock.sleep_s(0.5)
    assert bench.say("$J=G53Z-9F600\n?")[0].startswith("<Hold:0|")  # the line is not read
    stopped_mm = bench.mpos()[2]
    assert -20 < stopped_mm < -5
    assert bench.say("~", 9) == ["error:8"]  # read in Run, which goes on
    assert bench.mpos() == bench.grbl.position_mm() == (-1, -1, -20)


def test_reset_after_hold_of_late_jog() -> None:
    bench = Bench().homed()
    bench.grbl.fault("late jog")
    bench.say("$J=G53Z-5F600\n$J=G53Z-20F600\n", 0.7)
    bench.say("!", 0.5)
    stopped_mm = bench.grbl.position_mm()
    assert bench.say("\x18", 1)[-1] == BANNER[1]  # no ALARM: it was at rest
    assert bench.mpos() == pytest.approx(stopped_mm, abs=2e-3)
    assert bench.grbl.position_mm() == stopped_mm
