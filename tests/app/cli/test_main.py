"""The command line as a user meets it: quick help, one line for an error, exit codes."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest
from called import called

from benchmarks.reference import commands
from deltact_fab.app.cli import main as program
from deltact_fab.common.errors import InputError, RunFailed
from deltact_fab.studies.study.registry import STUDIES

BENCH = """
kind = "grbl"
[stage]
port = "/dev/not-there"
origin_machine_mm = [-60.0, -60.0, -40.0]
travel_mm = [120.0, 120.0, 60.0]
max_feed_mm_min = [1500.0, 1500.0, 1200.0]
acceleration_mm_s2 = [2000.0, 2000.0, 2000.0]
[force]
range_n = [25.0, 25.0, 35.0]
[force.netft]
host = "127.0.0.1"
"""
HEAVY = ("cadquery", "OCP", "scipy.sparse", "matplotlib", "pandas", "cv2", "numpy",
         "serial", "pydantic", "numba")  # fmt: skip
ASK = """
import sys
from deltact_fab.app.cli.main import entry
for words in {words!r}:
    sys.argv = ["deltact-fab", *words, "--help"]
    try:
        entry()
    except SystemExit as end:
        assert end.code == 0, words
print("@@", [m for m in {heavy!r} if m in sys.modules])
"""


def test_help_imports_nothing_heavy() -> None:
    words = [path.split()[1:] for path in (context.command_path for context, _ in commands())]
    words = [[], *words, *(["study", "run", name] for name in STUDIES)]
    script = ASK.format(words=words, heavy=HEAVY)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.count("Usage: deltact-fab") == len(words) > 60
    assert done.stdout.rsplit("@@", 1)[1].strip() == "[]"


@pytest.mark.parametrize(
    ("old", "now"),
    [
        ("calibrate .", "calibrate lens ."),
        ("cad designs --jsno", "cad list designs --jsno"),
        ("pattern from DELTACT1/NONSENSE -o x.png", "pattern make DELTACT1/NONSENSE -o x.png"),
        ("study index none", "report none"),
        ("rig probe none", "rig check none"),
        ("calibrate --air . --board skin", "calibrate lens --air . --board skin"),
        ("calibrate-depth none", "calibrate depth none"),
        ("analyze force none", "calibrate force none"),
    ],
)
def test_moved_command_works_with_notice(old: str, now: str, tmp_path: Path) -> None:
    done, same = (called(*words.split(), cwd=tmp_path) for words in (old, now))
    told, left = done.stderr.split("\n", 1)
    new = told.split("`")[3]
    assert now.startswith(new.removeprefix("deltact-fab "))
    assert told.endswith(f"is now `{new}`; the old name is removed in 0.4")
    assert (left, done.returncode) == (same.stderr, 2)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("protocol check smok", "did you mean 'smoke'?"),
        ("protocol show missing.toml", "missing.toml: no such file"),
        ("run smoke --rig vurtual --out x", "did you mean 'virtual'?"),
        ("run smoke", "--out"),
        ("run first-moves --air --out r --seed -1", "-1"),
        ("run first-moves --air --out r --note \x01", "is not printable"),
        ("gel press --indenter cube --depth 1", "valid: sphere:DIAMETER_MM"),
        ("gel press --depth 1 --limit-s 0", "more than 0 seconds"),
        ("gel press --depth 1 --poisson 0.6", "poisson"),
        ("gel press --depth 1 --at 3", "two numbers"),
        ("analyze tracking .", "not a run folder"),
        ("report nowhere", "nowhere: no such folder"),
        ("analyse", "no such command; did you mean 'analyze'?"),
        ("cad exprt", "no such command; did you mean 'export'?"),
        ("cad show shell --desing x", "Did you mean '--design'?"),
        ("cad show shel", "did you mean 'shell'?"),
        ("cad check --set skin.widht_mm=3", "did you mean 'width_mm'?"),
        ("cad check --design=", "--design: empty"),
        ("cad export --set skin.width_mm=24 --set skin.length_mm=24", "room between the posts"),
        ("cad export --format obj", "format 'obj': unknown"),
        ("cad export skin --tolerance nan", "expected 0.001 to 1 mm"),
        ("cad bom --sensors 0", "sensors"),
        ("study run shpes", "'shpes': no such study; did you mean 'shapes'?"),
        ("pattern sheet dense -o x.jpg", "a name that ends in .pdf"),
        ("pattern sheet dense --scale-x 1.5 -o x.pdf", "scale x: 1.5"),
        ("pattern make DELTACT1/NONSENSE --dots -o x.png", "code"),
        ("pattern series --out .", "folder"),
        ("rig jog b.toml nan 0 0", "nan is not a finite number"),
        ("rig jog b.toml 0 0 500", "500 mm exceeds 10 mm; give --most 500"),
        ("rig jog b.toml 0 0 1 --feed -3", "-3"),
        ("rig goto b.toml 0 0 inf --as-counted", "inf is not a finite number"),
        ("rig check b.toml --seconds nan", "nan is not a finite number"),
        ("rig register b.toml -o f.toml --indenter 4dots", "registration needs a ball"),
        ("rig register b.toml -o f.toml --at nan,0", "must be two finite numbers"),
        ("rig register b.toml -o gone/f.toml", "no folder gone; create it first"),
    ],
)
def test_bad_input_is_one_line(words: str, says: str, tmp_path: Path) -> None:
    """Before a port is opened or a folder is made."""
    (tmp_path / "b.toml").write_text(BENCH)
    done = called(*words.split(" "), cwd=tmp_path)
    assert says in done.stderr
    assert (done.returncode, done.stderr.count("\n"), done.stdout) == (2, 1, "")
    assert [path.name for path in tmp_path.iterdir()] == ["b.toml"]


@pytest.mark.parametrize(
    ("words", "to", "code", "says"),
    [
        ("rig list --json", "/dev/full", 1, "deltact-fab: output: cannot be written: No space le"),
        ("schema protocol", "pipe", 1, ""),
    ],
)
def test_full_disk_exits_1_pipe_silent(words: str, to: str, code: int, says: str) -> None:
    read, write = os.pipe()
    os.close(read)
    with open(to if to != "pipe" else write, "w") as out:
        done = subprocess.run(
            [sys.executable, "-m", "deltact_fab", *words.split()],
            stdout=out, stderr=subprocess.PIPE, text=True, check=False, timeout=60,
        )  # fmt: skip
    assert (done.returncode, done.stderr.count("\n")) == (code, int(bool(says)))
    assert done.stderr.startswith(says)


@pytest.mark.parametrize("kind", [InputError, RunFailed])
def test_full_disk_exits_1_anywhere(kind: type[Exception], monkeypatch: pytest.MonkeyPatch) -> None:
    def full(**options: object) -> None:
        raise kind("out: cannot be written") from OSError(errno.ENOSPC, "no space")

    monkeypatch.setattr(program, "main", full)
    done = called("schema")
    assert (done.returncode, done.stderr) == (1, "deltact-fab: out: cannot be written\n")


@pytest.mark.slow
def test_failed_check_exits_1(tmp_path: Path) -> None:
    text = (Path(__file__).parents[3] / "protocols" / "smoke.toml").read_text()
    (tmp_path / "p.toml").write_text(text.replace("[1.0]", "[11.5]"))
    done = called("protocol", "check", "p.toml", cwd=tmp_path)
    assert done.returncode == 1
    row = next(line for line in done.stdout.splitlines() if "depth in the gel" in line)
    assert row.split()[:9] == ["FAIL", "depth", "in", "the", "gel", "depth", "(mm)", "11.5", "<="]
    assert ["pass", "image", "format", "refusals", "OK"] in map(str.split, done.stdout.splitlines())


@pytest.mark.slow
def test_gel_press_stops_at_limit(tmp_path: Path) -> None:
    words = ["gel", "press", "--indenter", "star", "--at", "1,0", "--depth", "3"]
    done = called(*words, "--tolerance", "0.005", "--limit-s", "0.01", cwd=tmp_path)
    assert done.returncode == 1
    assert done.stdout == ""
    # A machine that is busy for 5 s has told its progress too.
    said = [line for line in done.stderr.splitlines() if not line.startswith("gel press: ")]
    assert said == [
        "deltact-fab: --limit-s 0.01: no mesh was solved in that CPU time (nu 0.49, 3 mm deep in "
        "12 mm); increase it"
    ]
