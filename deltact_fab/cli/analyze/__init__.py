"""`deltact-fab analyze`: figures of recorded runs."""

from __future__ import annotations

import click

from .force import force
from .shape import shape
from .tracking import tracking


@click.group()
def analyze() -> None:
    """Analyses of recorded runs."""


analyze.add_command(force)
analyze.add_command(tracking)
analyze.add_command(shape)
