"""The real bench's host under faults: each at each moment of a run, and killed at any.

The table is what issue and documents ask for; the cases are its cells. A cell that ends in success
is `right` with 0; one that ends in its error is `refused`, if all else is as it must be: the travel
after the error, nothing committed lost, every id exactly once and every image equal after resume.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import asdict
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import RunFailed
from ..engine import Case, Engine
from ..faults.bench import FaultBench, kill_after
from ..faults.cell import FaultOutcome, Matrix
from ..faults.disk import Disk, small_disk
from ..faults.kinds import DRAG, FAULTS, MOMENTS, PRESS, TRAVEL, FaultKind

KILLS = 20
NAMED = "in its named error"
CELLS = "bench-cells.jsonl"
QUICK = (("doubled ok", DRAG), ("false alarm", TRAVEL), ("force over the limit", PRESS))


class Wrong(Exception):
    """A cell is not as it must be."""


@lru_cache(maxsize=1)
def matrix(scratch: Path) -> Matrix:
    """What all cells of a command share."""
    folder = scratch / "bench"
    folder.mkdir()
    return Matrix(folder)


def _cell(fault: FaultKind, moment: str, scratch: Path) -> tuple[float, str]:
    made = matrix(scratch)
    if "disk" in fault.name:
        with small_disk(scratch / "disk") as disk:
            cell = made.cell(fault, moment, disk)
    else:
        cell = made.cell(fault, moment, Disk(made.folder, False))
    with (scratch / CELLS).open("a") as out:
        out.write(json.dumps(asdict(cell)) + "\n")
    if cell.wrong:
        raise Wrong(f"{cell.wrong}; {cell.outcome}")
    if cell.outcome == "success":
        return 0.0, "success"
    told = "nothing moved"
    if cell.travel_mm is not None:
        allowed = f" of {cell.allowed_mm:.3f} allowed" if cell.allowed_mm is not None else ""
        told = f"{cell.travel_mm:.3f} mm{allowed}, known after {cell.known_s:.3f} s"
    raise RunFailed(f"{NAMED}: {cell.outcome} [{told}]")


def _killed(number: int, scratch: Path) -> tuple[float, str]:
    """kill -9 at a random time of a session; figure: committed rows that are lost or doubled."""
    made = matrix(scratch)
    folder = made.folder / "killed"
    rng = np.random.default_rng([21, number])
    after_s = float(rng.uniform(0.0, 1.0)) * _session_s(scratch)
    while True:
        shutil.copytree(made.begun, folder)
        try:
            if kill_after(made.of, folder, after_s) is not None:
                after_s *= 0.7  # it was over: the machine is less busy than when that was timed
                continue
            if wrong := made.resumed(FaultBench(made.of), folder, "killed"):
                raise Wrong(f"killed after {after_s:.2f} s: {wrong}")
            return 0.0, f"killed after {after_s:.2f} s"
        finally:
            shutil.rmtree(folder)


@lru_cache(maxsize=1)
def _session_s(scratch: Path) -> float:
    """How long a session takes that is let alone."""
    made = matrix(scratch)
    folder = made.folder / "alone"
    shutil.copytree(made.begun, folder)
    took_s = kill_after(made.of, folder, 600.0)
    shutil.rmtree(folder)
    assert took_s is not None
    return took_s


def cases(quick: bool) -> Sequence[Case]:
    """A cell each, and the kills; a quick run has a few."""
    out = []
    for fault in FAULTS:
        ways = [w for w, may in (("right", fault.success), ("refused", fault.says)) if may]
        out += [
            Case(f"{fault.name}: {moment}", " or ".join(ways),  # type: ignore[arg-type]
                 partial(_cell, fault, moment), 0.0, "", NAMED)
            for moment in fault.at if not quick or (fault.name, moment) in QUICK
        ]  # fmt: skip
    return out + [
        Case(f"kill -9, {number + 1} of {KILLS}", "right", partial(_killed, number), 0.0,
             "rows lost or doubled") for number in range(0 if quick else KILLS)
    ]  # fmt: skip


def tables(scratch: Path) -> Sequence[dict[str, Any]]:
    """Faults by moments, as the cases found them."""
    found = {}
    path = scratch / CELLS
    for line in path.read_text().splitlines() if path.exists() else ():
        cell = FaultOutcome(**json.loads(line))
        found[cell.fault, cell.moment] = cell.says
    return [{
        "title": "Faults by moments",
        "note": "What a run ends in, and how far the carriage goes after the error: from when the "
        "fault had come to the host, or from the stop byte where that had to wait for a "
        "time-out (*), to rest. Travel at 600 mm/min, press and drag at 60, 50 mm/s2: braking "
        "takes 0.77 to 1.0 and 0.01 mm, 10 ms of motion are 0.1 and 0.01 mm. A cable that is "
        "out carries no byte: the tip goes on for what the controller was told; on its way up "
        "to the end (+). Every run goes on with --resume, on the same board, to the same images.",
        "columns": ["fault", *MOMENTS],
        "rows": [[f.name, *(found.get((f.name, m), "-") for m in MOMENTS)] for f in FAULTS],
    }]  # fmt: skip


ENGINE = Engine(
    "The bench under faults",
    "The real host, force client, camera, runner and record on a simulated controller in lockstep: "
    "what each fault does at each moment of a run.",
    cases,
    tables=tables,
)
