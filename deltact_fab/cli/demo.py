"""`deltact-fab demo`: everything once, on the virtual rig."""

from __future__ import annotations

from pathlib import Path

import click

from .options import SEED


@click.command()
@click.option("--out", type=click.Path(path_type=Path), default=Path("demo-out"), show_default=True,
              help="Folder; one of an earlier demo is replaced.")  # fmt: skip
@click.option("--seed", type=SEED, default=3, show_default=True, help="Of all that is drawn.")
def demo(out: Path, seed: int) -> None:
    """Everything once: parts, pattern, a calibrated experiment on the virtual rig, its report."""
    from .. import demo as chain
    from .output import progress

    chain.run(out, seed, progress, click.echo)
