"""The one writer of whole files: what is there afterwards, and what is not."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from deltact_fab.common import files
from deltact_fab.common.errors import InputError, RunFailed


def contents(folder: Path) -> dict[str, bytes]:
    """Hidden files too."""
    return {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file()}


def _fill(folder: Path) -> None:
    """Write one file and fail at the next."""
    folder.mkdir()
    (folder / "a").write_bytes(b"1")
    (folder / "a" / "b").write_bytes(b"2")


def test_folder_is_created_atomically(tmp_path: Path) -> None:
    with files.whole_file(tmp_path / "made") as part:
        part.mkdir()
        (part / "a").write_bytes(b"1")
        assert not (tmp_path / "made").exists()
    assert contents(tmp_path / "made") == {"a": b"1"}
    with pytest.raises(NotADirectoryError), files.whole_file(tmp_path / "broken") as part:
        _fill(part)
    assert [p.name for p in tmp_path.iterdir()] == ["made"]


def test_full_disk_leaves_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    file = tmp_path / "f.json"
    file.write_bytes(b"old")
    monkeypatch.setattr(files.os, "fsync", full)
    with pytest.raises(RunFailed, match=r"f\.json: cannot be written: No space left on device$"):
        files.write_whole(file, b"new")
    with pytest.raises(InputError, match=r"f\.json: cannot be written: No space left on device$"):
        files.write_files({file: b"new"})
    assert contents(tmp_path) == {"f.json": b"old"}


@pytest.mark.parametrize("blocked", [False, True])
def test_files_are_replaced_together(tmp_path: Path, blocked: bool) -> None:
    new, old, last = (tmp_path / name for name in ("new", "old", "result"))
    old.write_bytes(b"1")
    last.mkdir() if blocked else last.write_bytes(b"2")
    wanted = {new: b"3", last: b"4"}
    if not blocked:
        files.write_files(wanted, [old], RunFailed)
        assert contents(tmp_path) == {"new": b"3", "result": b"4"}
        return
    with pytest.raises(RunFailed, match="result: cannot be written"):
        files.write_files(wanted, [old], RunFailed)
    assert contents(tmp_path) == {"old": b"1"}


def test_planted_part_is_no_way_out(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_bytes(b"precious")
    for write in (files.write_whole, lambda path, data: files.write_files({path: data})):
        (tmp_path / f".a.{os.getpid()}.part").symlink_to(victim)
        write(tmp_path / "a", b"new")
        assert (tmp_path / "a").read_bytes() == b"new"
        assert victim.read_bytes() == b"precious"
