"""`deltact-fab demo`: everything once, on the virtual rig."""

from __future__ import annotations

from pathlib import Path

import click

from .options import JSON, out_folder, seed
from .output import echo_json, progress


@click.command()
@out_folder("Folder to write; that of an earlier demo is replaced.", default=Path("demo-out"))
@seed("Seed of everything random.", 3)
@JSON
def demo(out: Path, seed: int, as_json: bool) -> None:
    """Run the whole chain once: parts, pattern, calibration, a virtual experiment, its report."""
    from .. import demo as chain

    lines: list[str] = []
    page = chain.run(out, seed, progress, lines.append if as_json else click.echo)
    if as_json:
        echo_json({"file": str(page), "seed": seed, "lines": lines})
