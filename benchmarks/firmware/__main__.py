"""Beliefs of the host, held against firmware.

python -m benchmarks.firmware [OPTION...] PROGRAM [ARG...]    one that you built for this computer
python -m benchmarks.firmware [OPTION...] --tty PATH          a board or a simulator that runs there

  --stdio               PROGRAM talks on its standard input and output, not on a port
  --settings "N=VALUE ..."  what it needs besides ours: those of a PROGRAM become a stage's of 120
                        x 120 x 60 mm; a board keeps its own but for $1, $10, $13, $20 to $22, and
                        all come back at the end
  --steps FILE          where it writes the steps that it makes ("carriage"), in its folder
  --moments N           trials of each fault (50); 0: none

PROGRAM is GRBL 1.1 or grblHAL. It is started in an empty folder, keeps its settings there and
serves its serial line on the port of 127.0.0.1 that stands for {port} in an ARG, or comes last. It
needs a switch at the positive end of each axis: `carriage.c`, linked into it and told of each step,
gives it both switches and the file of steps. Without such a file depth is by its own report. On a
stage 62 x 62 x 42 mm below the switches have to be free. Real time; half an hour. A row is one
belief and what the firmware did, WRONG where that contradicts; the exit code is then 1.
"""

from __future__ import annotations

import re
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from getopt import GetoptError, getopt
from itertools import chain
from pathlib import Path

from deltact_fab.bench.protocols.motion import StageConfig
from deltact_fab.bench.rig.interface import WallClock
from deltact_fab.bench.rig.stage.exchange import SETTING_PATTERN, SOFT_RESET
from deltact_fab.bench.rig.stage.grbl import GrblStage
from deltact_fab.bench.rig.stage.settings import check_settings, first_failure
from deltact_fab.common import DeltactFabError, InputError, StageError
from deltact_fab.sensor.optics.camera import StageFrame

from . import dead_man
from .board import BOOT_S, Board, ask

REQUIRED = {10: 3, 1: 255, 13: 0, 22: 1, 21: 1, 20: 1}  # the last two need homing
SETTINGS = {
    24: 600, 25: 1500, 26: 20, 27: 1, 100: 800, 101: 800, 102: 800, 110: 1500, 111: 1500,
    112: 1200, 120: 50, 121: 50, 122: 50, 130: 120, 131: 120, 132: 60, 23: 0, **REQUIRED,
}  # fmt: skip
NEEDS = StageConfig(
    origin_machine_mm=(0.0,) * 3, travel_mm=(62.0, 62.0, 42.0), max_feed_mm_min=(600.0,) * 3,
    acceleration_mm_s2=(10.0,) * 3,
)  # fmt: skip


def parse(words: list[str], folder: Path) -> tuple[Board, dict[int, float], int]:
    """The board, the settings to write, the trials of a fault. Raises InputError."""
    try:
        pairs, words = getopt(words, "", ["stdio", "tty=", "settings=", "steps=", "moments="])
    except GetoptError as why:
        raise InputError(f"{why}; see --help") from None
    options = {"--steps": "carriage", "--moments": f"{dead_man.MOMENTS}", **dict(pairs)}
    terminal, moments = options.get("--tty", ""), options["--moments"]
    texts = " ".join(value for name, value in pairs if name == "--settings").split()
    for text in texts:
        if not re.fullmatch(r"\d+=-?\d+(\.\d*)?", text):
            raise InputError(f"--settings: must be N=VALUE, two numbers (got {text!r})")
    if not moments.isdecimal():
        raise InputError(f"--moments: must be a whole number (got {moments!r})")
    settings = {int(n): float(value) for n, value in (text.split("=") for text in texts)}
    if bool(words) == bool(terminal) or ("--stdio" in options and terminal):
        raise InputError("must be PROGRAM [ARG...] or --tty PATH, one of them; see --help")
    program = words[:1] and shutil.which(words[0])
    if program is None:
        raise InputError(f"{words[0]}: no such program")
    words[:1] = [str(Path(program).resolve())] if program else []
    board = Board(words, terminal, "--stdio" in options, folder, options["--steps"])
    return board, (REQUIRED if terminal else SETTINGS) | settings, int(moments)


