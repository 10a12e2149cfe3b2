"""Faults of disk, files and input, met by the command line: one line, its exit code, no debris."""

from __future__ import annotations

import hashlib
import os
import re
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import cached_property
from pathlib import Path
from types import SimpleNamespace

import pytest
from called import called

from deltact_fab import experiment, record

pytestmark = pytest.mark.slow
DESIGN = """
[optics]
image_width_px = 160
image_height_px = 120
"""
Cli = Callable[..., "subprocess.CompletedProcess[str]"]


class Short:
    """A protocol of one indenter and ten frames, its rig, and its finished run."""

    def __init__(self, folder: Path, mini: tuple[Path, Path]) -> None:
        design = folder / "design.toml"
        design.write_text(DESIGN)
        self.text = mini[0].read_text().replace('"sphere:10", "4dots"', '"sphere:6"')
        self.text = self.text.replace("amplitude_mm = 1.5", "amplitude_mm = 0.5")
        self.text = self.text.replace("depths_mm = [1.0]", "depths_mm = [0.4]")
        self.text += f'[specimen]\ndesign = "{design}"\n'
        self.protocol, self.rig = folder / "short.toml", folder / "bench.toml"
        self.protocol.write_text(self.text)
        self.rig.write_text(
            mini[1]
            .read_text()
            .replace(
                "spacing_mm = 0.25",
                "spacing_mm = 0.5\npress_increment_mm = 0.4\nshear_increment_mm = 0.5",
            )
        )
        self.folder = folder

    @cached_property
    def finished(self) -> Path:
        out = self.folder / "finished"
        experiment.run(experiment.RunRequest(str(self.protocol), str(self.rig), out, seed=3))
        return out

    def arguments(self, out: Path, *more: str) -> list[str]:
        return [
            "run", str(self.protocol), "--rig", str(self.rig), "--seed", "3", "--out", str(out),
            *more,
        ]  # fmt: skip

    def unfinished(self, out: Path) -> Path:
        """A copy of the run as if it had been cut off just before its summary."""
        shutil.copytree(self.finished, out)
        (out / "summary.json").unlink()
        return out


@pytest.fixture(scope="module")
def short(mini: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Short:
    return Short(tmp_path_factory.mktemp("short"), mini)


# The run is begun although its estimate does not fit: a quota is seen by nobody before it is met.
ENDLESS = SimpleNamespace(total=2**50, used=0, free=2**50)
ON_A_QUOTA = """
import shutil, sys
from collections import namedtuple
shutil.disk_usage = lambda path: namedtuple("usage", "total used free")(2**50, 0, 2**50)
from deltact_fab.cli.main import entry
entry()
"""


@pytest.fixture(scope="module")
def cli() -> Cli:
    """The command line; in a process of its own that may put file_limit bytes in one file."""
    # No compiled modules are written under a limit: they would be what fails.
    env = os.environ | {"PYTHONDONTWRITEBYTECODE": "1", "OMP_NUM_THREADS": "1"}

    def run(*arguments: str, file_limit: int = -1) -> subprocess.CompletedProcess[str]:
        if file_limit < 0:
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(shutil, "disk_usage", lambda path: ENDLESS)
                return called(*arguments)

        def limit() -> None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (file_limit, file_limit))

        return subprocess.run(
            [sys.executable, "-c", ON_A_QUOTA, *arguments],
            env=env, capture_output=True, text=True, check=False, preexec_fn=limit,
        )  # fmt: skip

    return run


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
    rows = record.open(out).frames()
    assert {f"images/{p.name}" for p in (out / "images").iterdir()} >= set(rows["file"])
    for row in rows.itertuples():
        data = (out / str(row.file)).read_bytes()
        assert hashlib.sha256(data).hexdigest() == row.sha256
    truth = record.open(out).truth()  # None, or every press that is there loads whole
    for frame_id in truth.frames if truth is not None else ():
        assert truth.displacement_mm(frame_id).ndim == 3


