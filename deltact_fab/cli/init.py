"""`deltact-fab init`: a folder of a lab's own files."""

from __future__ import annotations

from pathlib import Path

import click

from .options import JSON, PATH


@click.command(epilog="Example: deltact-fab init my-lab")
@click.argument("folder", type=PATH)
@JSON
def init(folder: Path, as_json: bool) -> None:
    """Make a working folder with files of your own.

    FOLDER, which must be new or empty, gets the shipped designs, patterns, protocols and rigs,
    schemas for an editor, and a README with a first tour. Commands that run inside it prefer its
    files.
    """
    from ..lab import init as write
    from .output import echo_result

    files = write(folder)
    told = f"{folder}: {len(files)} files written; `cd {folder}`, then see README.md"
    echo_result([str(file) for file in files], [told], as_json)
