"""`deltact-fab report`: one offline page of a run."""

from __future__ import annotations

from pathlib import Path

import click


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Default RUN/report.html.")
@click.option("--calibration", "calibrations", multiple=True, type=click.Path(path_type=Path),
              help="Of force or depth, repeatable; default: those in RUN/analysis.")  # fmt: skip
def report(run: Path, output: Path | None, calibrations: tuple[Path, ...]) -> None:
    """Write the report of RUN; the tracking analysis is made first where it is missing."""
    from .. import record
    from ..analysis.measured import calibrations_of, measured
    from ..analysis.tracking_error import TrackingResult, analyse
    from ..numerics.scenes import costs as layer_costs
    from ..report.page import write
    from ..report.templating import require_pages
    from .output import progress

    require_pages()
    folder, opened = run / "analysis", record.open(run)
    files = calibrations_of(opened, calibrations)
    if (folder / "tracking.json").is_file():
        result = TrackingResult.load(folder)
    else:
        with progress("tracking error") as bar:
            result = analyse(run, progress=bar)
        result.save(folder)
    with progress("shape and force") as bar:
        found = measured(opened, files, bar)
    costs = [cost.as_dict() for cost in layer_costs()]
    click.echo(str(write(run, output or run / "report.html", result, found, layer_costs=costs)))
