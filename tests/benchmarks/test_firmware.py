"""The bench for firmware on the simulated board: its three ways in, depth, bad use in one line."""

from __future__ import annotations

import os
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from benchmarks.firmware import __main__ as bench
from benchmarks.firmware import board as boards
from benchmarks.firmware.board import Board, ask
from benchmarks.firmware.dead_man import FACE_MM, Relay
from deltact_fab.bench.rig.interface import WallClock
from deltact_fab.common import InputError
from deltact_fab.simulate.virtual.controller import GrblController
from deltact_fab.simulate.virtual.pty import PtyCable

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals")
QUICK = {1: 25, 24: 1200, 25: 6000, 26: 5, 27: 1, 110: 6000, 111: 6000, 112: 6000, 120: 2000,
         121: 2000, 122: 2000, 130: 120, 131: 120, 132: 60}  # fmt: skip
PROGRAM = """
import os, select, socket, sys
from deltact_fab.bench.rig.interface import WallClock
from deltact_fab.simulate.virtual.controller import GrblController
grbl, (come, go) = GrblController({}, WallClock(), boot_s=0.0), (0, 1)
if sys.argv[1:]:
    server = socket.create_server(("127.0.0.1", int(sys.argv[-1].lstrip("p"))))
    come = go = server.accept()[0].detach()
data = b""
while b"\\x06" not in data:
    data = os.read(come, 100) if select.select([come], [], [], 0.01)[0] else b""
    grbl.write(data)
    os.write(go, grbl.read_available())
"""


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[PtyCable]:
    monkeypatch.setattr(boards, "BOOT_S", 0.2)
    monkeypatch.setattr(bench, "BOOT_S", 0.5)
    clock = WallClock()
    with PtyCable(GrblController(QUICK, clock, start_mm=(-2, -2, -2), boot_s=0.1), clock) as cable:
        yield cable


def board(folder: Path, *words: str, terminal: str = "", stdio: bool = False) -> Board:
    return Board(list(words), terminal, stdio, folder, "steps", {102: 800})


@pytest.mark.slow
@pytest.mark.parametrize("last", ["", "--stdio", "p{port}"])
def test_program_serves_port_or_stdio(last: str, tmp_path: Path) -> None:
    (tmp_path / "grbl.py").write_text(PROGRAM)
    words = [sys.executable, "grbl.py", *([last] if "{" in last else [])]
    with board(tmp_path, *words, stdio=last == "--stdio").wire() as wire:
        assert "[VER:1.1h" in "".join(ask(wire, "$I"))


@pytest.mark.parametrize(
    ("data", "z_mm"),
    [
        (np.array([8, 8, -1600], "<i4").tobytes(), -2.0),
        (b"# block number 3\n     1.25000 1, -2, -800, 0\n     1.26 1, -2, -80", -1.0),
        (b"", None),
    ],
)
def test_height_is_the_last_step(data: bytes, z_mm: float | None, tmp_path: Path) -> None:
    assert board(tmp_path).height_mm() is None
    (tmp_path / "steps").write_bytes(data)
    assert board(tmp_path).height_mm() == z_mm


def test_relay_reports_depth_unheard(terminal: PtyCable, tmp_path: Path) -> None:
    relay = Relay(board(tmp_path, terminal=terminal.port), terminal.port)
    port = int(relay.url.rpartition(":")[2])
    with socket.create_connection(("127.0.0.1", port), 2) as host:
        time.sleep(0.3)
        host.sendall(b"?$I\n?")
        time.sleep(0.3)
        heard = host.recv(4096)
        relay.lose = b"ok"
        host.sendall(b"$I\n")
        time.sleep(0.2)
        assert b"ok" not in host.recv(4096)
        relay.mute = True
        host.sendall(b"$I\n?")
        relay.pulled = True
        assert host.recv(4096) == b""
    at_s, depth_mm = relay.depth()
    relay.close()
    assert 1 <= heard.count(b"<") <= 2
    assert heard.count(b"ok") == 1
    assert depth_mm == pytest.approx(FACE_MM - 0.0, abs=1e-3)
    assert time.monotonic() - at_s < 1


def test_unfit_settings_are_refused_unwritten(terminal: PtyCable, tmp_path: Path) -> None:
    before = dict(terminal.controller.settings)
    words = ["--tty", terminal.port, "--settings", "24=900 132=30"]
    with pytest.raises(InputError, match=r"--settings: Z has 30 mm of travel \(\$132\); 42 needed"):
        bench.run(*bench.parse(words, tmp_path))
    assert terminal.controller.settings == before


@pytest.mark.slow
def test_beliefs_hold_on_a_terminal(
    terminal: PtyCable, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = dict(terminal.controller.settings)
    words = ["--tty", terminal.port, "--settings", "24=1100 120=1900", "--moments", "0"]
    assert not bench.run(*bench.parse(words, tmp_path))
    rows = capsys.readouterr().out.splitlines()
    assert [row.split(" |")[0] for row in rows] == [
        "| firmware", "| locked until it was homed", "| homed and lifted at the top three times",
        "| homed and moved",
    ]  # fmt: skip
    assert "Grbl 1.1h" in rows[0]
    assert rows[-1].endswith("by its own report |")
    assert terminal.controller.settings == before


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ("", "PROGRAM [ARG...] or --tty PATH"),
        ("--tty /dev/null ls", "one of them"),
        ("--tty /dev/null --stdio", "one of them"),
        ("--tty /none", "/none: no answer"),
        ("--tty /dev/null", "/dev/null: no answer"),
        ("no-such-program", "no-such-program: no such program"),
        ("--settings 100 ls", "N=VALUE"),
        ("--settings 100=x ls", "N=VALUE"),
        ("--moments -1 ls", "--moments"),
        ("--wire ls", "--wire"),
        ("--stdio true", "true: no answer"),
    ],
)
def test_bad_use_is_one_line(
    words: str, text: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["firmware", *words.split()])
    monkeypatch.setattr(boards, "BOOT_S", 0.1)
    monkeypatch.setattr(bench, "BOOT_S", 0.1)
    with pytest.raises(SystemExit) as end:
        bench.main()
    out, line = capsys.readouterr()
    assert (out, line.count("\n"), text in line) == ("", 1, True), line
    assert end.value.code == (1 if "no answer" in text else 2)
