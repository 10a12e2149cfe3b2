"""`deltact-fab report`: one offline page of a run."""

from __future__ import annotations

from pathlib import Path

import click

from .options import JSON, PATH, out_file


@click.command(epilog="Example: deltact-fab report smoke-run -o smoke.html")
@click.argument("run", type=PATH)
@out_file("Page to write.", show_default="RUN/report.html")
@click.option("--calibration", "calibrations", multiple=True, type=PATH, metavar="FILE",
              show_default="those in RUN/analysis",
              help="Calibration of force or depth; repeatable.")  # fmt: skip
@JSON
def report(run: Path, out: Path | None, calibrations: tuple[Path, ...], as_json: bool) -> None:
    """Write one offline page about RUN, after its tracking analysis where that is missing."""
    from .. import record
    from ..analysis.measured import calibrations_of, measured
    from ..analysis.tracking_error import TrackingResult, analyse
    from ..report.page import write, write_imported
    from ..report.templating import require_pages
    from .output import echo_written, progress

    require_pages()
    folder, opened = run / "analysis", record.open(run)
    if opened.imported:
        echo_written(write_imported(opened, out or run / "report.html"), as_json)
        return
    files = calibrations_of(opened, calibrations)
    if (folder / "tracking.json").is_file():
        result = TrackingResult.load(folder)
    else:
        with progress("tracking error") as bar:
            result = analyse(run, progress=bar)
        result.save(folder)
    with progress("shape and force") as bar:
        found = measured(opened, files, bar)
    page = write(run, out or run / "report.html", result, found)
    echo_written(page, as_json)
