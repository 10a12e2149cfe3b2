"""`deltact-fab numerics`: error against CPU time, and stability."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import click

from .options import out_folder, seed
from .output import Answer, answers, columns_of, files_line, progress

CURVE_COLUMNS = (
    "engine", "case", "series", "setting", "cpu_s", "cpu_most_s", "wall_s", "compile_s", "peak_mb",
    "error", "unit", "kind", "reference", "reference_error", "times_as_fast", "baseline", "pareto",
    "recommended",
)  # fmt: skip
CASE_COLUMNS = ("engine", "outcome", "case", "expectation", "figure", "bound", "unit")


def map_line(result: Any) -> str:
    """Summary of the map of extremes."""
    counts = Counter(row["outcome"] for row in result.extremes)
    words = ", ".join(f"{counts[name]} {name}" for name in ("right", "flagged", "refused", "wrong"))
    about = result.meta["map"]
    stale = f"; code changed since: {', '.join(about['stale'])}" if about["stale"] else ""
    n = sum(row["anew"] for row in result.extremes)
    return (
        f"map of {about['date']}, simulated: {words}; {n} cells anew, "
        f"--seed {result.meta['seed']}{stale}"
    )


@click.command(epilog="Example: deltact-fab numerics pattern --quick")
@click.argument("engines", nargs=-1, metavar="[ENGINE]...")
@click.option("--quick", is_flag=True, help="Only a few settings and cases of each engine.")
@seed("Seed of the cells that are computed anew; random by default.", None)
@out_folder("Folder for a page, JSON and CSV.")
@answers
def numerics(engines: tuple[str, ...], quick: bool, seed: int | None, out: Path | None) -> Answer:
    """Measure error against CPU time, and stability, of the numerical engines.

    ENGINE is gel, camera, flow, contact, measure, pattern or search; default: all. Each time is the
    best of several runs, with the slowest next to it. A tenth of the stored map of extremes is
    computed anew. No hardware is used. Exit code 1 if a row is wrong.
    """
    from deltact_fab.common import require_pages
    from deltact_fab.studies import run_engines

    if out is not None:
        require_pages()
    with progress("numerics") as report:
        result = run_engines(engines, quick, report, seed)
    asides = []
    curves = columns_of(CURVE_COLUMNS, result.curves)
    anew = [row for row in result.extremes if row["anew"] or row["outcome"] == "wrong"]
    lines = [*curves, "", *columns_of(CASE_COLUMNS, result.stability + anew)]
    if result.extremes:
        lines += ["", map_line(result)]
    for row in result.wrong:
        reason = row["note"] or f"{row['figure']} over {row['bound']} {row['unit']}"
        asides.append(f"deltact-fab: wrong: {row['engine']}: {row['case']}: {reason}")
    if out is not None:
        lines += ["", files_line(result.save(out))]
    return Answer(result.as_dict(), lines, "" if result.wrong else None, asides)
