"""A stranger's run folder: nothing outside it is written, nothing hangs, a line tells why."""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
import subprocess
import sys
from collections import Counter
from contextlib import closing
from pathlib import Path

import pytest
import strange_folder
from called import called
from short_run import ShortRun
from strange_folder import (
    CASES,
    COMMANDS,
    link_to_victim,
    outcome,
    png_of,
    replaced,
    spoiled,
    whole,
)

from deltact_fab.bench.record import journal
from deltact_fab.bench.record.check import check_run
from deltact_fab.bench.record.folder import MAX_RUN_FILE_BYTES, UnsafeFile, open_file
from deltact_fab.bench.record.images import decode, encode, image_size_px
from deltact_fab.bench.record.notes import RunNote
from deltact_fab.bench.record.run import open_run
from deltact_fab.common.errors import InputError

CHECK, SHOW, CSV = ("record", "check", "RUN"), ("record", "show", "RUN"), COMMANDS[3]
# The command that meets a case soonest; `record check` calls it damage where only run.json is bad.
MEETS = {
    "run.json": CHECK, "protocol.toml": CHECK, "journal.sqlite": CHECK, "images/*.png": CHECK,
    "truth": CHECK, "summary.json": SHOW, "notes": SHOW, "camera": SHOW, "mm_per_px": SHOW,
    "optics": SHOW, "run.json many": SHOW, "run.json flat": SHOW, "run.json faults": SHOW,
    "run.json nested": SHOW, "image": CHECK, "png": ("measure", "RUN"),
    "camera 10^8 px": ("measure", "RUN"), "camera other": ("measure", "RUN"),
    "truth shape": ("analyze", "tracking", "RUN", "--method", "dis-fast/static"),
}  # fmt: skip
SLOW_CASES = {"png 60000", "truth shape", "truth unpacks", "chunk unpacks", "run.json large"}


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> ShortRun:
    return ShortRun(tmp_path_factory.mktemp("tiny"))


def command_of(case: str) -> tuple[str, ...]:
    """By the longest beginning of its name."""
    names = [name for name in MEETS if case.startswith(name)]
    return MEETS[max(names, key=len)] if names else CHECK


@pytest.mark.parametrize(
    "case", [pytest.param(c, marks=[pytest.mark.slow] * (c in SLOW_CASES)) for c in CASES]
)
def test_strange_file_is_refused(tiny: ShortRun, tmp_path: Path, case: str) -> None:
    run, victim = spoiled(tiny.finished, tmp_path / "home", case)
    code, text = outcome(command_of(case), run, tmp_path / "out")
    if case == "truth shape":  # damage, not a bomb: no more is read than there is
        assert code == 1, text
        return
    assert (code, text.count("\n")) == (2, 1), text
    assert whole(victim)


