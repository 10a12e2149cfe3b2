"""`rig status|home|jog|goto|reset` on a simulated board behind a real terminal."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from called import started
from click.testing import CliRunner

from deltact_fab.app.cli.rig import rig
from deltact_fab.bench.rig.interface import WallClock
from deltact_fab.common.errors import DeltactFabError, InputError, StageError
from deltact_fab.simulate.virtual.controller import GrblController
from deltact_fab.simulate.virtual.pty import PtyCable

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals"),
    pytest.mark.usefixtures("no_boot_loader"),
]

QUICK = {1: 255, 24: 1200, 25: 1200, 26: 5, 27: 0.2, 120: 2000, 121: 2000, 122: 2000}
FILE = """
kind = "grbl"
[stage]
port = "{port}"
origin_machine_mm = [-10.0, -10.0, -12.0]
travel_mm = [120.0, 120.0, 60.0]
max_feed_mm_min = [1500.0, 1500.0, 1200.0]
acceleration_mm_s2 = [2000.0, 2000.0, 2000.0]
"""


class Bench:
    """A rig file whose port is a board that does not restart on opening."""

    def __init__(self, terminal: PtyCable, file: Path) -> None:
        self.terminal, self.file = terminal, file

    def does(self, *words: str) -> Any:
        """A command's JSON. Raises what the command raises."""
        name, *rest = words
        result = CliRunner().invoke(rig, [name, str(self.file), *rest, "--json"])
        if result.exception is not None:
            raise result.exception
        return json.loads(result.stdout)

    def prints(self, *words: str) -> str:
        name, *rest = words
        result = CliRunner().invoke(rig, [name, str(self.file), *rest])
        return result.output

    def at_mm(self) -> tuple[float, float, float]:
        with self.terminal.lock:
            return self.terminal.controller.position_mm()

    def segments(self) -> list[Any]:
        with self.terminal.lock:
            return list(self.terminal.controller.segments)


@contextmanager
def bench(folder: Path, settings: dict[int, float] | None = None) -> Iterator[Bench]:
    clock = WallClock()
    grbl = GrblController({**QUICK, **(settings or {})}, clock, start_mm=(-1, -1, -1), boot_s=0.1)
    with PtyCable(grbl, clock) as terminal:
        file = folder / "bench.toml"
        file.write_text(FILE.format(port=terminal.port))
        yield Bench(terminal, file)


def test_misconfigured_board_is_not_homed(tmp_path: Path) -> None:
    with bench(tmp_path, {21: 0, 3: 1}) as it:
        text = it.prints("probe")  # its old name
        assert "is now `deltact-fab rig check`" in text
        told = [line for line in text.splitlines() if line.startswith("FAIL  stage")]
        assert ["$21=0" in told[0], "$3=1" in told[1], len(told)] == [True, True, 2]
        with pytest.raises(StageError, match=r"\$21=0 .* set \$21=1 .*\(and 1 more"):
            it.does("home", "--yes", "--tip-is-clear")
        assert it.segments() == []


@pytest.mark.slow
def test_home_jog_goto(tmp_path: Path) -> None:
    with bench(tmp_path) as it:
        with pytest.raises(
            StageError, match="controller locked, position lost: run `rig home` first"
        ):
            it.does("jog", "0", "0", "1")
        with pytest.raises(StageError, match="give --tip-is-clear"):
            it.does("home", "--yes")
        with pytest.raises(SystemExit):
            it.does("home")  # nobody answers
        assert it.segments() == []
        said = it.does("home", "--yes", "--tip-is-clear")
        assert said["state"]["sensor_mm"] == pytest.approx([9.8, 9.8, 11.8])
        assert "position known: lifted" in it.does("home", "--yes")["how"]

        said = it.does("jog", "-1", "-2.5", "-3", "--feed", "1200")
        assert said["sensor_mm"] == pytest.approx([8.8, 7.3, 8.8])
        said = it.does("goto", "0", "0", "6", "--as-counted", "--feed", "1200")
        assert said["sensor_mm"] == pytest.approx([0, 0, 6])
        assert it.does("status")["machine_mm"] == pytest.approx([-10, -10, -6])
        assert it.prints("status") == (
            "Idle, x 0.000, y 0.000, z 6.000 mm (sensor); machine -10.000, -10.000, -6.000\n"
        )


