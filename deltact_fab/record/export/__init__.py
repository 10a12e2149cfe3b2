"""A run in the formats of others: CSV, Parquet, MCAP. Press by press, whole or not at all."""

from __future__ import annotations

from pathlib import Path

from ...aliases import Progress
from ...errors import InputError
from ...extras import require
from ...files import disk_errors, whole
from ..run import Run

FORMATS = {"csv": (), "parquet": ("pyarrow",), "mcap": ("mcap",)}
"""Each with what it is written with, where that is a package of the extra `export`."""


def export(run: Run, form: str, out: Path, progress: Progress | None = None) -> dict[str, int]:
    """Write a run to `out`, a new folder (csv, parquet) or file (mcap); return rows by table.

    form: one of FORMATS. Of a run that was cut off, what it has. Raises InputError where `out` is
    there already or has no folder, MissingLibrary without the extra `export`, RunFailed for a
    damaged run and a full disk.
    """
    require("export", f"--format {form}", *FORMATS[form])
    if out.exists():
        raise InputError(f"{out}: already there; name a new one")
    if not out.absolute().parent.is_dir():
        raise InputError(f"{out.parent}: no such folder")
    report = progress or (lambda done, total, what: None)
    with disk_errors(out), whole(out) as made:
        if form == "mcap":
            from .foxglove import write

            return write(run, made, report)
        from .tables import write as write_tables

        return write_tables(run, made, form, report)
