"""`deltact-fab numerics`: error against CPU time, stability, and what a scene may leave out."""

from __future__ import annotations

from pathlib import Path

import click

from .options import out_folder
from .output import Answer, answers, columns_of, files_line, progress

CURVES = (
    "engine", "case", "series", "setting", "cpu_s", "cpu_most_s", "wall_s", "compile_s", "peak_mb",
    "error", "unit", "reference", "reference_error", "times_as_fast", "baseline", "pareto",
)  # fmt: skip
CASES = ("engine", "outcome", "case", "expectation", "figure", "bound", "unit")
COSTS = ("layer", "seconds", "megabytes", "modules", "note")


@click.command(epilog="Example: deltact-fab numerics lens --quick")
@click.argument("engines", nargs=-1, metavar="[ENGINE]...")
@click.option("--quick", is_flag=True, help="Only a few settings and cases of each engine.")
@out_folder("Folder for a page, JSON and CSV.")
@answers
def numerics(engines: tuple[str, ...], quick: bool, out: Path | None) -> Answer:
    """Error against CPU time, and stability, of the numerical engines.

    ENGINE is pattern, flow, gel, lens, measure, or bench: what each fault does to a run on a
    simulated bench, at each moment of it. The default is all of them. Each time is the
    best of several runs, with the slowest beside it. Nothing is measured on hardware. Exit code 1
    when a row is wrong.
    """
    from ..numerics import harness
    from ..report.templating import require_pages

    if out is not None:
        require_pages()
    with progress("numerics") as report:
        found = harness.run(engines, quick, report)
    asides = []
    lines = [
        *columns_of(CURVES, found.curves),
        "",
        *columns_of(CASES, found.stability),
        "\nwhat leaving a layer out of a scene saves, in CPU seconds and MB",
        *columns_of(COSTS, found.scenes),
    ]
    for row in found.wrong:
        said = row["note"] or f"{row['figure']} over {row['bound']} {row['unit']}"
        asides.append(f"deltact-fab: wrong: {row['engine']}: {row['case']}: {said}")
    if out is not None:
        lines += ["", files_line(found.save(out))]
    return Answer(found.as_dict(), lines, "" if found.wrong else None, asides)
