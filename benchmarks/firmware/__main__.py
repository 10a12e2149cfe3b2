"""grblHAL under the real host: `python -m benchmarks.firmware SIMULATOR CORE`.

SIMULATOR, CORE: clones (or their git directories) of grblHAL/Simulator and grblHAL/core. Built with
cmake and a plain compiler in a temporary folder; `carriage.c` gives it end switches, for the
simulator has none. Each row is one belief of the host, held against that firmware.
"""

from __future__ import annotations

import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

from deltact_fab.errors import StageError
from deltact_fab.optics import StageFrame
from deltact_fab.rig.clock import WallClock
from deltact_fab.rig.stage.grbl import GrblStage
from deltact_fab.rig.stage.settings import Needs

HERE = Path(__file__).parent
SETTINGS = {
    10: 3, 24: 300, 25: 1200, 27: 1, 1: 255, 100: 800, 101: 800, 102: 800, 110: 1500, 111: 1500,
    112: 1200, 120: 50, 121: 50, 122: 50, 130: 120, 131: 120, 132: 60, 23: 0,
}  # fmt: skip
LAST = {21: 1, 20: 1}  # they need homing
NEEDS = Needs((120.0,) * 2 + (60.0,), (1500.0, 1500.0, 1200.0), (50.0,) * 3, 0, 0, 1.0)
EDITS = (
    ("src/grbl_interface.c", "    print_steps(0);",
     "    extern void carriage_tick (void);\n    carriage_tick();\n    print_steps(0);"),
    # Hard limits are off for the axes that home, as in the drivers of real boards.
    ("src/driver.c", "irq_mask.mask = on ? AXES_BITMASK : 0;",
     "irq_mask.mask = on ? AXES_BITMASK & ~homing_cycle.mask : 0;"),
    ("CMakeLists.txt", "    src/grbl_interface.c\n",
     "    src/grbl_interface.c\n    src/carriage.c\n"),
)  # fmt: skip


def build(simulator: Path, core: Path, folder: Path) -> tuple[Path, str]:
    """The program, and which commits it was built from."""
    commits = []
    for clone, where in ((simulator, folder), (core, folder / "src" / "grbl")):
        where.mkdir(parents=True, exist_ok=True)
        tar = subprocess.run(
            ["git", "-C", clone, "archive", "HEAD"], capture_output=True, check=True
        )
        subprocess.run(["tar", "x", "-C", where], input=tar.stdout, check=True)
        told = subprocess.run(["git", "-C", clone, "log", "-1", "--format=%h %cs"],
                              capture_output=True, text=True, check=True)  # fmt: skip
        commits.append(told.stdout.strip())
    for name, was, becomes in EDITS:
        file = folder / name
        text = file.read_text()
        assert was in text, f"{name}: another version"
        file.write_text(text.replace(was, becomes, 1))
    (folder / "src" / "carriage.c").write_bytes((HERE / "carriage.c").read_bytes())
    for words in (["cmake", "-B", "build"], ["make", "-C", "build", "grblHAL_sim"]):
        subprocess.run(words, cwd=folder, check=True, capture_output=True)
    return folder / "build" / "grblHAL_sim", f"Simulator {commits[0]}, core {commits[1]}"


@contextmanager
def board(program: Path, folder: Path) -> Iterator[str]:
    """Its address, powered on with the settings that its folder remembers."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    # Its console takes what comes on standard input for keys; ctrl-F ends it and keeps settings.
    with subprocess.Popen(
        [program, "-n", "-p", str(port)], cwd=folder, stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    ) as process:  # fmt: skip
        time.sleep(1.5)
        yield f"socket://127.0.0.1:{port}"
        assert process.stdin is not None
        with suppress(OSError, subprocess.TimeoutExpired):
            process.stdin.write(b"\x06")
            process.stdin.flush()
            process.wait(3)
        process.kill()


def change(program: Path, folder: Path, settings: dict[int, float]) -> None:
    """One after the other; what was not answered is written again, at another power-up."""
    left = dict(settings)
    for _ in range(10):
        with board(program, folder) as url, suppress(OSError):
            host, port = url.removeprefix("socket://").split(":")
            with socket.create_connection((host, int(port)), 2) as wire:
                wire.settimeout(2.0)
                for n, value in list(left.items()):
                    wire.sendall(f"${n}={value:g}\n".encode())
                    if b"ok" in wire.recv(200):
                        del left[n]
        if not left:
            return
    raise SystemExit(f"never answered: {left}")


def refused(stage: GrblStage, words: str) -> str:
    """What `connect` says; it has to hold these words."""
    try:
        stage.connect()
    except StageError as why:
        return str(why) if words in str(why) else f"WRONG: {why}"
    return "WRONG: connected"


def rows(program: Path, folder: Path) -> Iterator[tuple[str, str]]:
    """Each belief, and what came of it."""

    def look(what: Callable[[GrblStage], str]) -> str:
        with board(program, folder) as url:
            stage = GrblStage(url, WallClock(), StageFrame((-60.0, -60.0, -40.0)), needs=NEEDS)
            with closing(stage):
                try:
                    return what(stage)
                except StageError as why:
                    return f"WRONG: {why}"

    change(program, folder, {**SETTINGS, 22: 1, **LAST})
    yield "boots Idle, unlocked: refused", look(lambda s: refused(s, "not locked at its start"))
    change(program, folder, {22: 5})

    def unhomed(stage: GrblStage) -> str:
        stage.connect()
        state = stage.look().state
        if stage.lift(25.0, 300.0) or stage.trust_count():
            return f"WRONG: moved in {state}"
        return f"{state}: nothing lifts, no count is trusted"

    yield "locked until it was homed", look(unhomed)

    def twice(stage: GrblStage) -> str:
        stage.connect()
        for _ in range(3):
            stage.home()
            stage.lift(25.0, 300.0)
        return f"{stage.look().state} at {stage.look().machine_mm}"

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


def main() -> None:
    """Build, look, print; exit code 1 where a belief is wrong."""
    if len(sys.argv) != 3:
        raise SystemExit(__doc__)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        program, commits = build(Path(sys.argv[1]), Path(sys.argv[2]), folder)
        print(f"grblHAL, {commits}")
        found = list(rows(program, folder))
    for what, came in found:
        print(f"{what}: {came}")
    raise SystemExit(any(came.startswith("WRONG") for _, came in found))


if __name__ == "__main__":
    main()
