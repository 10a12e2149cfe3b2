"""The GRBL host against exact expected exchanges."""

from __future__ import annotations

import pytest
import serial

from deltact_fab.bench.rig.stage.grbl import GrblStage
from deltact_fab.common.errors import StageError
from deltact_fab.sensor.optics.camera import StageFrame
from deltact_fab.simulate.virtual.clock import VirtualClock

FRAME = StageFrame((-50.0, -50.0, -20.0))
SETTINGS = b"".join(
    b"$%d=%b\r\n" % (n, v)
    for n, v in {
        10: b"1 (status report, mask:00000001)",
        **dict.fromkeys((3, 13, 23, 32), b"0"),
        **dict.fromkeys((20, 21, 22), b"1"),
        24: b"100.000",
        25: b"1000.000",
        26: b"250",
        27: b"1.000",
        **dict.fromkeys((100, 101, 102), b"250.000 (x, step/mm)"),
        **dict.fromkeys((110, 111, 112), b"1000.000"),
        **dict.fromkeys((120, 121, 122), b"25.000"),
        **dict.fromkeys((130, 131, 132), b"100.000"),
    }.items()
)
GREETING = b"\r\nGrbl 1.1h ['$' for help]\r\n[MSG:'$H'|'$X' to unlock]\r\n"
INFO = b"[VER:1.1h.20190825:]\r\n[OPT:V,15,128]\r\nok\r\n"
IDLE = b"<Idle|MPos:%b|FS:0,0>\r\n"
LOCKED = b"<Alarm|MPos:0.000,0.000,0.000|FS:0,0>\r\n"
CONNECT = [(b"$I\n", INFO), (b"$$\n", SETTINGS + b"ok\r\n"), (b"?", LOCKED)]
HOME = [(b"?", LOCKED), (b"$H\n", b"ok\r\n"), (b"?", IDLE % b"-1.000,-1.000,-1.000")]
STOP = [(b"\x85", b""), (b"\x85", b"")]
JOG = b"$J=G90G21G53X-50.0000Y-50.0000Z-15.0000F600.000\n"


class Script:
    """A port that insists on an order of exchanges: (what must be sent, what comes back).

    A read of nothing costs its time-out of the clock, as a port does.
    """

    def __init__(self, clock: VirtualClock, greeting: bytes, exchanges: list[tuple[bytes, bytes]]):
        self._clock = clock
        self._coming = greeting
        self.left = list(exchanges)

    @property
    def in_waiting(self) -> int:
        return len(self._coming)

    def write(self, data: bytes) -> int:
        assert self.left, f"sent {data!r}, expected nothing more"
        expected, answer = self.left.pop(0)
        assert data == expected
        self._coming += answer
        return len(data)

    def read_until(self, end: bytes) -> bytes:
        at = self._coming.find(end)
        if at < 0:
            got, self._coming = self._coming, b""
            self._clock.sleep_s(0.05)
        else:
            got, self._coming = self._coming[: at + 1], self._coming[at + 1 :]
        return got

    def close(self) -> None:
        pass


def connected(
    monkeypatch: pytest.MonkeyPatch, exchanges: list[tuple[bytes, bytes]], greeting: bytes
) -> tuple[GrblStage, Script]:
    clock = VirtualClock()
    port = Script(clock, greeting, [*CONNECT, *exchanges])

    def opened(url: str, **options: object) -> Script:
        assert options["exclusive"] is True
        return port

    monkeypatch.setattr(serial, "serial_for_url", opened)
    stage = GrblStage("/dev/ttyFAKE", clock, FRAME)
    stage.whole_moves = True
    stage.connect()
    return stage, port


def homed(
    monkeypatch: pytest.MonkeyPatch, *exchanges: tuple[bytes, bytes]
) -> tuple[GrblStage, Script]:
    stage, port = connected(monkeypatch, [*HOME, *exchanges], GREETING)
    stage.home()
    return stage, port


