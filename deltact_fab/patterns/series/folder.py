"""A folder of results that is whole or not there, and never takes the place of someone else's."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from ...errors import InputError, RunFailed


@contextmanager
def replaced(out: Path, files: Sequence[str], is_ours: Callable[[Path], bool]) -> Iterator[Path]:
    """A hidden folder beside `out` that takes its place when the block ends without an error.

    files: what may be in a folder that is replaced, as patterns of paths in it. is_ours: whether
    a folder of such files is one of these. On an error `out` is as it was before.

    Raises InputError for a folder that holds anything else, and one that cannot be made; RunFailed
    for any other refusal of the disk.
    """
    place = Path(os.path.realpath(out))
    _check(out, files, is_ours)
    if Path.cwd().is_relative_to(place):
        raise InputError(f"{out}: you are in it, and it would be replaced; name a folder inside it")
    part, old = (place.with_name(f".{place.name}.{os.getpid()}.{end}") for end in ("part", "old"))
    created = [parent for parent in place.parents if not parent.exists()]
    try:
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
            part.mkdir()
        except OSError as why:
            raise InputError(f"{out}: cannot be a folder to write: {why.strerror}") from why
        try:
            yield part
            if place.exists():
                place.rename(old)
            part.rename(place)
        except OSError as why:
            raise RunFailed(f"{out}: cannot be written: {why.strerror or why}") from why
    except BaseException:
        if old.exists() and not place.exists():
            old.rename(place)
        shutil.rmtree(part, ignore_errors=True)
        for parent in created:
            with suppress(OSError):
                parent.rmdir()
        raise
    shutil.rmtree(old, ignore_errors=True)


def _check(out: Path, files: Sequence[str], is_ours: Callable[[Path], bool]) -> None:
    """Raise InputError unless `out` is new, empty or ours."""
    if not os.path.lexists(out):
        return
    if not out.is_dir():
        raise InputError(f"{out}: is a file; name a folder")
    held = sorted(path.relative_to(out) for path in out.rglob("*") if not path.is_dir())
    strange = [path for path in held if not any(_fits(path, file) for file in files)]
    if not strange and not is_ours(out):
        strange = held
    if strange:
        raise InputError(
            f"{out}: holds {strange[0]}, which was not written by this command; name a new or an "
            "empty folder"
        )


def _fits(path: Path, file: str) -> bool:
    return len(path.parts) == len(Path(file).parts) and path.match(file)
