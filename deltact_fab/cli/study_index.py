"""`deltact-fab study index`: one page over a folder of runs and studies."""

from __future__ import annotations

from pathlib import Path

import click


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path, dir_okay=False),
              help="Default FOLDER/index.html.")  # fmt: skip
def index(folder: Path, output: Path | None) -> None:
    """Write a page over all runs and studies below FOLDER, unfinished and damaged ones marked."""
    from ..report.index_page import write

    click.echo(str(write(folder, output or folder / "index.html")))
