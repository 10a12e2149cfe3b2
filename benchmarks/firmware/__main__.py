"""Beliefs of the host, held against firmware that was compiled for this computer.

python -m benchmarks.firmware PROGRAM [ARG...]

PROGRAM is yours: GRBL 1.1 or grblHAL, built to run here. It is started in an empty folder as
`PROGRAM ARG... PORT`, serves its serial line on that port of 127.0.0.1, keeps its settings in that
folder, and has a switch at the positive end of each axis: `carriage.c`, linked into it and told of
each step, gives it both the switches and the file from which the tip's depth is read. Its settings
are changed; real time is needed. A row is one belief and what the firmware did, WRONG where that
contradicts; the exit code is then 1. Half an hour.
"""

from __future__ import annotations

import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

from deltact_fab.bench.protocols.motion import StageConfig
from deltact_fab.bench.rig.interface import WallClock
from deltact_fab.bench.rig.stage.grbl import GrblStage
from deltact_fab.common.errors import StageError
from deltact_fab.sensor.optics.camera import StageFrame

from . import dead_man

SETTINGS = {
    10: 3, 24: 600, 25: 1500, 26: 20, 27: 1, 1: 255, 100: 800, 101: 800, 102: 800, 110: 1500,
    111: 1500, 112: 1200, 120: 50, 121: 50, 122: 50, 130: 120, 131: 120, 132: 60, 23: 0,
}  # fmt: skip
LAST = {21: 1, 20: 1}  # they need homing
NEEDS = StageConfig(
    origin_machine_mm=(0.0,) * 3, travel_mm=(120.0, 120.0, 60.0),
    max_feed_mm_min=(1500.0, 1500.0, 1200.0), acceleration_mm_s2=(50.0,) * 3,
)  # fmt: skip


@contextmanager
def board(program: list[str], folder: Path) -> Iterator[str]:
    """Its address, powered on with the settings that its folder remembers."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    # grblHAL's takes what comes on standard input for keys; ctrl-F ends it and keeps settings.
    with subprocess.Popen(
        [*program, str(port)], cwd=folder, stdin=subprocess.PIPE, bufsize=0,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    ) as process:  # fmt: skip
        time.sleep(1.5)
        try:
            yield f"socket://127.0.0.1:{port}"
            assert process.stdin is not None
            with suppress(OSError, subprocess.TimeoutExpired):
                process.stdin.write(b"\x06")
                process.wait(3)
        finally:
            process.kill()


def connected(url: str) -> socket.socket:
    """A connection to the board; reading from it takes 2 s at most."""
    return socket.create_connection(("127.0.0.1", int(url.rpartition(":")[2])), 2)


def ask(wire: socket.socket, line: str) -> list[str]:
    """The lines of the answer; none where it ends without an `ok`."""
    wire.sendall(f"{line}\n".encode())
    answer = b""
    while b"ok\r\n" not in answer:
        data = wire.recv(4096)
        if not data:
            return []
        answer += data
    return answer.decode(errors="replace").splitlines()


def change(program: list[str], folder: Path, settings: dict[int, float]) -> None:
    """One after the other; what was not answered is written again, at another power-up."""
    left = dict(settings)
    for _ in range(10):
        with board(program, folder) as url, suppress(OSError), connected(url) as wire:
            for n, value in list(left.items()):
                if ask(wire, f"${n}={value:g}"):
                    del left[n]
        if not left:
            return
    raise SystemExit(f"never answered: {left}")


def identity(program: list[str], folder: Path) -> str:
    """The answer to `$I`, on one line; empty where there is none."""
    with board(program, folder) as url, suppress(OSError), connected(url) as wire:
        return " ".join(line for line in ask(wire, "$I") if line.startswith("["))
    return ""


def refused(stage: GrblStage, words: str) -> str:
    """What `connect` says; it has to hold these words."""
    try:
        stage.connect()
    except StageError as why:
        return str(why) if words in str(why) else f"WRONG: {why}"
    return "WRONG: connected"


def beliefs(program: list[str], folder: Path) -> Iterator[tuple[str, str]]:
    """Each belief, and what came of it."""

    def look(what: Callable[[GrblStage], str]) -> str:
        with board(program, folder) as url:
            stage = GrblStage(url, WallClock(), StageFrame((-60.0, -60.0, -40.0)), config=NEEDS)
            with closing(stage):
                try:
                    return what(stage)
                except StageError as why:
                    return f"WRONG: {why}"

    change(program, folder, {**SETTINGS, 22: 1, **LAST})
    if "grblHAL" in identity(program, folder):
        yield "boots Idle, unlocked: refused", look(lambda s: refused(s, "not locked at its start"))
        change(program, folder, {22: 5})

    def unhomed(stage: GrblStage) -> str:
        stage.connect()
        state = stage.report().state
        if stage.lift(25.0, 300.0) is not None or stage.trust_count():
            return f"WRONG: moved in {state}"
        return f"{state}: nothing lifts, no count is trusted"

    yield "locked until it was homed", look(unhomed)

    def twice(stage: GrblStage) -> str:
        stage.connect()
        for _ in range(3):
            stage.home()
            stage.lift(25.0, 300.0)
        return f"{stage.report().state} at {stage.report().machine_mm}"

    yield "homed and lifted at the top three times", look(twice)

    def moves(stage: GrblStage) -> str:
        stage.connect()
        stage.home()
        slowest_s = 0.0
        for target in ((50.0, 50.0, 30.0), (0.0, 0.0, 5.0), (0.0, 0.0, 4.0), (1.0, -1.0, 5.0)):
            start_s = time.monotonic()
            stage.start_move(target, 1200.0)
            slowest_s = max(slowest_s, time.monotonic() - start_s)
            stage.wait()
        return f"at {stage.position_mm()}, a jog answered within {slowest_s:.2f} s"

    yield "homed and moved", look(moves)
    if not (folder / "carriage").exists():
        yield "a tip whose host, cable or answers are lost", "not measured: no file `carriage`"
        return
    with board(program, folder) as url:
        yield from dead_man.rows(folder, int(url.rpartition(":")[2]))


def main() -> None:
    """Change the settings, look, print; exit code 1 where a belief is wrong."""
    path = shutil.which(sys.argv[1]) if len(sys.argv) > 1 else None
    if path is None:
        raise SystemExit(__doc__)
    program = [str(Path(path).resolve()), *sys.argv[2:]]
    wrong = False
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        firmware = identity(program, folder)
        if not firmware:
            raise SystemExit(f"{path}: no answer to $I on the port of 127.0.0.1 that it was given")
        print(firmware, flush=True)
        for belief, answer in beliefs(program, folder):
            wrong |= answer.startswith("WRONG")
            print(f"| {belief} | {answer} |", flush=True)
    raise SystemExit(wrong)


if __name__ == "__main__":
    main()
