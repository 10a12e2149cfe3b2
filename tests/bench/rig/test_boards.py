"""Boards that are accepted or refused by name, axes that are homed or not, and nonsense answers."""

from __future__ import annotations

import random
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from deltact_fab.bench.protocols import plan
from deltact_fab.bench.protocols.motion import StageConfig
from deltact_fab.bench.rig import check, config
from deltact_fab.bench.rig.stage.grbl import GrblStage
from deltact_fab.bench.rig.tool.hand import go_to
from deltact_fab.common.errors import DeltactFabError, InputError, StageError
from deltact_fab.simulate import FaultBench, FaultScenario
from deltact_fab.simulate.virtual import wire
from deltact_fab.simulate.virtual.clock import VirtualClock
from deltact_fab.simulate.virtual.controller import GrblController

STAGE = StageConfig(
    port="simulated", origin_machine_mm=(-60.0, -60.0, -40.0), travel_mm=(120.0, 120.0, 60.0),
    max_feed_mm_min=(1500.0, 1500.0, 1200.0), acceleration_mm_s2=(50.0, 50.0, 50.0),
)  # fmt: skip
HAL = {"firmware": "grblHAL"}
NOT_HOMED = "Z was not homed: it stands at 0.000, homing leaves it at -1.000; let the firmware"
PENDANT = "a pendant has control of the stage: release it"
# Settings, options of the board, what refuses it and the reason.
BOARDS: dict[str, tuple[dict[int, float], dict[str, Any], str, str]] = {
    "GRBL": ({}, {}, "", ""),
    "grblHAL": ({22: 5}, HAL, "", ""),
    "four axes": ({}, {"axis_count": 4}, "", ""),
    "GRBL, X and Y homed": ({}, {"homing_passes": (3,)}, "home", NOT_HOMED),
    "grblHAL, X and Y homed": (
        {22: 5, 44: 3, 45: 0}, HAL, "connect",
        r"\$44=3, \$45=0, \$46=0 \(Z in no homing pass\); set \$44=4 and \$45=3",
    ),
    "pendant": ({}, {"pendant": "refuses"}, "connect", PENDANT),
    "pendant, mute": ({}, {"pendant": "mute"}, "connect", rf"{PENDANT}|no answer to \$I"),
    "FluidNC": ({}, {"firmware": "FluidNC"}, "connect",
                r"firmware .*\[VER:4.0 FluidNC v4.0.1:\] is not supported: flash GRBL 1.1"),
    "uCNC": ({}, {"firmware": "uCNC"}, "connect", r"\[VER: uCNC 1.10.0 .* is not supported"),
    "ESP32": ({}, {"firmware": "Grbl_ESP32"}, "connect", r"firmware .*1\.3a.* is not supported"),
    "old": ({}, {"firmware": "GRBL 0.9"}, "connect",
            r"firmware (Grbl 0\.9j .*|\(no \[VER:\].*) is not supported"),
}  # fmt: skip
INNOCENT = {b"?", b"$I\n", b"$$\n"}


def connected(settings: dict[int, float]) -> Bench:
    bench = Bench(settings, restarts=True)
    bench.stage.connect()
    return bench


class Bench:
    def __init__(self, settings: dict[int, float], restarts: bool, **board: Any) -> None:
        self.clock = VirtualClock()
        self.grbl = GrblController({1: 255, **settings}, self.clock, **board)
        self.clock.sleep_s(2.0)
        self.grbl.take_output()
        self.trace: list[wire.WireExchange] = []
        link = wire.SerialLink(self.grbl, self.clock, resets_on_open=restarts, trace=self.trace)
        self.stage = GrblStage.from_config(STAGE, self.clock, link)

    def sent(self) -> set[bytes]:
        return {data for _, who, data in self.trace if who == "host"}

    def check(self, monkeypatch: pytest.MonkeyPatch) -> str:
        """The first failure of `rig check`."""
        with monkeypatch.context() as patch:
            patch.setattr(check.GrblStage, "from_config", lambda *_: self.stage)
            rows = list(check._stage_rows(config.GrblConfig(kind="grbl", stage=STAGE)))
        return next((str(row.value) for row in rows if row.failed), "")