def assert_completes(short: Short, out: Path) -> None:
    """The run that failed goes on to the same images as the undisturbed one."""
    experiment.run(
        experiment.RunRequest(str(short.protocol), str(short.rig), out, seed=3), resume=True
    )
    wanted, found = (record.open(p).frames()["sha256"] for p in (short.finished, out))
    assert list(found) == list(wanted)


# ---- the disk ---------------------------------------------------------------------------------


@pytest.mark.parametrize("kib", [16, 200, 300])
def test_a_disk_that_fills_up(
    short: Short, cli: Cli, disk: Callable[[str], Path], kib: int
) -> None:
    out = disk(f"size={kib}k") / "r"
    done = cli(*short.arguments(out))
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
    short: Short, cli: Cli, tmp_path: Path, limit: int, culprit: str
) -> None:
    out = tmp_path / "r"
    done = cli(*short.arguments(out), file_limit=limit)
    assert_one_line(done, 1)
    assert re.search(culprit, done.stderr)
    if out.exists():
        assert_nothing_half_written(out)
    assert not list(tmp_path.rglob("*.part"))
    assert_completes(short, out)


@pytest.fixture
def locked(
    tmp_path: Path, request: pytest.FixtureRequest
) -> Iterator[tuple[Path, Callable[[], None]]]:
    """A folder and what makes it read only: its permissions, or for root a mount of its own."""
    if os.geteuid() == 0:
        mount = request.getfixturevalue("disk")
        yield mount("size=64m"), lambda: mount("ro")
        return
    place = tmp_path / "locked"
    place.mkdir()
    yield place, lambda: place.chmod(0o555)
    for path in (place, *place.rglob("*")):
        path.chmod(0o755 if path.is_dir() else 0o644)


def test_a_folder_that_may_not_be_written(
    short: Short, cli: Cli, locked: tuple[Path, Callable[[], None]]
) -> None:
    place, lock = locked
    cut = short.unfinished(place / "cut")
    shutil.copytree(short.finished, place / "finished")
    for folder in (cut, place / "finished") if os.geteuid() else ():
        folder.chmod(0o555)
    lock()
    assert_one_line(cli(*short.arguments(place / "r")), 2, f"{place / 'r'}: cannot be written")
    assert_one_line(cli(*short.arguments(cut, "--resume")), 2, f"{cut}: cannot be written")
    # What is finished needs no writing, neither to be told so nor to be read.
    assert cli(*short.arguments(place / "finished", "--resume")).returncode == 0
    assert len(record.open(place / "finished").frames()) == len(
        record.open(short.finished).frames()
    )
    assert sorted(p.name for p in place.iterdir()) == ["cut", "finished"]


# ---- the record -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"not a database at all" * 50, "not a database"),
        (b"", "no such table"),
        (None, "unable to open"),
    ],
)
def test_a_corrupted_journal(
    short: Short, cli: Cli, tmp_path: Path, content: bytes | None, words: str
) -> None:
    run = short.unfinished(tmp_path / "run")
    journal = run / "journal.sqlite"
    if content is None:
        journal.unlink()
    else:
        journal.write_bytes(content)
    images = sorted((run / "images").iterdir())
    assert_one_line(cli(*short.arguments(run, "--resume")), 1, str(journal), words)
    assert_one_line(cli("analyze", "tracking", str(run)), 1, str(journal), words)
    assert sorted((run / "images").iterdir()) == images
    assert journal.exists() == (content is not None)


# ---- the input --------------------------------------------------------------------------------


def test_a_run_folder_that_is_already_there(short: Short, cli: Cli, tmp_path: Path) -> None:
    done = cli(*short.arguments(short.finished))
    assert_one_line(done, 2, f"{short.finished}: already there; name a new --out folder")
    cut = short.unfinished(tmp_path / "cut")
    before = sorted(p.name for p in cut.rglob("*"))
    assert_one_line(cli(*short.arguments(cut)), 2, f"{cut}: already there", "--resume")
    assert sorted(p.name for p in cut.rglob("*")) == before
    other = tmp_path / "other"
    other.mkdir()
    done = cli(*short.arguments(other, "--resume"))
    assert_one_line(done, 2, f"{other}: not a run folder")
    assert list(other.iterdir()) == []
