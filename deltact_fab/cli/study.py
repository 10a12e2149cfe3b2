"""`deltact-fab study`: the paper's experiments, on the virtual rig or on recorded runs."""

from __future__ import annotations

from pathlib import Path

import click

from .options import JSON, SEED
from .study_index import index


@click.group()
def study() -> None:
    """The paper's experiments, and better ones: list, run, index."""


study.add_command(index)


@study.command("list")
def list_() -> None:
    """Every study with one line."""
    from ..study.registry import STUDIES
    from .output import echo_table

    echo_table(("study", "what"), [(name, line) for name, (_, line) in STUDIES.items()])


@study.command("run")
@click.argument("name")
@click.option("--scale", type=click.FloatRange(0, 1, min_open=True), help="Share of the paper's.")
@click.option("--out", type=click.Path(path_type=Path), help="Folder of page and tables.")
@click.option("--from", "runs", multiple=True, type=click.Path(path_type=Path), help="A run.")
@click.option("--rig", help="A virtual rig.")
@click.option("--seed", default=0, show_default=True, type=SEED)
@JSON
def run(
    name: str,
    scale: float | None,
    out: Path | None,
    runs: tuple[Path, ...],
    rig: str | None,
    seed: int,
    as_json: bool,
) -> None:
    """Run a study."""
    from ..report.study_page import write
    from ..study.asked import Asked
    from ..study.registry import run as run_study
    from .output import echo_json, progress

    with progress(name) as tick:
        found = run_study(name, Asked(scale, seed, rig, runs, progress=tick))
    if out is not None:
        click.echo(write(found, out), err=True)
    if as_json:
        echo_json(found.data)
    else:
        for line in found.verdict:
            click.echo(line)
