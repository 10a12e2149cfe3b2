"""Gate to a run folder of any origin: nothing outside it is touched, nothing blocks or overflows.

What is opened is a regular file below the folder, within its limit; no link below it is followed.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path, PurePath
from typing import BinaryIO, cast

from deltact_fab.common import InputError, disk_errors

MAX_RUN_FILE_BYTES = {
    ".json": 8 << 20, ".toml": 4 << 20, ".jsonl": 4 << 20, ".csv": 64 << 20, ".npz": 256 << 20,
    ".png": 256 << 20, ".jxl": 256 << 20, ".sqlite-journal": 16 << 20,
}  # fmt: skip
"""By hand, by suffix: ten times what a long run has; larger ones take more than 500 MB to read."""
_SAFE_FLAGS = sum(getattr(os, f"O_{name}", 0) for name in ("NOFOLLOW", "NONBLOCK", "BINARY"))
_FILE_KINDS = {
    stat.S_IFLNK: "a symbolic link", stat.S_IFIFO: "a FIFO", stat.S_IFDIR: "a folder",
    stat.S_IFCHR: "a device", stat.S_IFBLK: "a device", stat.S_IFSOCK: "a socket",
    stat.S_IFREG: "a regular file",
}  # fmt: skip


class UnsafeFile(InputError):
    """File of a run that is not opened: outside the folder, not regular, or beyond a limit."""


def check_folder(folder: Path) -> None:
    """Raise UnsafeFile for a link or a device in a run or its analysis.

    Images and truths, which may be many, are checked when they are opened.
    """
    with disk_errors(folder, "read"):
        for place in (folder, folder / "analysis"):
            for path in place.iterdir() if place.is_dir() else ():
                if path.is_symlink() or not path.is_dir():
                    has_file(folder, str(path.relative_to(folder)))


def has_file(folder: Path, name: str) -> bool:
    """Return True if a file exists, by its path below the folder. Raises UnsafeFile."""
    path = PurePath(name)
    if path.anchor or ".." in path.parts or "\0" in name:
        raise UnsafeFile(f"{folder}: {name!r}: must be a path below the run folder")
    try:
        for parent in path.parents[-2::-1]:
            _require_kind(folder / parent, os.lstat(folder / parent), stat.S_IFDIR)
        info = os.lstat(folder / name)
    except (FileNotFoundError, NotADirectoryError):
        return False
    _require_kind(folder / name, info, stat.S_IFREG)
    limit = MAX_RUN_FILE_BYTES.get(path.suffix.lower(), info.st_size)
    if info.st_size > limit:
        text = f"{info.st_size / 2**20:.0f} MiB; at most {limit >> 20} MiB"
        raise UnsafeFile(f"{folder / name}: {text}; is it the right file?")
    return True


def read_file(folder: Path, name: str) -> bytes:
    """Read a file by its path below the folder. Raises UnsafeFile, OSError."""
    with open_file(folder, name) as file:
        return file.read(os.fstat(file.fileno()).st_size)


def open_file(folder: Path, name: str, mode: str = "rb") -> BinaryIO:
    """Open a file by its path below the folder. mode: also a+b. Raises UnsafeFile, OSError."""
    has_file(folder, name)
    flags = os.O_RDONLY if mode == "rb" else os.O_RDWR | os.O_APPEND | os.O_CREAT
    handle = _open_below(folder, PurePath(name).parts, flags | _SAFE_FLAGS)
    try:
        _require_kind(folder / name, os.fstat(handle), stat.S_IFREG)
        return cast(BinaryIO, os.fdopen(handle, mode, buffering=0))
    except BaseException:
        os.close(handle)
        raise


def _require_kind(path: Path, info: os.stat_result, kind: int) -> None:
    if (present := stat.S_IFMT(info.st_mode)) != kind:
        text = f"is {_FILE_KINDS.get(present, 'of unknown kind')}; must be {_FILE_KINDS[kind]}"
        raise UnsafeFile(f"{path}: {text} in a run folder")


def _open_below(folder: Path, parts: tuple[str, ...], flags: int) -> int:
    if os.open not in os.supports_dir_fd:  # not POSIX: by the path alone
        return os.open(folder.joinpath(*parts), flags)
    parent = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        for part in parts[:-1]:
            inner = os.open(part, os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=parent)
            os.close(parent)
            parent = inner
        return os.open(parts[-1], flags, 0o666, dir_fd=parent)
    finally:
        os.close(parent)