@pytest.mark.parametrize("restarts", [False, True])
@pytest.mark.parametrize("board", BOARDS)
def test_board_check_home_and_jog_agree(
    monkeypatch: pytest.MonkeyPatch, board: str, restarts: bool
) -> None:
    settings, options, refused, reason = BOARDS[board]
    bench = Bench(settings, restarts, **options)
    stage = bench.stage
    failed = bench.check(monkeypatch)
    assert bool(failed) == (refused == "connect"), failed
    assert re.search(reason, failed) or refused != "connect"
    if refused == "connect":
        with pytest.raises(StageError, match=reason):
            stage.connect()
    else:
        stage.connect()
    if refused:
        for act in (stage.home, lambda: stage.start_move((0.0, 0.0, 5.0), 600.0)):
            with pytest.raises(StageError, match=reason if refused == "home" else None):
                act()
        assert not stage.trust_count()
        assert not stage.homed
        if refused == "home":  # nor does the next command trust what is counted
            stage.connect()
            assert not stage.trust_count()
        assert bench.sent() <= {*INNOCENT, *([b"$H\n"] if refused == "home" else [])}
        return
    stage.home()
    stage.start_move((0.0, 0.0, 5.0), 600.0)
    stage.wait()
    assert bench.grbl.position_mm() == pytest.approx((-60.0, -60.0, -35.0), abs=1e-9)
    assert b"\x18" not in bench.sent()


def fault_bench(settings: dict[int, float], feed: float = 30.0, **options: Any) -> FaultBench:
    """The protocol smoke, pressed at this feed, on a board with these settings."""
    smoke, path = plan.load_protocol("smoke")
    motion = smoke.motion.model_copy(update={"press_feed_mm_min": feed})
    smoke = smoke.model_copy(update={"motion": motion})
    scenario = FaultScenario.from_protocol(smoke, path.read_bytes(), config.load_rig("virtual")[0])
    own = {**(scenario.settings or {}), **settings}
    return FaultBench(replace(scenario, settings=own), **options)


@pytest.mark.parametrize("board", [b for b in BOARDS if BOARDS[b][2]])
def test_board_refused_by_run(tmp_path: Path, board: str) -> None:
    settings, options, _, reason = BOARDS[board]
    bench = fault_bench(settings, **options)
    with pytest.raises(StageError, match=reason):
        bench.run(tmp_path / "run")
    assert {s.end_mm[2] for s in bench.board.segments} <= {-6.0}  # the tip has kept its height
    assert not [data for _, who, data in bench.trace if who == "host" and data.startswith(b"$J")]


def test_pendant_ends_the_position() -> None:
    bench = connected({})
    bench.stage.home()
    bench.grbl.pendant = "refuses"
    with pytest.raises(StageError, match=PENDANT):
        bench.stage.position_mm()
    bench.grbl.pendant = ""
    with pytest.raises(StageError, match=r"no motion after a fault \(a pendant"):
        bench.stage.start_move((0.0, 0.0, 5.0), 600.0)


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (b"<Idle|MPos:0.000,0.000|FS:0,0>\r\n", r"cannot be read: '<Idle\|MPos:0.000,0.000\|FS"),
        (b"<Idel|MPos:0.000,0.000,0.000>\r\n", "cannot be read: '<Idel"),
        (b'echo:Unknown command: "?"\r\nok\r\n', "cannot be read: 'ok'; is .stage. baud right"),
        (b"\x80\xf8\x80\xf8", "cannot be read: '\ufffd'"),
        (b"<Idle|WPos:0.000,0.000,0.000>\r\n", r"give the work position; set \$10=1"),
    ],
)
def test_answering_board_is_never_reset(answer: bytes, said: str) -> None:
    link = NonsenseLink(VirtualClock(), random.Random(0), -1)
    link.coming, link.answers[b"?"] = b"", answer
    with pytest.raises(StageError, match=said):
        GrblStage.from_config(STAGE, link.clock, link).connect()
    assert link.sent == [b"?"]


# ---- axes that stand at a switch, legs, slow feeds ----------------------------------------------


@pytest.mark.parametrize("at_mm", [(0.0, -30.0, -30.0), (-30.0, 0.0, 0.0), (-30.0, -30.0, -0.2)])
def test_stage_at_switch_lifts_and_homes(at_mm: tuple[float, float, float]) -> None:
    bench = Bench({}, restarts=False, start_mm=at_mm)
    for line in (b"$H\n", b"$21=0\n", b"$J=G53X%.3fY%.3fZ%.3fF900\n" % at_mm, b"$21=1\n"):
        bench.grbl.write(line)
        bench.clock.sleep_s(90.0)
    bench.stage.connect()
    assert bench.stage.lift(25.0, 120.0) is not None
    assert bench.grbl.position_mm()[2] == pytest.approx(max(at_mm[2], min(at_mm[2] + 25.0, -1.0)))
    bench.stage.home()
    assert bench.grbl.position_mm() == (-1.0, -1.0, -1.0)


def test_inward_move_from_switch_is_right() -> None:
    limits = connected({}).stage._c.limits
    assert limits.move_refusal((0.0, -5.0, 0.0), (0.0, -6.0, -0.5), 60.0) == ""
    assert "target Z 0.000" in limits.move_refusal((0.0, -5.0, -0.5), (0.0, -5.0, 0.0), 60.0)
    assert "target X -121.000" in limits.move_refusal((0.0, -5, -2), (-121.0, -5, -2), 60.0)