@pytest.fixture(scope="module")
def waiting(no_boot_loader: None, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    """Homed, 6 mm over the face."""
    with bench(tmp_path_factory.mktemp("waiting")) as it:
        it.does("home", "--yes", "--tip-is-clear")
        it.does("goto", "0", "0", "6", "--as-counted", "--feed", "1200")
        yield it


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("jog", "0", "11", "0"), "11 mm exceeds 10 mm; give --most 11"),
        (("jog", "0", "0", "-2"), "z = 4 mm is below 5 mm above the face.*give --into-gel"),
        (("jog", "0", "0", "8"), r"target Z 2\.000 mm \(machine\) is outside"),
        (("jog", "1", "0", "0", "--feed", "9000"), "feed 9000 mm/min moves X"),
        (("goto", "0", "0", "4", "--as-counted"), "z = 4 mm is below 5 mm"),
        (("goto", "0", "0", "6"), "give either --home or --as-counted"),
        (("goto", "0", "500", "6", "--as-counted"), "target Y .* is outside"),
    ],
)
def test_what_is_refused_moves_nothing(words: tuple[str, ...], said: str, waiting: Bench) -> None:
    before = len(waiting.segments())
    with pytest.raises(InputError, match=said) as why:
        waiting.does(*words)
    assert "\n" not in str(why.value)
    assert len(waiting.segments()) == before


@pytest.mark.slow
def test_into_gel_needs_flag(tmp_path: Path) -> None:
    with bench(tmp_path) as it:
        it.does("home", "--yes", "--tip-is-clear")
        it.does("goto", "0", "0", "4.7", "--as-counted", "--into-gel", "--feed", "1200")
        last = [s for s in it.segments() if s.block == it.segments()[-1].block]  # in pieces
        assert (last[0].start_mm[2], last[-1].end_mm[2]) == pytest.approx((-7.0, -7.3))
        assert last[-1].end_ns - last[0].start_ns > 0.5e9  # slow: 30 mm/min
        with pytest.raises(InputError, match="below 5 mm"):
            it.does("jog", "1", "0", "0")
        it.does("goto", "2", "0", "6", "--as-counted", "--feed", "1200")
        across = [s for s in it.segments() if s.start_mm[0] != s.end_mm[0]][-1]
        assert across.start_mm[2] == across.end_mm[2] == pytest.approx(-7.0)
        it.does("jog", "0", "0", "0.5")


@pytest.mark.slow
def test_reset_of_a_deaf_board(tmp_path: Path) -> None:
    with bench(tmp_path) as it:
        it.does("home", "--yes", "--tip-is-clear")
        with it.terminal.lock:
            it.terminal.controller.fault("limit")
        time.sleep(0.7)
        assert it.does("reset")["banner"] == "Grbl 1.1h ['$' for help]"
        assert it.does("status")["state"] == "Alarm"


@pytest.mark.slow
def test_ctrl_c_stops_a_jog(tmp_path: Path) -> None:
    with bench(tmp_path) as it:
        it.does("home", "--yes", "--tip-is-clear")
        before = len(it.segments())
        words = ["rig", "jog", str(it.file), "-10", "0", "0", "--feed", "60"]
        code = "from deltact_fab.app.cli.main import entry; entry()"
        with started("-c", code, *words, stderr=subprocess.PIPE) as host:
            deadline = time.monotonic() + 30
            while len(it.segments()) == before and time.monotonic() < deadline:
                time.sleep(0.02)
            host.send_signal(signal.SIGINT)
            _, err = host.communicate(timeout=30)
        assert host.returncode == 130
        assert err.startswith("deltact-fab: stopped by the operator; the tip was raised by 0.00 mm")
        assert "no force reading at x " in err
        assert len(err.splitlines()) == 1
        at_mm = it.at_mm()
        assert -10 < at_mm[0] < -0.2
        assert it.does("status")["state"] == "Idle"
        assert it.at_mm() == at_mm


@pytest.mark.parametrize("words", [("status",), ("jog", "0", "0", "1"), ("reset",)])
def test_virtual_rig_has_no_stage(words: tuple[str, ...]) -> None:
    result = CliRunner().invoke(rig, [words[0], "virtual", *words[1:]])
    assert isinstance(result.exception, DeltactFabError)
    assert str(result.exception).endswith("kind: a 'virtual' rig has no stage; use a 'grbl' rig")
