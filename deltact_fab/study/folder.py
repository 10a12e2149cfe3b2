"""A study's folder: an earlier one of the same study is replaced whole, any other is refused."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..errors import InputError, RunFailed

MARKER = "study.json"


def study_in(folder: Path) -> str | None:
    """The name of the study that a folder holds, or None."""
    try:
        found = json.loads((folder / MARKER).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    name = found.get("study") if isinstance(found, dict) else None
    return name if isinstance(name, str) else None


def refuse_strange(out: Path, name: str) -> None:
    """Raises InputError for a folder that is neither empty nor an earlier one of this study."""
    if not os.path.lexists(out) or study_in(out) == name:
        return
    if not out.is_dir():
        raise InputError(f"{out}: is no folder; name another --out folder")
    if any(out.iterdir()):
        raise InputError(
            f"{out}: is not empty and not an earlier {name}; name another --out folder"
        )


@contextmanager
def replaced(out: Path, name: str) -> Iterator[Path]:
    """A new folder beside `out`, which takes its place at the end, or leaves it as it was.

    Raises InputError as `refuse_strange`, RunFailed when the disk refuses.
    """
    refuse_strange(out, name)
    part = out.with_name(f".{out.name}.{os.getpid()}.part")
    try:
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
        (part / MARKER).write_text(json.dumps({"study": name}) + "\n", encoding="utf-8")
        yield part
        if out.exists():
            shutil.rmtree(out)
        part.rename(out)
    except OSError as why:
        raise RunFailed(f"{out}: cannot be written: {why.strerror or why}") from why
    finally:
        shutil.rmtree(part, ignore_errors=True)
