"""A study's folder: one offline page, the CSV behind each table, and result.json."""

from __future__ import annotations

import json
from pathlib import Path

from ..record import write_whole
from .result import StudyResult


def write(result: StudyResult, out: Path) -> Path:
    """Write result.json and a CSV a table into a folder; the page's path."""
    out.mkdir(parents=True, exist_ok=True)
    for table in result.tables:
        write_whole(out / f"{table.name}.csv", table.frame.to_csv(index=False).encode())
    plain = json.dumps(result.data, indent=1, allow_nan=False)
    write_whole(out / "result.json", plain.encode())
    return out / "report.html"
