"""Files written whole or not at all: beside their place first, then renamed."""

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
    """Write a file so that it survives a power cut whole, or is as it was.

    sync_name: as of `whole`. Raises RunFailed naming the file when the disk refuses.
    """
    with disk_errors(path), whole_file(path, sync_name=sync_name) as part:
        part.write_bytes(data)


@contextmanager
def whole_file(path: Path, sync: bool = True, sync_name: bool = True) -> Iterator[Path]:
    """Yield a hidden name beside `path` for a file or a folder that takes its place at the end.

    On any error it is removed, and `path` is as it was. sync: False for what may be lost in a power
    cut. sync_name: False where the caller syncs the folder, once for many files. Raises OSError.
    """
    part = _part_path(path)
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
    """Write all files, in their order: no half file is ever seen.

    None takes its name before all are on the disk; a rename that fails then leaves those before it.
    gone: files that go when all are there. Raises `error` in one line when one cannot be written.
    """
    parts = {path: _part_path(path) for path in contents}
    try:
        for path, content in contents.items():
            if path.is_dir():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
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
    """Raise InputError where a file, or a folder, cannot be: in no folder, no right, too long."""
    try:
        if folder:
            parent = next(p for p in (path, *path.absolute().parents) if p.exists())
        else:
            parent = path.parent
            # Path.is_dir raises on a name that is too long, False to one that may not be read.
            with suppress(FileNotFoundError, NotADirectoryError):
                path.lstat()
    except OSError as error:
        raise InputError(_write_error_text(path, error)) from error
    if folder and not parent.is_dir():
        raise InputError(f"{path}: {parent} is a file; expected a folder")
    if not folder and path.is_dir():
        raise InputError(f"{path}: is a folder; expected the name of a file")
    if not parent.is_dir():
        raise InputError(f"{path}: there is no folder {parent}; create it first")
    if not os.access(parent, os.W_OK):
        raise InputError(f"{path}: cannot be written: {parent} is read-only")


@contextmanager
def disk_errors(
    path: Path, action: Literal["written", "read", "made"] = "written"
) -> Iterator[None]:
    """Turn an OSError into a RunFailed that names the file.

    action: while a folder is `made` only a full or broken disk is a RunFailed, all else InputError.
    """
    try:
        yield
    except OSError as error:
        bad_disk = action != "made" or error.errno in RunFailed.DISK
        kind = RunFailed if bad_disk else InputError
        raise kind(f"{path}: cannot be {action}: {error.strerror or error}") from error


def make_folder(folder: Path, *inside: str) -> None:
    """Make a folder, those above it and those named inside; as `disk_errors` if that cannot be."""
    with disk_errors(folder, "made"):
        for name in inside or ("",):
            (folder / name).mkdir(parents=True, exist_ok=True)


def sync_folder(folder: Path) -> None:
    """Make a rename survive a power cut; file systems that cannot say so are let pass."""
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
    """A name in the same folder, short where the file's own is nearly as long as names can be."""
    name = os.fsencode(path.name)
    key = path.name if len(name) < 200 else hashlib.sha256(name).hexdigest()[:8]
    return path.with_name(f".{key}.{os.getpid()}.part")


def _remove(path: Path) -> None:
    """Where nothing may be written, nothing can be removed either, and nothing is there."""
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            path.unlink()
