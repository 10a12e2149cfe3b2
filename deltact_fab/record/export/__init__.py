"""A run in the formats of others: CSV, Parquet, MCAP. Press by press, whole or not at all."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ...errors import InputError, RunFailed
from ...extras import require
from ..files import sync_folder
from ..run import Run
from .source import Progress

FORMATS = ("csv", "parquet", "mcap")
WITH_EXTRA = {"parquet": "pyarrow", "mcap": "mcap"}
"""What a format is written with, where that is a package of the extra `export`."""


def export(run: Run, form: str, out: Path, progress: Progress | None = None) -> dict[str, int]:
    """Write a run to `out`, a new folder (csv, parquet) or file (mcap); return rows by table.

    Of a run that was cut off, what it has. Raises InputError where `out` is there already or has no
    folder, MissingLibrary without the extra `export`, RunFailed for a damaged run and a full disk.
    """
    if form not in FORMATS:
        raise InputError(f"--format: {form!r}; valid: {', '.join(FORMATS)}")
    if form in WITH_EXTRA:
        require("export", f"--format {form}", WITH_EXTRA[form])
    with _whole(out) as made:
        report = progress or (lambda done, total, what: None)
        if form == "mcap":
            from .foxglove import write

            return write(run, made, report)
        from .folder import write as write_tables

        return write_tables(run, made, form, report)


@contextmanager
def _whole(out: Path) -> Iterator[Path]:
    """A temporary name beside `out`, which takes its place at the end, or is removed."""
    if out.exists():
        raise InputError(f"{out}: already there; name a new one")
    if not out.absolute().parent.is_dir():
        raise InputError(f"{out.parent}: no such folder")
    made = out.with_name(f".{out.name}.part")
    try:
        _remove(made)
        yield made
        _sync(made)
        made.rename(out)
        sync_folder(out.absolute().parent)
    except OSError as why:
        raise RunFailed(f"{out}: cannot be written: {why.strerror or why}") from why
    finally:
        _remove(made)


def _sync(path: Path) -> None:
    for file in [path] if path.is_file() else path.iterdir():
        handle = os.open(file, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
