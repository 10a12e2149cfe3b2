"""One way of asking on every command: for JSON, for a file, for a name, for help in a shell."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import click
import pytest

from benchmarks.reference import commands
from deltact_fab.app.cli import options, output
from deltact_fab.app.cli.main import main
from deltact_fab.common import files
from deltact_fab.common.errors import InputError

LEAVES = {c.command_path: (c, one) for c, one in commands() if not isinstance(one, click.Group)}


def test_output_options_are_uniform() -> None:
    for path, (_, command) in LEAVES.items():
        by_name = {flag: p for p in command.params for flag in p.opts}
        assert by_name["--json"].is_flag, path
        assert by_name["--json"].help.startswith("Print JSON"), path
        assert "--output" not in by_name, path
        for flag, metavar in (("-o", "FILE"), ("--out", "DIR"), ("--seed", "N")):
            if flag in by_name:
                assert by_name[flag].metavar == metavar, (path, flag)
                free = flag == "--seed" or path == "deltact-fab run"  # a finished one is read only
                assert free or by_name[flag].callback.__name__ == "writable", path
        if "--seed" in by_name:
            assert by_name["--seed"].type is options.SEED_TYPE, path


@pytest.mark.parametrize(
    ("folder", "place", "says"),
    [
        (False, "held", "held: is a folder; expected a file name"),
        (False, "gone/x.toml", "gone/x.toml: no folder gone; create it first"),
        (False, "locked/x.toml", "locked/x.toml: cannot be written: locked is read-only"),
        (True, "file", "file: is a file, not a folder"),
        (True, "file/x/y", "file: is a file, not a folder"),
        (True, "locked/x", "locked/x: cannot be written: .*locked is read-only"),
    ],
)
def test_unwritable_output_is_refused_first(
    folder: bool, place: str, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("held", "locked"):
        Path(name).mkdir()
    Path("file").write_text("")
    # The superuser, who may write everywhere, is told so of no folder.
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path).name != "locked")
    with pytest.raises(InputError, match=says):
        files.check_writable(Path(place), folder)
    assert sorted(p.name for p in Path().iterdir()) == ["file", "held", "locked"]


def test_help_examples_are_commands() -> None:
    shown = [one.epilog for _, one in LEAVES.values() if one.epilog]
    assert len(shown) > 20
    for example in shown:
        typed = re.sub(r'^Example: (eval "\$\()?deltact-fab |\)"$', "", example)
        words = shlex.split(typed)
        command: click.Command = main
        context = click.Context(main)
        while isinstance(command, click.Group):
            name = words.pop(0)
            inner = command.get_command(context, name)
            assert inner is not None, example
            command, context = inner, click.Context(inner, context, **inner.context_settings)
        command.parse_args(context, words)


def test_narrow_terminal_table_is_complete(monkeypatch: pytest.MonkeyPatch) -> None:
    columns = ("item", "note", *(f"f{i}_mm" for i in range(4)))
    rows = [("a", "[some] words that go on and on", *[0.5] * 4), ("b", "", *[12.25] * 4)]
    wide = list(output.table(columns, rows))
    assert [line.split()[0] for line in wide] == ["item", "a", "b"]
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("COLUMNS", "50")
    narrow = list(output.table(columns, rows))
    assert max(map(len, narrow)) <= 50
    assert sorted(" ".join(narrow).split()) == sorted(" ".join(wide).split())


def test_progress_lines_without_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with output.progress("quick") as tick:
        tick(1, 2, "")
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(output, "LINE_EVERY_S", 0.0)
    with output.progress("slow") as tick:
        tick(1, 3, "one")
        tick(3, 3, "three")
    told = capsys.readouterr()
    assert told.err.splitlines() == ["slow: 0 s: 1 of 3, one", "slow: 0 s: 3 of 3, three"]
    assert told.out == ""


def test_numbers_have_useful_digits() -> None:
    lines = output.table(
        ("a", "b", "c", "d"),
        [(0.30000000000000004, 1e-17, 76777.25, True), (12.0, 1.0, 1.0, False)],
    )
    assert [line.split() for line in lines][1:] == [
        ["0.30", "0", "76777", "yes"],
        ["12.00", "1.000", "1", "no"],
    ]


def test_no_color_is_respected(tmp_path: Path) -> None:
    """On a pseudo terminal, with NO_COLOR."""
    code = (
        "import time\nfrom deltact_fab.app.cli.output import progress\n"
        "with progress('work') as tick:\n    tick(1, 2, 'half')\n    time.sleep(0.3)\n"
    )
    leader, follower = os.openpty()
    environment = {k: v for k, v in os.environ.items() if k != "FORCE_COLOR"}
    environment |= {"TERM": "xterm-256color", "NO_COLOR": "1"}
    subprocess.run([sys.executable, "-c", code], stderr=follower, env=environment, check=True)
    os.close(follower)
    drawn = b""
    try:
        while chunk := os.read(leader, 4096):
            drawn += chunk
    except OSError:  # the other end is closed
        pass
    os.close(leader)
    assert b"1/2" in drawn
    assert b"\x1b[38;5;" not in drawn


@pytest.mark.slow
def test_ctrl_c_is_130(tmp_path: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-m", "deltact_fab.app.cli.main", "measure", "virtual:smoke", "--json"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=tmp_path, start_new_session=True,
    ) as process:  # fmt: skip
        assert process.stderr is not None
        process.stderr.readline()  # the first result
        os.killpg(process.pid, signal.SIGINT)
        out, _ = process.communicate(timeout=60)
    assert process.returncode == 130
    assert b'"ended": "stopped"' in out


def test_failure_after_ctrl_c_is_reported(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A lift that failed is not hidden behind the word that it was stopped."""
    from deltact_fab.app.cli import main as program
    from deltact_fab.common.errors import StageError

    def stopped(**options: object) -> None:
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as why:
            raise StageError("the tip could not be lifted") from why

    monkeypatch.setattr(program, "main", stopped)
    with pytest.raises(SystemExit) as ended:
        program.entry()
    assert ended.value.code == 1
    assert capsys.readouterr().err == "deltact-fab: the tip could not be lifted\n"


def test_quantities_need_their_unit() -> None:
    for text, base, value in (
        ("8N", "N", 8.0), ("80 mN", "N", 0.08), ("90min", "s", 5400.0), ("1.5e1%", "%", 15.0),
    ):  # fmt: skip
        assert options.Quantity(base).convert(text, None, None) == pytest.approx(value)
    for text in ("8", "8kN", "-8N", "0N", "nanN", "infN", "N", "8 N m", "", "8%"):
        with pytest.raises(click.BadParameter, match="must be a positive number with N or mN"):
            options.Quantity("N").convert(text, None, None)