def test_connect_home_move(monkeypatch: pytest.MonkeyPatch) -> None:
    jogs = (b"?", b"<Jog|MPos:-20.000,-20.000,-5.000|FS:600,0|Ov:100,100,100>\r\n")
    there = (b"?", IDLE % b"-50.000,-50.000,-15.000")
    stage, port = homed(monkeypatch, (JOG, b"ok\r\n"), *[jogs] * 73, there)
    planned = stage.start_move((0.0, 0.0, 5.0), 600.0)
    # L/v + v/a, where X and Y take 49/L each of the line and accelerate at 25 mm/s2 at most.
    length = (49**2 + 49**2 + 14**2) ** 0.5
    assert planned == pytest.approx(length / 10 + 10 / (25 * length / 49), rel=1e-12)
    assert stage.wait().machine_mm == (-50.0, -50.0, -15.0)
    assert port.left == []
    assert stage.identity()["settings"]["$100"] == 250.0


@pytest.mark.parametrize(
    "greeting",
    [
        b"\xff\x00\xfeGrbl 1.1f ['$' for help]\r\n",
        b"error:7\r\n$0=10\r\n$1=25\r\n\r\nGrbl 1.1h ['$' for help]\r\n",
        b"<Idle|MPos:0.0\r\nGrbl 1.1f ['$' for help]\r\n[MSG:Check Limits]\r\n",
    ],
)
def test_noise_before_banner_is_ignored(monkeypatch: pytest.MonkeyPatch, greeting: bytes) -> None:
    assert connected(monkeypatch, [], greeting)[1].left == []


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (b"error:9\r\n", r"error:9 \(locked in an alarm or a jog\)"),
        (b"error:77\r\n", "was refused: error:77; the move"),
        (b"ALARM:2\r\n[MSG:Reset to continue]\r\n", r"ALARM:2 \(soft limit.*\); home again; the"),
        (b"ALARM:9\r\n", r"ALARM:9 \(homing: no switch found\); home again"),
        (b"\r\nGrbl 1.1h ['$' for help]\r\n", r"the controller restarted \(Grbl 1.1h\)"),
    ],
)
def test_bad_answer_fails_a_move(monkeypatch: pytest.MonkeyPatch, answer: bytes, said: str) -> None:
    stage, port = homed(monkeypatch, (JOG, answer), *STOP)
    with pytest.raises(StageError, match=said):
        stage.start_move((0.0, 0.0, 5.0), 600.0)
    assert port.left == []


def test_lost_answer_ends_only_gel_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = (b"?", IDLE % b"-1.000,-1.000,-1.000")
    press = JOG.replace(b"Z-15.0", b"Z-19.5")
    stage, port = homed(monkeypatch, (JOG, b""), asked, (JOG, b"ok\r\n"))
    stage.start_move((0.0, 0.0, 5.0), 600.0)
    assert port.left == []
    stage, port = homed(monkeypatch, (press, b""), *STOP, asked)
    with pytest.raises(StageError, match=r"no answer to .J=.*0.5 s; the move to .*: stop sent"):
        stage.start_move((0.0, 0.0, 0.5), 600.0)
    assert port.left == []


def test_lost_status_is_requested_again(monkeypatch: pytest.MonkeyPatch) -> None:
    answer = b"\r\n" + IDLE % b"-1.000,-1.000,-1.000"
    stage, port = homed(monkeypatch, (b"?", b"<Idle|MPos:-1.0"), (b"?", answer))
    assert stage.position_mm() == (49.0, 49.0, 19.0)
    assert port.left == []


@pytest.mark.parametrize("state", [b"Hold:0", b"Door:1"])
def test_state_foreign_to_jogs_is_fault(monkeypatch: pytest.MonkeyPatch, state: bytes) -> None:
    status = b"<%b|MPos:-1.000,-1.000,-1.000|FS:0,0>\r\n" % state
    stage, port = homed(monkeypatch, (JOG, b"ok\r\n"), (b"?", status), *STOP)
    stage.start_move((0.0, 0.0, 5.0), 600.0)
    with pytest.raises(StageError, match=f"{state.decode()} .*during a move .*expected Jog"):
        stage.wait()
    assert port.left == []
