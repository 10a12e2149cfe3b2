"""Faults of disk, files and input, met by the command line: one line, its exit code, no debris."""

from __future__ import annotations

import hashlib
import re
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
from called import called
from short_run import ShortRun

from deltact_fab.bench.record.run import open_run

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> ShortRun:
    return ShortRun(tmp_path_factory.mktemp("short"))


@pytest.fixture(autouse=True)
def _endless(monkeypatch: pytest.MonkeyPatch) -> None:
    """The run is begun although its estimate does not fit: a quota is not seen before it is met."""
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(total=2**50, free=2**50))


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Callable[[str], Path]]:
    """Call with mount options to get a file system in memory; call again to change them."""
    place = tmp_path / "disk"
    place.mkdir()
    mounted = False

    def mount(options: str) -> Path:
        nonlocal mounted
        verb = f"remount,{options}" if mounted else options
        done = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", verb, "tmpfs", str(place)],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        if done.returncode:
            pytest.skip(f"a tmpfs cannot be mounted here: {done.stderr.strip() or 'needs root'}")
        mounted = True
        return place

    yield mount
    if mounted:
        subprocess.run(["umount", str(place)], check=True)


def assert_one_line(done: subprocess.CompletedProcess[str], code: int, *words: str) -> None:
    """One line on stderr with these words, progress aside; nothing on stdout, this exit code."""
    assert done.returncode == code, done.stderr
    assert done.stdout == ""
    lines = [line for line in done.stderr.splitlines() if not line.startswith("run: ")]
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("deltact-fab: ")
    for word in words:
        assert word in lines[0]


def assert_nothing_half_written(out: Path) -> None:
    """No temporary file; every file under images/ is journalled and has its hash."""
    assert not list(out.parent.rglob(".*.part"))
    rows = open_run(out).frames()
    assert {f"images/{p.name}" for p in (out / "images").iterdir()} >= set(rows["file"])
    for row in rows.itertuples():
        data = (out / str(row.file)).read_bytes()
        assert hashlib.sha256(data).hexdigest() == row.sha256
    truth = open_run(out).truth()  # None, or every press that is there loads whole
    for frame_id in truth.frames if truth is not None else ():
        assert truth.displacement_mm(frame_id).ndim == 3


def assert_completes(short: ShortRun, out: Path) -> None:
    """The run that failed goes on to the same images as the undisturbed one."""
    short.resume(out)
    wanted, found = (open_run(p).frames()["sha256"] for p in (short.finished, out))
    assert list(found) == list(wanted)


@pytest.mark.parametrize("kib", [16, 300, 900])
def test_a_disk_that_fills_up(short: ShortRun, disk: Callable[[str], Path], kib: int) -> None:
    out = disk(f"size={kib}k") / "r"
    done = called(*short.words(out))
    assert_one_line(done, 1, str(out.parent))
    assert "No space left" in done.stderr or "disk is full" in done.stderr
    if out.exists():
        assert_nothing_half_written(out)
    else:
        assert list(out.parent.iterdir()) == []
    disk("size=64m")
    assert_completes(short, out)


@pytest.mark.parametrize(
    ("limit", "culprit"),
    [
        (20_000, "journal.sqlite"),  # as the folder is made
        (60_000, ".npz|.png|journal.sqlite"),
    ],
)
def test_a_file_that_may_not_grow(
    short: ShortRun, tmp_path: Path, limit: int, culprit: str
) -> None:
    out = tmp_path / "r"

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    # No compiled modules are written under a limit: they would be what fails.
    done = subprocess.run(
        [sys.executable, "-B", "-m", "deltact_fab.app.cli.main", *short.words(out)],
        capture_output=True, text=True, check=False, preexec_fn=limited,
    )  # fmt: skip
    assert_one_line(done, 1)
    assert re.search(culprit, done.stderr)
    if out.exists():
        assert_nothing_half_written(out)
    assert not list(tmp_path.rglob("*.part"))
    assert_completes(short, out)


def test_read_only_folder_is_refused(short: ShortRun, disk: Callable[[str], Path]) -> None:
    place = disk("size=64m")
    cut = short.unfinished(place / "cut")
    shutil.copytree(short.finished, place / "finished")
    disk("ro")
    assert_one_line(called(*short.words(place / "r")), 2, f"{place / 'r'}: cannot be written")
    assert_one_line(called(*short.words(cut, "--resume")), 2, f"{cut}: read-only")
    # What is finished needs no writing, neither to be told so nor to be read.
    assert called(*short.words(place / "finished", "--resume")).returncode == 0
    assert len(open_run(place / "finished").frames()) == 32
    assert sorted(p.name for p in place.iterdir()) == ["cut", "finished"]


@pytest.mark.parametrize("gone", [True, False])
def test_empty_or_missing_journal_is_refused(short: ShortRun, tmp_path: Path, gone: bool) -> None:
    run = short.unfinished(tmp_path / "run")
    journal, words = run / "journal.sqlite", "unable to open" if gone else "no such table"
    journal.unlink() if gone else journal.write_bytes(b"")
    assert_one_line(called(*short.words(run, "--resume")), 1, str(journal), words)
    assert_one_line(called("analyze", "tracking", run), 1, str(journal), words)
    assert journal.exists() is not gone