@pytest.mark.slow
def test_no_command_hangs_or_swells(tiny: ShortRun, tmp_path: Path) -> None:
    """Every command on every case; those that do not need the file may end well."""
    homes = []
    for case in CASES:
        homes.append(tmp_path / case.replace("/", "_"))
        spoiled(tiny.finished, homes[-1], case)
    words = [sys.executable, strange_folder.__file__, *map(str, homes)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert Counter(row[0] for row in rows).keys() == {home.name for home in homes}
    for case, command, code, text, swell_mb in rows:
        assert code in (0, 1, 2), (case, command, text)
        assert "Traceback" not in text, (case, command, text)
        if code == 1:
            assert "DAMAGED" in text or case == "truth shape", (case, command, text)
        # The commands alone take 160 with what they import, 300,000 faults 220; 700 are unpacked.
        assert swell_mb < 400, (case, command)
    assert all(whole(home / "victim") for home in homes)


@pytest.mark.parametrize(
    "name",
    ["images", "truth", "analysis", "notes.jsonl", "run.json", "tool.json", "journal.sqlite-wal"],
)
def test_resume_touches_nothing_outside(tiny: ShortRun, tmp_path: Path, name: str) -> None:
    spoil, victim = tmp_path / "home", tmp_path / "home" / "victim"
    spoiled(tiny.finished, spoil, "trigger")
    run = tiny.unfinished(tmp_path / "run", tiny.presses[-1])
    replaced(name, link_to_victim)(run, victim)
    done = called(*tiny.words(run, "--resume", "--note", "x"))
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert f"{name}: is a symbolic link" in done.stderr
    assert whole(victim)


@pytest.mark.parametrize("case", ["trigger", "view", "endless table", "rollback"])
def test_resume_refuses_strange_journal(tiny: ShortRun, tmp_path: Path, case: str) -> None:
    run, victim = spoiled(tiny.finished, tmp_path / "home", case)
    (run / "summary.json").unlink()
    code, text = outcome(tuple(tiny.words(run, "--resume")), run, tmp_path)
    assert (code, text.count("\n")) == (2, 1), text
    assert whole(victim)


def test_sqlite_deletes_what_it_names(tiny: ShortRun, tmp_path: Path) -> None:
    """The danger that `rollback` stands for is real: SQLite alone takes the victim's file."""
    run, victim = spoiled(tiny.finished, tmp_path / "home", "rollback")
    with closing(sqlite3.connect(run / "journal.sqlite")) as db:
        db.execute("SELECT count(*) FROM sqlite_master")
    assert not (victim / "a.png").exists()


def test_linked_run_folder_is_read(tiny: ShortRun, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tiny.finished.parent)
    (tmp_path / "run").symlink_to(tiny.finished)
    assert check_run(tmp_path / "run").intact
    assert check_run(tmp_path / "link" / tiny.finished.name).intact


def test_file_below_is_opened_alone(tmp_path: Path) -> None:
    (tmp_path / "run" / "images").mkdir(parents=True)
    (tmp_path / "run" / "images" / "a.png").write_bytes(b"a")
    (tmp_path / "b.png").write_bytes(b"b")
    with open_file(tmp_path / "run", "images/a.png") as file:
        assert file.read() == b"a"
    for name in ("../b.png", str(tmp_path / "b.png"), "images/../../b.png"):
        with pytest.raises(UnsafeFile, match="below the run folder"):
            open_file(tmp_path / "run", name)
    (tmp_path / "run" / "c.json").touch()
    os.truncate(tmp_path / "run" / "c.json", MAX_RUN_FILE_BYTES[".json"] + 1)
    with pytest.raises(UnsafeFile, match="at most 8 MiB"):
        open_file(tmp_path / "run", "c.json")


@pytest.mark.parametrize("suffix", ["png", "jxl"])
def test_size_is_read_from_header(suffix: str) -> None:
    import numpy as np

    for w, h in [(1, 1), (160, 120), (8, 256), (257, 300), (1280, 720), (9000, 3), (300, 200)]:
        data = encode(np.zeros((h, w, 3), np.uint8), suffix)
        assert image_size_px(data) == (w, h)
    head = png_of(60_000, 60_000)
    if suffix == "jxl":  # no eighths, 30 bits of height, no ratio, 30 bits of width
        bits = 3 << 1 | 59_999 << 3 | 3 << 36 | 59_999 << 38
        head = b"\xff\x0a" + bits.to_bytes(12, "little")
    assert image_size_px(head) == (60_000, 60_000)
    with pytest.raises(UnsafeFile, match="at most 50 million"):
        decode(head, f"a.{suffix}")


def test_full_notes_refuse_another(tiny: ShortRun, tmp_path: Path) -> None:
    run = shutil.copytree(tiny.finished, tmp_path / "run")
    (run / "notes.jsonl").write_bytes(b"\n" * (MAX_RUN_FILE_BYTES[".jsonl"] - 10))
    with pytest.raises(InputError, match="full"):
        RunNote("one more").add_to(run)
    assert open_run(run).finished


def test_sound_journal_needs_few_steps(tiny: ShortRun, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journal, "STEPS_PER_BYTE", journal.STEPS_PER_BYTE / 8)
    monkeypatch.setattr(journal, "MIN_JOURNAL_STEPS", journal.MIN_JOURNAL_STEPS / 8)
    assert check_run(tiny.finished).intact
    open_run(tiny.finished).frames()
