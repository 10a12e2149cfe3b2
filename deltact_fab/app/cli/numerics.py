"""`deltact-fab numerics`: error against CPU time, and stability."""

from __future__ import annotations

from pathlib import Path

import click

from .options import out_folder
from .output import Answer, answers, columns_of, files_line, progress

CURVE_COLUMNS = (
    "engine", "case", "series", "setting", "cpu_s", "cpu_most_s", "wall_s", "compile_s", "peak_mb",
    "error", "unit", "kind", "reference", "reference_error", "times_as_fast", "baseline", "pareto",
    "recommended",
)  # fmt: skip
CASE_COLUMNS = ("engine", "outcome", "case", "expectation", "figure", "bound", "unit")


@click.command(epilog="Example: deltact-fab numerics pattern --quick")
@click.argument("engines", nargs=-1, metavar="[ENGINE]...")
@click.option("--quick", is_flag=True, help="Only a few settings and cases of each engine.")
@out_folder("Folder for a page, JSON and CSV.")
@answers
def numerics(engines: tuple[str, ...], quick: bool, out: Path | None) -> Answer:
    """Measure error against CPU time, and stability, of the numerical engines.

    ENGINE is pattern, flow, gel or measure; default: all. Each time is the best of several runs,
    with the slowest next to it. No hardware is used. Exit code 1 if a row is wrong.
    """
    from deltact_fab.common import require_pages
    from deltact_fab.studies import run_engines

    if out is not None:
        require_pages()
    with progress("numerics") as report:
        result = run_engines(engines, quick, report)
    asides = []
    curves = columns_of(CURVE_COLUMNS, result.curves)
    lines = [*curves, "", *columns_of(CASE_COLUMNS, result.stability)]
    for row in result.wrong:
        reason = row["note"] or f"{row['figure']} over {row['bound']} {row['unit']}"
        asides.append(f"deltact-fab: wrong: {row['engine']}: {row['case']}: {reason}")
    if out is not None:
        lines += ["", files_line(result.save(out))]
    return Answer(result.as_dict(), lines, "" if result.wrong else None, asides)
