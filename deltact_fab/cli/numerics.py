"""`deltact-fab numerics`: error against CPU time, stability, and what a scene may leave out."""

from __future__ import annotations

from pathlib import Path

import click

from .options import ENGINE_NAME, JSON, out_folder


@click.command(epilog="Example: deltact-fab numerics layer --quick")
@click.argument("engines", nargs=-1, metavar="[ENGINE]...", type=ENGINE_NAME)
@click.option("--quick", is_flag=True, help="Only a few settings and cases of each engine.")
@out_folder("Folder for a page, JSON and CSV.")
@JSON
def numerics(engines: tuple[str, ...], quick: bool, out: Path | None, as_json: bool) -> None:
    """Error against CPU time, and stability, of the numerical engines.

    ENGINE is pattern, flow, layer, gel, lens, measure, or bench: what each fault does to a run on a
    simulated bench, at each moment of it. The default is all of them. Each time is the
    best of several runs, with the slowest beside it. Nothing is measured on hardware. Exit code 1
    when a row is wrong.
    """
    from ..errors import MissingLibrary
    from ..numerics import harness
    from .output import echo_json, echo_table, progress

    with progress("numerics") as report:
        found = harness.run(engines, quick, report)
    files: list[Path] = []
    if out is not None:
        try:
            files = found.save(out)
        except MissingLibrary as why:
            click.echo(f"no page: {why}", err=True)
    if as_json:
        echo_json(found.as_dict())
    else:
        echo_table(
            ("engine", "case", "series", "setting", "threads", "cpu_s", "to, s", "wall_s",
             "compile_s", "peak_mb", "error", "unit", "reference", "of the reference",
             "times as fast", "as", "pareto"),
            [(r.engine, r.case, r.series, r.setting, r.threads, r.cpu_s, r.cpu_most_s,
              r.wall_s, r.compile_s, r.peak_mb, r.error, r.unit,
              f"{r.kind}: {r.reference}", r.reference_error, r.times_as_fast, r.baseline,
              "*" if r.pareto else "")
             for r in found.curves],
            names=4,
        )  # fmt: skip
        click.echo()
        echo_table(
            ("engine", "outcome", "case", "expectation", "figure", "bound", "unit"),
            [(r.engine, r.outcome, r.case, r.expectation, r.figure, r.bound, r.unit)
             for r in found.stability],
            names=3,
        )  # fmt: skip
        for table in found.tables:
            click.echo(f"\n{table['title']}: {table['note']}")
            echo_table(table["columns"], table["rows"])
        click.echo("\nwhat leaving a layer out of a scene saves")
        echo_table(
            ("layer", "CPU seconds", "MB", "modules", "note"),
            [(r.layer, r.seconds, r.megabytes, r.modules, r.note) for r in found.scenes],
        )
        if files:
            click.echo("\nwritten: " + ", ".join(str(f) for f in files))
    for row in found.wrong:
        said = row.note or f"{row.figure} over {row.bound} {row.unit}"
        click.echo(f"deltact-fab: wrong: {row.engine}: {row.case}: {said}", err=True)
    if found.wrong:
        raise click.exceptions.Exit(1)