def needs(board: Board) -> StageConfig:
    """Ours, with the directions of its axes."""
    masks = {"direction_mask": 3, "homing_direction_mask": 23}
    return NEEDS.model_copy(update={key: int(board.settings.get(n, 0)) for key, n in masks.items()})


def beliefs(board: Board, hal: bool) -> Iterator[tuple[str, str]]:
    """Each belief, and what came of it."""

    def look(what: Callable[[GrblStage], str]) -> str:
        frame = StageFrame((-60.0, -60.0, -40.0))
        with (
            board.powered() as url,
            closing(GrblStage(url, WallClock(), frame, config=needs(board))) as stage,
        ):
            try:
                return what(stage)
            except StageError as why:
                return f"WRONG: {why}"

    def unlocked(stage: GrblStage) -> str:
        try:
            stage.connect()
        except StageError as why:
            return f"{'' if 'not locked at start' in str(why) else 'WRONG: '}{why}"
        return "WRONG: connected"

    if hal and not board.terminal:
        yield "boots Idle, unlocked: refused", look(unlocked)
    if hal:
        board.change({22: 5})

    def unhomed(stage: GrblStage) -> str:
        stage.connect()
        state = stage.report().state
        if board.terminal and state == "Idle":
            return "not measured: homed before, and not restarted when its port is opened"
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
            stage.start_move(target, min(1200.0, *(board.settings[n] for n in (110, 111, 112))))
            slowest_s = max(slowest_s, time.monotonic() - start_s)
            stage.wait()
        text = f"at {stage.position_mm()}, a jog answered within {slowest_s:.2f} s"
        if (z_mm := board.height_mm()) is None:
            return f"{text}; by its own report"
        off_mm = z_mm - stage.report().machine_mm[2]
        wrong = "WRONG: " if abs(off_mm) > 0.02 else ""  # more than its switch scatters
        return f"{wrong}{text}, its carriage {off_mm:+.3f} mm off"

    yield "homed and moved", look(moves)


def run(board: Board, settings: dict[int, float], moments: int) -> bool:
    """Change the settings, look, print; True where a belief is wrong."""
    with board.wire() as wire:
        wire.write(SOFT_RESET)
        time.sleep(BOOT_S)
        info = [line for line in ask(wire, "$I") if re.match(r"\[(?!MSG)|Grbl", line, re.I)]
        matches = (SETTING_PATTERN.match(line) for line in ask(wire, "$$"))
        before = {int(match[1]): float(match[2]) for match in matches if match}
    hal = "grblHAL" in " ".join(info)
    board.settings = before | settings
    lock = {22: 5} if hal else {}
    if refusal := first_failure(check_settings(board.settings | lock, info, needs(board))):
        raise InputError(f"with --settings: {refusal}")
    wrong = False
    try:
        board.change(settings)
        about = ("firmware", " ".join(info))
        for belief, answer in chain([about], beliefs(board, hal), dead_man.rows(board, moments)):
            wrong |= answer.startswith("WRONG")
            print(f"| {belief} | {answer} |", flush=True)
    finally:
        if board.terminal:
            board.change({n: before[n] for n in settings if n in before})
    return wrong


def main() -> None:
    """Exit code 1 where a belief is wrong or nothing answers, 2 for bad use."""
    if sys.argv[1:2] == ["--help"]:
        raise SystemExit(print(__doc__))
    with tempfile.TemporaryDirectory() as name:
        try:
            raise SystemExit(run(*parse(sys.argv[1:], Path(name))))
        except DeltactFabError as why:
            print(why, file=sys.stderr)
            raise SystemExit(why.exit_code) from None


if __name__ == "__main__":
    main()
