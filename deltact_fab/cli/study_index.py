"""`deltact-fab study index`: one page over a folder of runs and studies."""

from __future__ import annotations

from pathlib import Path

import click

from .options import JSON, PATH, out_file


@click.command()
@click.argument("folder", type=PATH)
@out_file("Page to write.", show_default="FOLDER/index.html")
@JSON
def index(folder: Path, out: Path | None, as_json: bool) -> None:
    """Write one page that lists all runs and studies below FOLDER.

    Unfinished and damaged ones are marked.
    """
    from ..report.index_page import write
    from .output import echo_written

    echo_written(write(folder, out or folder / "index.html"), as_json)
