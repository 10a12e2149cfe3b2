"""A run in the formats of others: CSV, Parquet, MCAP. Press by press, whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ...aliases import Progress
from ...errors import InputError
from ...extras import require
from ...files import disk_errors, whole
from ..run import Run

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
    with _new(out) as made:
        report = progress or (lambda done, total, what: None)
        if form == "mcap":
            from .foxglove import write

            return write(run, made, report)
        from .tables import write as write_tables

        return write_tables(run, made, form, report)


@contextmanager
def _new(out: Path) -> Iterator[Path]:
    """A temporary name beside `out`, which takes its place at the end, or is removed."""
    if out.exists():
        raise InputError(f"{out}: already there; name a new one")
    if not out.absolute().parent.is_dir():
        raise InputError(f"{out.parent}: no such folder")
    with disk_errors(out), whole(out) as made:
        yield made
