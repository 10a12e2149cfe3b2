"""`deltact-fab init`: a folder of a lab's own files."""

from __future__ import annotations

from pathlib import Path

import click

from .options import PATH
from .output import Answer, answers


@click.command(epilog="Example: deltact-fab init my-lab")
@click.argument("folder", type=PATH)
@answers
def init(folder: Path) -> Answer:
    """Make a working folder with files of your own.

    FOLDER, which must be new or empty, gets the shipped designs, patterns, protocols and rigs,
    schemas for an editor, and a README with a first tour. Commands that run inside it prefer its
    files.
    """
    from ..lab import init as write

    files = write(folder)
    told = f"{folder}: {len(files)} files written; `cd {folder}`, then see README.md"
    return Answer([str(file) for file in files], [told])
