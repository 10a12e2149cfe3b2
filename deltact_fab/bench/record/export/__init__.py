"""Runs in the formats of others. Press by press, whole or not at all.

CSV, Parquet and MCAP are of one run; a dataset of LeRobot may be of several.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from deltact_fab.common import InputError, Progress, disk_errors, require_extra, whole_file

from ..run import Run

FORMATS = {
    "csv": (),
    "parquet": ("pyarrow",),
    "mcap": ("mcap",),
    "lerobot": ("av", "pyarrow"),
}
"""Each with what it is written with, where that is a package of the extra `export`."""


def export_run(
    runs: Sequence[Run],
    form: str,
    out: Path,
    progress: Progress | None = None,
    follow: Callable[[Run], Any] | None = None,
) -> dict[str, int]:
    """Write runs to `out`, a new file (mcap) or folder; return rows by table.

    form: one of FORMATS. More than one run is for lerobot only, as is `follow`: what measures the
    motion of the face, None to leave it out. Of a run that was cut off, what it has. Raises
    InputError where `out` is there already or has no folder, MissingLibrary without the extra
    `export`, RunFailed for a damaged run and a full disk.
    """
    require_extra("export", f"--format {form}", *FORMATS[form])
    if out.exists():
        raise InputError(f"{out}: already there; name a new one")
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
