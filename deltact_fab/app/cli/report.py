"""`deltact-fab report`: one offline page of a run."""

from __future__ import annotations

from pathlib import Path

import click

from .options import PATH_TYPE, out_file, require_writable
from .output import Answer, answers, file_note, progress


@click.command(epilog="Example: deltact-fab report smoke-run -o smoke.html")
@click.argument("run", type=PATH_TYPE)
@out_file("Page to write.", show_default="report.html in RUN, or index.html in a folder of runs")
@click.option("--calibration", "calibrations", multiple=True, type=PATH_TYPE, metavar="FILE",
              show_default="those in RUN/analysis",
              help="Calibration of force or depth; repeatable.")  # fmt: skip
@answers
def report(run: Path, out: Path | None, calibrations: tuple[Path, ...]) -> Answer:
    """Write an offline page about RUN, after a tracking analysis if there is none.

    For a folder of runs and studies, the page lists them all; unfinished and damaged ones are
    marked.
    """
    from deltact_fab.bench import open_run
    from deltact_fab.common import require_pages
    from deltact_fab.estimate import (
        TrackingResult,
        analyse_tracking,
        find_calibrations,
        measure_run,
    )
    from deltact_fab.present import is_index_above, write_imported_page, write_index, write_run_page

    require_pages()
    if is_index_above(run):
        return file_note(write_index(run, out or require_writable(run / "index.html")))
    recording = open_run(run)
    page = out or require_writable(run / "report.html")
    if recording.imported:
        return file_note(write_imported_page(recording, page))
    folder, files = run / "analysis", find_calibrations(recording, calibrations)
    if (folder / "tracking.json").is_file():
        result = TrackingResult.load(folder)
    else:
        with progress("tracking error") as bar:
            result = analyse_tracking(run, progress=bar)
        result.save(folder)
    with progress("shape and force") as bar:
        measurement = measure_run(recording, files, bar)
    return file_note(write_run_page(run, page, result, measurement))
