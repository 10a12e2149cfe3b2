"""`deltact-fab init`: a folder of a lab's own files."""

from __future__ import annotations

from pathlib import Path

import click

from .options import JSON


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@JSON
def init(folder: Path, as_json: bool) -> None:
    """Write a working folder to begin with.

    FOLDER gets the shipped designs, patterns, protocols and rigs as files of your own, schemas for
    an editor, and a README with a first tour. Commands that run inside it prefer its files. It
    must be new or empty.
    """
    from ..lab import init as write
    from .output import echo_json

    files = write(folder)
    if as_json:
        echo_json([str(file) for file in files])
        return
    click.echo(f"{folder}: {len(files)} files written; `cd {folder}`, then see README.md")
