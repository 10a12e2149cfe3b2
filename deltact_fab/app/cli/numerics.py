"""`deltact-fab numerics`: error against CPU time, and stability."""

from __future__ import annotations

from pathlib import Path

import click

from .options import out_folder
from .output import Answer, answers, columns_of, files_line, progress

CURVES = (
    "engine", "case", "series", "setting", "cpu_s", "cpu_most_s", "wall_s", "compile_s", "peak_mb",
    "error", "unit", "kind", "reference", "reference_error", "times_as_fast", "baseline", "pareto",
)  # fmt: skip
CASES = ("engine", "outcome", "case", "expectation", "figure", "bound", "unit")


@click.command(epilog="Example: deltact-fab numerics pattern --quick")
@click.argument("engines", nargs=-1, metavar="[ENGINE]...")
@click.option("--quick", is_flag=True, help="Only a few settings and cases of each engine.")
@out_folder("Folder for a page, JSON and CSV.")
@answers
def numerics(engines: tuple[str, ...], quick: bool, out: Path | None) -> Answer:
    """Error against CPU time, and stability, of the numerical engines.

    ENGINE is pattern, flow, gel or measure; the default is all of them. Each time is the best of
    several runs, with the slowest beside it. Nothing is measured on hardware. Exit code 1 when a
    row is wrong.
    """
    from deltact_fab.common import require_pages
    from deltact_fab.studies import run_engines

    if out is not None:
        require_pages()
    with progress("numerics") as report:
        result = run_engines(engines, quick, report)
    asides = []
    lines = [*columns_of(CURVES, result.curves), "", *columns_of(CASES, result.stability)]
    for row in result.wrong:
        reason = row["note"] or f"{row['figure']} over {row['bound']} {row['unit']}"
        asides.append(f"deltact-fab: wrong: {row['engine']}: {row['case']}: {reason}")
    if out is not None:
        lines += ["", files_line(result.save(out))]
    return Answer(result.as_dict(), lines, "" if result.wrong else None, asides)