@pytest.mark.parametrize(
    ("target_mm", "feed", "said"),
    [
        ((0.0, 0.0, 39.2), 300.0, r"target Z -0\.800 mm"),
        ((0.0, 61.0, 10.0), 300.0, r"target Y 1\.000 mm"),
        ((0.0, 0.0, 6.0), 2000.0, r"moves X at"),
        ((0.0, 0.0, 6.0), 5.0, r"feed 5 mm/min is slower than the controller steps: at least 7\.6"),
    ],
)
def test_legs_are_judged_before_the_first(
    target_mm: tuple[float, float, float], feed: float, said: str
) -> None:
    bench = connected({100: 250, 101: 250, 102: 250})
    bench.stage.home()
    bench.stage.start_move((-20.0, 5.0, 8.0), 600.0)
    bench.stage.wait()
    count, at_mm = len(bench.trace), bench.grbl.position_mm()
    with pytest.raises(InputError, match=said):
        go_to(bench.stage, target_mm, feed, into_gel=False)
    assert {data for _, who, data in bench.trace[count:] if who == "host"} == {b"?"}
    assert bench.grbl.position_mm() == at_mm


@pytest.mark.parametrize(
    ("settings", "least"), [({}, 7.4), ({100: 400}, 7.4), ({102: 800}, 2.3), ({102: 80}, 22.9)]
)
def test_feeds_below_the_timer_are_refused(settings: dict[int, float], least: float) -> None:
    """GRBL: 16 MHz / 8 / 65535 steps/s of the axis that steps most (stepper.c)."""
    limits = connected({100: 250, 101: 250, 102: 250, **settings}).stage._c.limits
    down = (0.0, 0.0, -1.0)
    assert f"at least {least:g} here" in limits.feed_refusal(down, least - 0.1)
    assert limits.feed_refusal(down, least) == ""
    hal = type(limits)({**limits.settings, 44: 7})  # 20 bits, at most 120 MHz
    assert hal.feed_refusal(down, least / 2) == ""
    assert "14.3 steps/s" in hal.feed_refusal(down, least / 2.2)


def test_slow_plan_is_refused_unmoved(tmp_path: Path) -> None:
    bench = fault_bench({100: 250, 101: 250, 102: 250}, 3.0)
    with pytest.raises(InputError, match=r"feed 3 mm/min is slower .* at least 7\.4 here"):
        bench.run(tmp_path / "run")
    assert bench.board.segments == []


# ---- nonsense -----------------------------------------------------------------------------------

SETTINGS = {
    3: 0, 10: 1, 13: 0, 20: 1, 21: 1, 22: 1, 23: 0, 24: 1000, 25: 1000, 26: 5, 27: 1, 32: 0,
    100: 250, 101: 250, 102: 250, 110: 1500, 111: 1500, 112: 1200,
    120: 100, 121: 100, 122: 100, 130: 120, 131: 120, 132: 60,
}  # fmt: skip
BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n[MSG:'$H'|'$X' to unlock]\r\n"
OTHERS = (
    b"error:9\r\n", b"ALARM:1\r\n", BANNER, b"ok\r\n", b"[MSG:Check Door]\r\n", b"start\r\n",
    b"Grbl 4.0 [FluidNC v4.0.1 (wifi) '$' for help]\r\n", b"[VER: uCNC 1.10.0 - board]\r\nok\r\n",
    b"<Idle|MPos:-1.000,-1.000,0.000|FS:0,0>\r\n", b"<Idle|MPos:-1.000,-1.000>\r\n",
    b"<Idle|WPos:-1.000,-1.000,-1.000>\r\n", b"<Run|MPos:-1.000,-1.000,-1.000|MPG:1>\r\n",
    b"<Idle|MPos:nan,inf,-1.000>\r\n", b"ok" * 5000 + b"\r\n", b"X:0 Y:0 Z:0\r\nok\r\n",
)  # fmt: skip


MOTIONS = (b"$H", b"$J")


