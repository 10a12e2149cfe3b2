"""The rows of evidence in one file: a JSON object a line, sorted by row, the last of a row counts.

A row that is done is appended, so that an interrupted run loses none; `compact` sorts them again,
and the file is there whole or not at all.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from deltact_fab.common.errors import InputError
from deltact_fab.common.files import write_whole


def read(path: Path) -> dict[str, dict[str, Any]]:
    """Entries by row, sorted; none where there is no file. What was cut off at the end is left out.

    Raises InputError naming the line that is no row.
    """
    text = path.read_text(encoding="utf-8") if path.is_file() else ""
    whole, _, _ = text.rpartition("\n")
    found = {}
    for number, line in enumerate(whole.splitlines(), 1):
        try:
            entry = json.loads(line)
            found[entry["key"]["row"]] = entry
        except (ValueError, KeyError, TypeError) as why:
            raise InputError(f"{path}, line {number}: no row of evidence: {why}") from why
    return dict(sorted(found.items()))


def append(path: Path, entry: dict[str, Any]) -> None:
    """Add one row at the end of a file that `compact` has left whole."""
    with path.open("a", encoding="utf-8") as out:
        out.write(_line(entry))
        out.flush()
        os.fsync(out.fileno())


def compact(path: Path, names: set[str] | None = None) -> dict[str, dict[str, Any]]:
    """Sort the file, each row once, and return its entries; those of `names` where it is given."""
    entries = {k: e for k, e in read(path).items() if names is None or k in names}
    write_whole(path, "".join(_line(e) for e in entries.values()).encode())
    return entries


def _line(entry: dict[str, Any]) -> str:
    return json.dumps(entry, separators=(",", ":"), allow_nan=False) + "\n"
