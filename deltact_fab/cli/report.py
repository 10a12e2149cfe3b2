"""`deltact-fab report`: one offline page of a run."""

from __future__ import annotations

from pathlib import Path

import click

from .options import PATH, checked, out_file
from .output import Answer, answers, progress, written


@click.command(epilog="Example: deltact-fab report smoke-run -o smoke.html")
@click.argument("run", type=PATH)
@out_file("Page to write.", show_default="report.html in RUN, or index.html in a folder of runs")
@click.option("--calibration", "calibrations", multiple=True, type=PATH, metavar="FILE",
              show_default="those in RUN/analysis",
              help="Calibration of force or depth; repeatable.")  # fmt: skip
@answers
def report(run: Path, out: Path | None, calibrations: tuple[Path, ...]) -> Answer:
    """Write one offline page about RUN, after its tracking analysis where that is missing.

    Of a folder with runs and studies below it, the page lists them all; unfinished and damaged
    ones are marked.
    """
    from .. import record
    from ..analysis.measured import calibrations_of, measured
    from ..analysis.tracking_error import TrackingResult, analyse
    from ..report import index_page
    from ..report.page import write, write_imported
    from ..report.templating import require_pages

    require_pages()
    if index_page.is_above(run):
        return written(index_page.write(run, out or checked(run / "index.html")))
    opened = record.open(run)
    page = out or checked(run / "report.html")
    if opened.imported:
        return written(write_imported(opened, page))
    folder, files = run / "analysis", calibrations_of(opened, calibrations)
    if (folder / "tracking.json").is_file():
        result = TrackingResult.load(folder)
    else:
        with progress("tracking error") as bar:
            result = analyse(run, progress=bar)
        result.save(folder)
    with progress("shape and force") as bar:
        found = measured(opened, files, bar)
    return written(write(run, page, result, found))
