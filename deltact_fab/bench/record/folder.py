"""Gate to a run folder of any origin: nothing outside it is touched, nothing blocks or overflows.

What is opened is a regular file below the folder, within its limit; no link below it is followed.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path, PurePath
from typing import BinaryIO, cast

from deltact_fab.common import InputError, disk_errors

FOLDER_NAMES = ("images", "truth", "analysis")
FILE_NAMES = (
    "run.json", "protocol.toml", "pattern.json", "summary.json", "camera.flat.png", "notes.jsonl",
    "tool.json", "journal.sqlite", "journal.sqlite-wal", "journal.sqlite-shm",
    "journal.sqlite-journal",
)  # fmt: skip
MAX_RUN_FILE_BYTES = {
    ".json": 8 << 20, ".toml": 4 << 20, ".jsonl": 16 << 20, ".csv": 64 << 20, ".npz": 256 << 20,
    ".png": 256 << 20, ".jxl": 256 << 20,
}  # fmt: skip
"""By hand, by suffix: ten times what a long run has; objects take twenty times a JSON's size."""
_SAFE_FLAGS = sum(getattr(os, f"O_{name}", 0) for name in ("NOFOLLOW", "NONBLOCK", "BINARY"))
_KINDS = {
    stat.S_IFLNK: "a symbolic link", stat.S_IFIFO: "a FIFO", stat.S_IFDIR: "a folder",
    stat.S_IFCHR: "a device", stat.S_IFBLK: "a device", stat.S_IFSOCK: "a socket",
    stat.S_IFREG: "a file",
}  # fmt: skip
# Format of SQLite, "The Rollback Journal": after the path of a file that a rollback deletes.
_SUPER_JOURNAL_MARK = bytes.fromhex("d9d505f920a163d7")


class UnsafeFile(InputError):
    """File of a run that is not opened: outside the folder, not regular, or beyond a limit."""


def check_folder(folder: Path) -> None:
    """Check the files of a run but its images and truths, which are checked when opened.

    Raises UnsafeFile.
    """
    with disk_errors(folder, "read"):
        for name in FOLDER_NAMES:
            if os.path.lexists(folder / name):
                _require(folder / name, stat.S_IFDIR)
        for name in FILE_NAMES:
            has_file(folder, name)
        if (folder / "analysis").is_dir():
            for entry in os.scandir(folder / "analysis"):
                if not entry.is_dir(follow_symlinks=False):
                    has_file(folder, f"analysis/{entry.name}")
    journal = "journal.sqlite-journal"
    if has_file(folder, journal):
        with open_file(folder, journal) as file:
            file.seek(-min(file.seek(0, os.SEEK_END), len(_SUPER_JOURNAL_MARK)), os.SEEK_END)
            if file.read() == _SUPER_JOURNAL_MARK:
                raise UnsafeFile(f"{folder / journal}: names another file; no run writes that")


def has_file(folder: Path, name: str) -> bool:
    """Return True if a file exists, by its path below the folder. Raises UnsafeFile."""
    try:
        _check_path(folder, name)
    except (FileNotFoundError, NotADirectoryError):
        return False
    return True


def read_file(folder: Path, name: str) -> bytes:
    """Read a file by its path below the folder. Raises UnsafeFile, OSError."""
    with open_file(folder, name) as file:
        return file.read(os.fstat(file.fileno()).st_size)


def open_file(folder: Path, name: str, mode: str = "rb") -> BinaryIO:
    """Open a file by its path below the folder. mode: also a+b. Raises UnsafeFile, OSError."""
    flags = os.O_RDONLY if mode == "rb" else os.O_RDWR | os.O_APPEND | os.O_CREAT
    try:
        _check_path(folder, name)
    except FileNotFoundError:
        if not flags & os.O_CREAT:
            raise
    handle = _open_below(folder, PurePath(name).parts, flags | _SAFE_FLAGS)
    try:
        _require_kind(folder / name, os.fstat(handle).st_mode, stat.S_IFREG)
        return cast(BinaryIO, os.fdopen(handle, mode, buffering=0))
    except BaseException:
        os.close(handle)
        raise


def _check_path(folder: Path, name: str) -> None:
    """Raise UnsafeFile, or FileNotFoundError. Other systems than POSIX open by the path alone."""
    parts = PurePath(name).parts
    if PurePath(name).anchor or ".." in parts or "\0" in name or not parts:
        raise UnsafeFile(f"{folder}: {name!r}: must be a path below the run folder")
    for k in range(1, len(parts)):
        _require(folder.joinpath(*parts[:k]), stat.S_IFDIR)
    size = _require(folder / name, stat.S_IFREG)
    limit = MAX_RUN_FILE_BYTES.get(PurePath(name).suffix.lower(), size)
    if size > limit:
        text = f"{size / 2**20:.0f} MiB; at most {limit / 2**20:.0f} MiB"
        raise UnsafeFile(f"{folder / name}: {text}; is it the right file?")


def _require(path: Path, kind: int) -> int:
    """Return the size of a file of a kind. Raises UnsafeFile, FileNotFoundError."""
    info = path.lstat()
    _require_kind(path, info.st_mode, kind)
    return info.st_size


def _require_kind(path: Path, mode: int, kind: int) -> None:
    if stat.S_IFMT(mode) != kind:
        found = _KINDS.get(stat.S_IFMT(mode), "of unknown kind")
        raise UnsafeFile(f"{path}: is {found}; must be {_KINDS[kind]} of its own in a run folder")


def _open_below(folder: Path, parts: tuple[str, ...], flags: int) -> int:
    if os.open not in os.supports_dir_fd:
        return os.open(folder.joinpath(*parts), flags)
    at = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        for part in parts[:-1]:
            inner = os.open(part, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=at)
            os.close(at)
            at = inner
        return os.open(parts[-1], flags, 0o666, dir_fd=at)
    finally:
        os.close(at)
