"""Export of runs to CSV, Parquet, MCAP and LeRobot, press by press and atomic.

CSV, Parquet and MCAP hold one run; a LeRobot dataset may hold several.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from deltact_fab.common import InputError, Progress, disk_errors, require_extra, whole_file

from ..run import Run

EXPORT_LIBRARIES = {
    "csv": (),
    "parquet": ("pyarrow",),
    "mcap": ("mcap",),
    "lerobot": ("av", "pyarrow"),
}
"""Packages of the extra `export` that each format needs."""


def export_run(
    runs: Sequence[Run],
    form: str,
    out: Path,
    progress: Progress | None = None,
    follow: Callable[[Run], Any] | None = None,
) -> dict[str, int]:
    """Write runs to `out`, a new file (mcap) or folder; return rows by table.

    form: one of EXPORT_LIBRARIES. Several runs, and `follow` (tracker of the face's motion; None:
    no motion), are for lerobot only. An unfinished run is exported as far as it goes. Raises
    InputError if `out` exists or has no parent folder, MissingLibrary without the extra `export`,
    RunFailed for a damaged run or a full disk.
    """
    require_extra("export", f"--format {form}", *EXPORT_LIBRARIES[form])
    if out.exists():
        raise InputError(f"{out}: already exists; name a new one")
    if not out.absolute().parent.is_dir():
        raise InputError(f"{out.parent}: no such folder")
    if form != "lerobot" and len(runs) > 1:
        raise InputError(f"--format {form}: one run at a time; lerobot takes several")
    report = progress or (lambda count, total, text: None)
    with disk_errors(out), whole_file(out) as part:
        if form == "mcap":
            from .foxglove import write

            return write(runs[0], part, report)
        if form == "lerobot":
            from .lerobot import write as write_lerobot

            return write_lerobot(runs, part, follow, report)
        from .tables import write as write_tables

        return write_tables(runs[0], part, form, report)
