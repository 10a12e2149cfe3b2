"""A folder of results that is whole or not there, and never takes the place of someone else's."""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from ...errors import InputError, RunFailed

Index = Mapping[str, str]
"""Of every file that was written into a folder: its path in it (with /), the SHA-256 of it."""


def sha256(path: Path) -> str:
    """Digest of a file, hexadecimal. Raises OSError."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextmanager
def replaced(out: Path, index: Callable[[Path], Index]) -> Iterator[Path]:
    """A hidden folder beside `out` that takes its place when the block ends without an error.

    index: what was written into a folder, empty for one of someone else's. A folder is replaced
    if it holds that and nothing else, unchanged, before the block and after it. On an error `out`
    is as it was before.

    Raises InputError for a folder that holds anything else, and one that cannot be made or read;
    RunFailed for any other refusal of the disk.
    """
    place = Path(os.path.realpath(out))
    _check(out, index)
    if Path.cwd().is_relative_to(place):
        raise InputError(f"{out}: you are in it, and it would be replaced; name a folder inside it")
    # Not made of the folder's name, which may be as long as a name can be
    part, old = (place.with_name(f".series-{os.getpid()}.{end}") for end in ("part", "old"))
    created = [parent for parent in place.parents if not os.path.lexists(parent)]
    try:
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
            with suppress(FileNotFoundError):
                place.lstat()  # refuses a name that is too long now and not after the long part
            part.mkdir()
        except OSError as why:
            raise InputError(f"{out}: cannot be a folder to write: {why.strerror}") from why
        try:
            yield part
            _check(out, index)
            if place.exists():
                place.rename(old)
            part.rename(place)
        except OSError as why:
            raise RunFailed(f"{out}: cannot be written: {why.strerror or why}") from why
    except BaseException:
        if os.path.lexists(old) and not os.path.lexists(place):
            old.rename(place)
        shutil.rmtree(part, ignore_errors=True)
        for parent in created:
            with suppress(OSError):
                parent.rmdir()
        raise
    shutil.rmtree(old, ignore_errors=True)


def _check(out: Path, index: Callable[[Path], Index]) -> None:
    """Raise InputError unless `out` is new, empty or as it was written."""
    if not os.path.lexists(out):
        return
    if not out.is_dir():
        raise InputError(f"{out}: is a file; name a folder")
    try:
        strange = _stranger(out, index(out))
    except OSError as why:
        raise InputError(f"{out}: cannot be read: {why.strerror or why}") from why
    if strange is not None:
        raise InputError(f"{out}: holds {strange}; name a new or an empty folder")


def _stranger(out: Path, index: Index) -> str | None:
    """The first thing in a folder that was not written there or is not as it was; None: none.

    Goes into no folder that nothing was written into. Raises OSError.
    """
    folders = {str(parent) for name in index for parent in Path(name).parents}
    left = ["."]
    while left:
        inside = left.pop()
        if inside not in folders and inside != ".":
            return f"{inside}, which this version of the command did not write"
        for name in sorted(os.listdir(out / inside)):
            path = Path(inside) / name
            whole, written = out / path, index.get(path.as_posix())
            if whole.is_dir() and not whole.is_symlink():
                left.append(str(path))
            elif written is None:
                return f"{path}, which this version of the command did not write"
            elif whole.is_symlink() or not whole.is_file() or sha256(whole) != written:
                return f"{path}, which was changed after this command wrote it"
    return None