class NonsenseLink:
    """A cable to a board of which one answer, the n-th of a session, is altered."""

    def __init__(self, clock: VirtualClock, draw: random.Random, number: int) -> None:
        self.clock, self.draw, self.number = clock, draw, number
        self.sent: list[bytes] = []
        self.after: list[bytes] = []  # sent after the first altered answer
        self.original = b""  # what was altered first
        self.given: list[bytes] = []  # answers of that kind since then, until the next motion
        self.lasts = draw.random() < 0.5  # all answers of that kind are altered
        self.key = b""
        self.coming = BANNER if draw.random() < 0.8 else b""
        status = b"<Alarm|MPos:0.000,0.000,0.000|FS:0,0>\r\n"
        lines = b"".join(b"$%d=%.3f\r\n" % pair for pair in SETTINGS.items())
        self.answers = {
            b"?": status, b"$I\n": b"[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\nok\r\n",
            b"$$\n": lines + b"ok\r\n", b"$H\n": b"ok\r\n", b"$J": b"ok\r\n",
        }  # fmt: skip
        if number == 0:
            self.coming = self._alter(self.coming or BANNER)

    def open_link(self, timeout: float) -> NonsenseLink:
        return self

    def __str__(self) -> str:
        return "link"

    def close(self) -> None:
        pass

    @property
    def in_waiting(self) -> int:
        return len(self.coming)

    def write(self, data: bytes) -> None:
        self.sent.append(data)
        key = data[:2] if data.startswith(b"$J") else data
        if self.given:
            self.after.append(data)
        answer = self.answers.get(key, BANNER if data == b"\x18" else b"")
        if key == b"$H\n":
            self.answers[b"?"] = b"<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0>\r\n"
        elif key == b"$J":
            self.answers[b"?"] = b"<Idle|MPos:-60.000,-60.000,-35.000|FS:0,0>\r\n"
        again = key == self.key and not any(x[:2] in MOTIONS for x in self.after)
        if answer and (len(self.sent) == self.number or (again and self.lasts)):
            self.key = key
            answer = self._alter(answer)
        elif again:
            self.given.append(answer)
        self.coming += answer

    def read_until(self, end: bytes = b"\n") -> bytes:
        head, newline, rest = self.coming.partition(end)
        self.coming = rest if newline else b""
        self.clock.sleep_s(0.0 if newline else 0.05)
        return head + newline

    def read(self, size: int) -> bytes:
        data, self.coming = self.coming[:size], self.coming[size:]
        return data

    def _alter(self, answer: bytes) -> bytes:
        draw = self.draw
        at, n = draw.randrange(len(answer)), draw.randrange(1, 4)
        noise = draw.randbytes(n)
        self.original = self.original or answer
        altered = draw.choice((
            answer[:at] + noise + answer[at + n :], answer[:at] + noise + answer[at:],
            answer[:at] + answer[at + n :], answer[:at], answer[:at] + answer, answer * 2,
            draw.choice(OTHERS), draw.choice(OTHERS) + answer, draw.randbytes(draw.randrange(200)),
        )) or b" "  # fmt: skip
        self.given.append(altered)
        return altered


def sensible(altered: bytes, original: bytes) -> bool:
    """True if an altered answer may be taken for one of a board that is well."""
    lines = [line.strip() for line in altered.split(b"\n")[:-1] if line.strip()]
    if original.startswith(b"<"):
        pattern = rb"<(Idle|Alarm)(:\d+)?\|MPos:" + rb",".join([rb"-?\d+\.\d\d\d"] * 3)
        whole = [x for x in lines if re.fullmatch(pattern + rb"(,-?[\d.]+)*(\|[^<>]*)?>", x)]
        near = original.startswith(b"<Alarm") or b"MPos:-1.00" in altered
        return bool(whole) and b"MPG:1" not in altered and near
    if original == BANNER:
        return True  # `$I` and a status follow
    if original.startswith(b"[VER"):
        return any(re.match(rb"\[VER:1\.1[a-z]\.\d+:", line) for line in lines) and b"ok" in lines
    if original.startswith(b"$"):
        found = {int(m[1]) for x in lines if (m := re.fullmatch(rb"\$(\d+)=-?[\d.]+", x))}
        return found >= set(SETTINGS) and b"ok" in lines
    return b"ok" in lines


def session(seed: int) -> Iterator[str]:
    """Connect, home and move with one altered answer; what is wrong with what was done then."""
    link = NonsenseLink(VirtualClock(), random.Random(seed), seed % 8)
    stage = GrblStage.from_config(STAGE, link.clock, link)
    stage.whole_moves = True
    error = ""
    try:
        stage.connect()
        stage.home()
        stage.start_move((0.0, 0.0, 5.0), 600.0)
        stage.wait()
        stage.close()
    except DeltactFabError as reason:
        error = str(reason)
        if not isinstance(reason, (StageError, InputError)):
            yield type(reason).__name__
    if not error.replace("\ufffd", "").isprintable() or len(error) > 400:
        yield f"no single line: {error!r}"
    before = link.sent[: len(link.sent) - len(link.after)]
    motions = [x for x in link.after if x[:2] in MOTIONS and x not in before]
    if motions and not any(sensible(altered, link.original) for altered in link.given):
        yield f"{link.given!r} for {link.original!r}: then {motions}"


@pytest.mark.parametrize(
    "count", [pytest.param(500, id="some"), pytest.param(20_000, id="all", marks=pytest.mark.slow)]
)
def test_nonsense_is_followed_by_no_motion(count: int) -> None:
    wrong = {seed: found for seed in range(count) if (found := list(session(seed)))}
    assert not wrong, list(wrong.items())[:3]
