"""The page of a rehearsal: verdict, then what each fault did."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pandas as pd

from ..files import write_whole
from .templating import Finding, render, save, table, verdict

COLUMNS = {
    "fault": "fault", "moment": "when", "outcome": "what the operator reads",
    "deeper_mm": "lower, mm", "wrong": "with --resume",
}  # fmt: skip


def write(found: dict[str, Any], protocol: str, rig: str, out: Path) -> list[Path]:
    """rehearsal.html and .json of `Rehearsal.as_dict()`; as `templating.save`."""
    rows = [{**c, "wrong": c["wrong"] or "the same record"} for c in found["cells"]]
    marks = ["" if c["passed"] else "bad" for c in rows]
    cells = table(pd.DataFrame(rows, columns=list(COLUMNS)).round(2), COLUMNS, marks)
    text = f"{found['verdict'][:1].upper()}{found['verdict'][1:]}."
    judged = verdict([Finding(text, "good" if found["passed"] else "bad")])
    page = render(
        "rehearsal.html", found=found, protocol=protocol, rig=rig, cells=cells, verdict=judged
    )
    data = out / "rehearsal.json"
    written = [save(page, out / "rehearsal.html"), data]
    write_whole(data, json.dumps(found, indent=1).encode())
    return written
