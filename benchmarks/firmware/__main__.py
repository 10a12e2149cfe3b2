"""GRBL and grblHAL under the real host: `python -m benchmarks.firmware GRBL SIMULATOR CORE`.

Clones (or their git directories) of gnea/grbl, grblHAL/Simulator and grblHAL/core. Built with cmake
and a plain compiler in a temporary folder. `avr.c` plays the chip under GRBL, `carriage.c` gives
both a carriage with end switches. Each row is one belief of the host, held against that firmware.
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
from deltact_fab.protocols.motion import StageConfig
from deltact_fab.rig.interface import WallClock
from deltact_fab.rig.stage.grbl import GrblStage

from . import dead_man

HERE = Path(__file__).parent
SETTINGS = {
    10: 3, 24: 600, 25: 1500, 26: 20, 27: 1, 1: 255, 100: 800, 101: 800, 102: 800, 110: 1500,
    111: 1500, 112: 1200, 120: 50, 121: 50, 122: 50, 130: 120, 131: 120, 132: 60, 23: 0,
}  # fmt: skip
LAST = {21: 1, 20: 1}  # they need homing
NEEDS = StageConfig(
    origin_machine_mm=(0.0,) * 3, travel_mm=(120.0, 120.0, 60.0),
    max_feed_mm_min=(1500.0, 1500.0, 1200.0), acceleration_mm_s2=(50.0,) * 3,
)  # fmt: skip
EDITS = (
    ("src/grbl_interface.c", "    print_steps(0);",
     "    extern void carriage_tick (void);\n    carriage_tick();\n    print_steps(0);"),
    # Hard limits are off for the axes that home, as in the drivers of real boards.
    ("src/driver.c", "irq_mask.mask = on ? AXES_BITMASK : 0;",
     "irq_mask.mask = on ? AXES_BITMASK & ~homing_cycle.mask : 0;"),
    ("CMakeLists.txt", "    src/grbl_interface.c\n",
     "    src/grbl_interface.c\n    src/grblhal.c\n    src/carriage.c\n"),
)  # fmt: skip


UNO = ("avr/io", "avr/pgmspace", "avr/interrupt", "avr/wdt", "util/delay")  # headers
GCC = ("gcc", "-O1", "-w", "-fcommon", "-DF_CPU=16000000UL", "-I.", "-Igrbl", "-c")


def unpacked(clone: Path, folder: Path) -> str:
    """Its newest commit there; which one, and of what day."""
    folder.mkdir(parents=True, exist_ok=True)
    tar = subprocess.run(["git", "-C", clone, "archive", "HEAD"], capture_output=True, check=True)
    subprocess.run(["tar", "x", "-C", folder], input=tar.stdout, check=True)
    told = ["git", "-C", str(clone), "log", "-1", "--format=%h of %cs"]
    return subprocess.run(told, capture_output=True, text=True, check=True).stdout.strip()


def built_grbl(clone: Path, folder: Path) -> tuple[list[Path | str], str]:
    """The program's words, and what it was built from."""
    commit = unpacked(clone, folder)
    (folder / "grbl" / "eeprom.c").unlink()  # avr.c has one
    for name in ("avr.c", "avr.h", "carriage.c"):
        (folder / name).write_bytes((HERE / name).read_bytes())
    for name in UNO:
        (folder / f"{name}.h").parent.mkdir(exist_ok=True)
        (folder / f"{name}.h").write_text('#include "avr.h"\n')
    renamed = {"main.c": ["-Dmain=grbl_main"], "serial.c": ["-Dserial_read=grbl_serial_read"]}
    for source in (*(folder / "grbl").glob("*.c"), folder / "avr.c", folder / "carriage.c"):
        words: list[str | Path] = [*GCC, *renamed.get(source.name, []), source]
        subprocess.run(words, cwd=folder, check=True)
    objects = list(folder.glob("*.o"))
    subprocess.run(["gcc", *map(str, objects), "-lm", "-o", "uno"], cwd=folder, check=True)
    return [folder / "uno"], f"GRBL 1.1h, {commit}"


def built_grblhal(simulator: Path, core: Path, folder: Path) -> tuple[list[Path | str], str]:
    """The program's words, and what it was built from."""
    commits = unpacked(simulator, folder), unpacked(core, folder / "src" / "grbl")
    for name, was, becomes in EDITS:
        file = folder / name
        text = file.read_text()
        assert was in text, f"{name}: another version"
        file.write_text(text.replace(was, becomes, 1))
    for name in ("carriage.c", "grblhal.c"):
        (folder / "src" / name).write_bytes((HERE / name).read_bytes())
    for words in (["cmake", "-B", "build"], ["make", "-C", "build", "grblHAL_sim"]):
        subprocess.run(words, cwd=folder, check=True, capture_output=True)
    program = folder / "build" / "grblHAL_sim"
    return [program, "-n", "-p"], f"grblHAL, simulator {commits[0]}, core {commits[1]}"


@contextmanager
def board(program: list[Path | str], folder: Path) -> Iterator[str]:
    """Its address, powered on with the settings that its folder remembers."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    # grblHAL's takes what comes on standard input for keys; ctrl-F ends it and keeps settings.
    with subprocess.Popen(
        [*program, str(port)], cwd=folder, stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    ) as process:  # fmt: skip
        time.sleep(1.5)
        try:
            yield f"socket://127.0.0.1:{port}"
            assert process.stdin is not None
            with suppress(OSError, subprocess.TimeoutExpired):
                process.stdin.write(b"\x06")
                process.stdin.flush()
                process.wait(3)
        finally:
            process.kill()


def change(program: list[Path | str], folder: Path, settings: dict[int, float]) -> None:
    """One after the other; what was not answered is written again, at another power-up."""
    left = dict(settings)
    for _ in range(10):
        with board(program, folder) as url, suppress(OSError):
            host, port = url.removeprefix("socket://").split(":")
            with (
                socket.create_connection((host, int(port)), 2) as wire,
                wire.makefile("rb") as said,
            ):
                for n, value in list(left.items()):
                    wire.sendall(f"${n}={value:g}\n".encode())
                    while (line := said.readline()).strip() not in (b"ok", b""):
                        pass
                    if line:
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


def beliefs(program: list[Path | str], folder: Path) -> Iterator[tuple[str, str]]:
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
    if len(program) > 1:  # grblHAL's
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
    with board(program, folder) as url:
        yield from dead_man.rows(folder, int(url.rpartition(":")[2]))


def main() -> None:
    """Build, look, print; exit code 1 where a belief is wrong."""
    if len(sys.argv) != 4:
        raise SystemExit(__doc__)
    grbl, simulator, core = (Path(word).resolve() for word in sys.argv[1:])
    wrong = False
    with tempfile.TemporaryDirectory() as name:
        for program, what in (
            built_grbl(grbl, Path(name) / "grbl"),
            built_grblhal(simulator, core, Path(name) / "grblhal"),
        ):
            print(f"\n{what}", flush=True)
            folder = Path(name) / ("grblhal" if len(program) > 1 else "grbl")
            for belief, came in beliefs(program, folder):
                wrong |= came.startswith("WRONG")
                print(f"| {belief} | {came} |", flush=True)
    raise SystemExit(wrong)


if __name__ == "__main__":
    main()
