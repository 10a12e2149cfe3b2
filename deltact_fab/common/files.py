"""Atomic writing of files: to a temporary name in the same folder, then renamed."""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Literal

from .errors import DeltactFabError, InputError, RunFailed


def write_whole(path: Path, data: bytes, sync_name: bool = True) -> None:
    """Write a file atomically, safe against power loss.

    sync_name: as in `whole_file`. Raises RunFailed naming the file for a disk error.
    """
    with disk_errors(path), whole_file(path, sync_name=sync_name) as part:
        part.write_bytes(data)


@contextmanager
def whole_file(path: Path, sync: bool = True, sync_name: bool = True) -> Iterator[Path]:
    """Yield a temporary path next to `path` for a file or folder that replaces it at the end.

    On any error it is removed and `path` is unchanged. sync: False if loss in a power cut is
    acceptable. sync_name: False if the caller syncs the folder itself. Raises OSError.
    """
    part = _part_path(path)
    _remove(part)  # a planted link would be written through
    try:
        yield part
        if sync:
            for file in part.iterdir() if part.is_dir() else (part,):
                _sync(file)
        part.replace(path)
        if sync and sync_name:
            sync_folder(path.absolute().parent)
    finally:
        _remove(part)


def write_files(
    contents: Mapping[Path, bytes],
    gone: Collection[Path] = (),
    error: type[DeltactFabError] = InputError,
) -> None:
    """Write several files in order, each atomically.

    All are on the disk before the first is renamed; if a rename fails, earlier ones stay.
    gone: files to delete afterwards. Raises `error` in one line if a file cannot be written.
    """
    parts = {path: _part_path(path) for path in contents}
    try:
        for path, content in contents.items():
            if path.is_dir():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
            _remove(parts[path])
            parts[path].write_bytes(content)
            _sync(parts[path])
        for path, part in parts.items():
            part.replace(path)
        for path in gone:
            path.unlink(missing_ok=True)
    except OSError as os_error:
        raise error(_write_error_text(path, os_error)) from os_error
    finally:
        for leftover in parts.values():
            leftover.unlink(missing_ok=True)


def check_writable(path: Path, folder: bool = False) -> None:
    """Raise InputError if a file or folder cannot be created at a path."""
    try:
        if folder:
            parent = next(p for p in (path, *path.absolute().parents) if p.exists())
        else:
            parent = path.parent
            # lstat raises for a name that is too long, unlike Path.is_dir.
            with suppress(FileNotFoundError, NotADirectoryError):
                path.lstat()
    except OSError as error:
        raise InputError(_write_error_text(path, error)) from error
    if folder and not parent.is_dir():
        raise InputError(f"{parent}: is a file, not a folder")
    if not folder and path.is_dir():
        raise InputError(f"{path}: is a folder; expected a file name")
    if not parent.is_dir():
        raise InputError(f"{path}: no folder {parent}; create it first")
    if not os.access(parent, os.W_OK):
        raise InputError(f"{path}: cannot be written: {parent} is read-only")


@contextmanager
def disk_errors(
    path: Path, action: Literal["written", "read", "made"] = "written"
) -> Iterator[None]:
    """Turn an OSError into a RunFailed that names the file.

    action: with `made`, only a full or broken disk is a RunFailed, all else an InputError.
    """
    try:
        yield
    except OSError as error:
        bad_disk = action != "made" or error.errno in RunFailed.DISK
        kind = RunFailed if bad_disk else InputError
        raise kind(f"{path}: cannot be {action}: {error.strerror or error}") from error


def make_folder(folder: Path, *inside: str) -> None:
    """Create a folder with parents and named subfolders; raises as `disk_errors`."""
    with disk_errors(folder, "made"):
        for name in inside or ("",):
            (folder / name).mkdir(parents=True, exist_ok=True)


def sync_folder(folder: Path) -> None:
    """Sync a folder, so that renames survive a power cut; ignored if unsupported."""
    if os.name == "posix":
        _sync(folder, (errno.EINVAL, errno.ENOTSUP))


def _sync(path: Path, pass_over: Collection[int] = ()) -> None:
    handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in pass_over:
            raise
    finally:
        os.close(handle)


def _write_error_text(path: Path, error: OSError) -> str:
    name = path if len(str(path)) <= 80 else f"...{str(path)[-77:]}"
    return f"{name}: cannot be written: {error.strerror}"


def _part_path(path: Path) -> Path:
    """Temporary path in the same folder; a hash replaces names near the length limit."""
    name = os.fsencode(path.name)
    key = path.name if len(name) < 200 else hashlib.sha256(name).hexdigest()[:8]
    return path.with_name(f".{key}.{os.getpid()}.part")


def _remove(path: Path) -> None:
    """Remove a file or folder, ignoring errors: in a read-only folder there is none."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            path.unlink()
