"""The long tables: every row in a process of its own, kept in one file, written up as markdown.

`python -m benchmarks.evidence [--only PREFIX] [--stale] [--jobs N]`; `make evidence` runs it.
What is there already is skipped, so an interrupted run goes on where it stopped. A row whose code
or arguments have changed since is stale: it is kept and marked, and run again only when asked for.
A row that fails or dies is kept with its reason.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from deltact_fab.common import digest
from deltact_fab.common.jobs.local import THREAD_VARIABLES
from deltact_fab.estimate.measure.flow.renewed import FlowMethod
from deltact_fab.studies.numerics.harness import describe_machine
from deltact_fab.version import library_versions

from . import flow_peers, store
from .gel_press import felupe_row
from .held import every_held, held_row
from .tables import write_up

HERE = Path(__file__).resolve().parent
ROWS, TABLES = "evidence.jsonl", "EVIDENCE.md"
LIMIT_S = 1200.0
PACKAGES = ("numpy", "scipy", "numba", "opencv-contrib-python-headless", "pypardiso", "mkl")


@dataclass(frozen=True)
class EvidenceRow:
    """name: unique, starts with its table. call: made in the row's own process."""

    name: str
    call: Callable[[], dict[str, Any]]

    @property
    def key(self) -> dict[str, str]:
        """What its result follows from: the call in words, and the digest of the code behind it."""
        words, modules = _spelled(self.call)
        own = {m.partition(".")[2] for m in modules if m.startswith(f"{HERE.name}.")}
        package = {m.partition(".")[2] for m in modules if m.startswith("deltact_fab.")}
        source = f"{digest.code_digest(*own, package=HERE)}+{digest.code_digest(*package)}"
        return {"row": self.name, "asked": words, "source": source}


# -- rows ------------------------------------------------------------------------------------------


def rows() -> Iterator[EvidenceRow]:
    """All rows, the cheap tables first."""
    for depth in (2.0, 5.0):
        for cell in (3.0, 2.0):
            name = f"felupe: {depth:g} mm, cells of {cell:g} mm"
            yield EvidenceRow(name, partial(felupe_row, depth, cell))
    for held in every_held():
        yield EvidenceRow(f"held: {held.name}", partial(held_row, held))
    for method in (*FlowMethod.NAMES, *flow_peers.PEERS):
        yield EvidenceRow(f"peer: {method}", partial(flow_peers.peer_row, method))


def _spelled(call: Any) -> tuple[str, set[str]]:
    """A call and its arguments in words, and the modules of the functions in it."""
    if not isinstance(call, partial):
        return (call.__qualname__, {call.__module__}) if callable(call) else (repr(call), set())
    told, modules = zip(*map(_spelled, (call.func, *call.args)), strict=True)
    keywords = "".join(f", {k}={v!r}" for k, v in call.keywords.items())
    return f"{told[0]}({', '.join(told[1:])}{keywords})", set().union(*modules)


# -- running ---------------------------------------------------------------------------------------


def run_row(name: str) -> dict[str, Any]:
    """One row on one thread of a fresh process; a failure is a result too."""
    environment = {**os.environ, **dict.fromkeys(THREAD_VARIABLES, "1")}
    command = [sys.executable, "-m", f"{HERE.name}.evidence", "--row", name]
    try:
        ended = subprocess.run(
            command, capture_output=True, text=True, env=environment, timeout=LIMIT_S, check=False,
            cwd=HERE.parent,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return {"failed": f"no answer within {LIMIT_S:g} s"}
    if ended.returncode:
        words = ended.stderr.strip().splitlines()
        return {"failed": words[-1] if words else f"exit {ended.returncode}"}
    answer: dict[str, Any] = json.loads(ended.stdout.splitlines()[-1])
    return answer


def fill(path: Path, only: str = "", stale: bool = False, jobs: int = 1) -> int:
    """Run what is missing in a file of rows; returns the number of rows that were run.

    only: a prefix of their names; those of them that are stale are run as well. stale: all such.
    jobs: rows at a time. What is no row any more leaves the file.
    """
    every = list(rows())
    known = store.compact(path, {row.name for row in every})
    wanted = []
    for row in every:
        fresh = row.name in known and (known[row.name]["key"] == row.key or not (stale or only))
        if row.name.startswith(only) and not fresh:
            wanted.append(row)

    def run(row: EvidenceRow) -> tuple[EvidenceRow, dict[str, Any], float]:
        started = time.monotonic()
        result = run_row(row.name)
        return row, result, time.monotonic() - started

    with ThreadPoolExecutor(jobs) as pool:
        for i, (row, result, seconds) in enumerate(pool.map(run, wanted), 1):
            print(f"{i}/{len(wanted)} {row.name}: {seconds:.0f} s", file=sys.stderr, flush=True)
            store.append(path, {
                "key": row.key, "result": result, "seconds": round(seconds, 1), "threads": 1,
                "load": [round(v, 1) for v in os.getloadavg()],
                "machine": describe_machine(), "versions": library_versions(PACKAGES),
            })  # fmt: skip
    return len(wanted)


def main() -> None:
    """Run what is missing and write it up; `--row NAME` is one row's own process."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--row", help=argparse.SUPPRESS)
    parser.add_argument("--only", default="", help="rows whose name starts with this, stale or not")
    parser.add_argument("--stale", action="store_true", help="run the stale ones again")
    parser.add_argument("--jobs", type=int, default=2, help="rows at a time, a core each")
    given = parser.parse_args()
    if given.row is not None:
        print(json.dumps(next(r for r in rows() if r.name == given.row).call(), allow_nan=False))
        return
    ran = fill(HERE / ROWS, given.only, given.stale, given.jobs)
    entries = store.compact(HERE / ROWS)
    out = HERE / TABLES
    write_up(out, entries, [row.key for row in rows()])
    print(f"{ran} rows run; {out.relative_to(HERE.parent)} written")


if __name__ == "__main__":
    main()
