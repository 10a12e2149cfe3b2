"""Files written whole: checked before the work, and all of them or none at the end."""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Mapping
from pathlib import Path

from ..errors import InputError


def check_place(path: Path, in_a_folder: str) -> None:
    """Raise InputError where a file cannot be: a folder, no folder to hold it, too long a name.

    in_a_folder: what to say of a folder.
    """
    try:
        # Path.is_dir raises on a name that is too long, and says False to one that may not be read
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        pass
    except OSError as why:
        raise _unwritable(path, why) from why
    if path.is_dir():
        raise InputError(f"{path}: is a folder; {in_a_folder}")
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no folder {path.parent}; create it first")


def write_together(wanted: Mapping[Path, bytes]) -> None:
    """Write all files beside their places, then rename: no half file is ever seen.

    Raises InputError of one line when one cannot be written; then every file is as it was.
    """
    parts = {path: _beside(path, "part") for path in wanted}
    olds = {path: _beside(path, "old") for path in wanted}
    placed: list[Path] = []
    try:
        for path, content in wanted.items():
            parts[path].write_bytes(content)
        if len(wanted) > 1:
            for path, old in olds.items():
                if path.is_file():
                    _keep(path, old)
        for path, part in parts.items():
            part.replace(path)
            placed.append(path)
    except BaseException as why:
        for target, old in olds.items():
            if old.exists() and target in placed:
                old.replace(target)
            elif target in placed:
                target.unlink(missing_ok=True)
            else:
                old.unlink(missing_ok=True)
        if isinstance(why, OSError):
            raise _unwritable(path, why) from why
        raise
    finally:
        for left in parts.values():
            left.unlink(missing_ok=True)
    # Not in `finally`: a file that could not be put back is still here under this name
    for old in olds.values():
        old.unlink(missing_ok=True)


def _unwritable(path: Path, why: OSError) -> InputError:
    shown = path if len(str(path)) <= 80 else f"{str(path)[:77]}..."
    return InputError(f"{shown}: cannot be written: {why.strerror}")


def _beside(path: Path, kind: str) -> Path:
    """A short name in the same folder: the file's own may already be as long as names can be."""
    key = hashlib.sha256(os.fsencode(path.name)).hexdigest()[:8]
    return path.with_name(f".{key}.{os.getpid()}.{kind}")


def _keep(path: Path, old: Path) -> None:
    """Hold a file under a second name, so that its own is never empty meanwhile."""
    old.unlink(missing_ok=True)
    try:
        os.link(path, old)
    except OSError:  # a file system without links
        shutil.copy2(path, old)
