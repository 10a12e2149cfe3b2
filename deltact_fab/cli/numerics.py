"""`deltact-fab numerics`: error against CPU time, and stability."""

from __future__ import annotations

from pathlib import Path

import click

from ..errors import MissingLibrary
from .options import ENGINE_NAME, out_folder
from .output import Answer, answers, files_line, progress, table

# Heads and keys of the rows.
CURVES = {
    "engine": "engine", "case": "case", "series": "series", "setting": "setting", "cpu_s": "cpu_s",
    "to, s": "cpu_most_s", "wall_s": "wall_s", "compile_s": "compile_s", "peak_mb": "peak_mb",
    "error": "error", "unit": "unit", "reference": "reference", "of the reference":
    "reference_error", "times as fast": "times_as_fast", "as": "baseline", "pareto": "pareto",
}  # fmt: skip
CASES = ("engine", "outcome", "case", "expectation", "figure", "bound", "unit")


@click.command(epilog="Example: deltact-fab numerics pattern --quick")
@click.argument("engines", nargs=-1, metavar="[ENGINE]...", type=ENGINE_NAME)
@click.option("--quick", is_flag=True, help="Only a few settings and cases of each engine.")
@out_folder("Folder for a page, JSON and CSV.")
@answers
def numerics(engines: tuple[str, ...], quick: bool, out: Path | None) -> Answer:
    """Error against CPU time, and stability, of the numerical engines.

    ENGINE is pattern, flow, gel or measure; the default is all of them. Each time is the best of
    several runs, with the slowest beside it. Nothing is measured on hardware. Exit code 1 when a
    row is wrong.
    """
    from ..numerics import harness

    with progress("numerics") as report:
        found = harness.run(engines, quick, report)
    written, asides = [], []
    if out is not None:
        try:
            written = ["", files_line(found.save(out))]
        except MissingLibrary as why:
            asides.append(f"no page: {why}")
    told = [{**row, "reference": f"{row['kind']}: {row['reference']}",
             "pareto": "*" if row["pareto"] else ""} for row in found.curves]  # fmt: skip
    lines = [
        *table(tuple(CURVES), [[r[k] for k in CURVES.values()] for r in told], names=4),
        "",
        *table(CASES, [[row[k] for k in CASES] for row in found.stability], names=3),
    ]
    for row in found.wrong:
        said = row["note"] or f"{row['figure']} over {row['bound']} {row['unit']}"
        asides.append(f"deltact-fab: wrong: {row['engine']}: {row['case']}: {said}")
    failed = "" if found.wrong else None
    return Answer(found.as_dict(), [*lines, *written], failed, asides)
