"""`deltact-fab numerics`: error against CPU time, stability, and what a scene may leave out."""

from __future__ import annotations

from pathlib import Path

import click


@click.command()
@click.argument("engines", nargs=-1, metavar="[ENGINE]...")
@click.option("--quick", is_flag=True, help="A few settings and cases of each engine.")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False),
              help="Folder for numerics.html, JSON and CSV.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def numerics(engines: tuple[str, ...], quick: bool, out: Path | None, as_json: bool) -> None:
    """Error against CPU time and stability of the numerical engines; exit 1 if any row is wrong.

    ENGINE: pattern, sheet, flow, measure, layer, gel, cad, or bench, which is what each fault does
    to a run, at each moment of it, on a simulated bench; all by default. A time is the best of
    several runs, with the slowest beside it. Nothing is measured on hardware.
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
             "compile_s", "peak_mb", "error", "unit", "of the reference", "pareto"),
            [(r.engine, r.case, r.series, r.setting, r.threads, r.cpu_s, r.cpu_most_s,
              r.wall_s, r.compile_s, r.peak_mb, r.error, r.unit, r.reference_error,
              "*" if r.pareto else "")
             for r in found.curves],
        )  # fmt: skip
        click.echo()
        echo_table(
            ("engine", "outcome", "case", "expectation", "figure", "bound", "unit"),
            [(r.engine, r.outcome, r.case, r.expectation, r.figure, r.bound, r.unit)
             for r in found.stability],
        )  # fmt: skip
        for table in found.tables:
            click.echo(f"\n{table['title']}: {table['note']}")
            echo_table(table["columns"], table["rows"])
        click.echo("\nleaving it out of a scene saves")
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
