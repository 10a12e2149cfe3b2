"""`deltact-fab analyze`: figures of recorded runs."""

from __future__ import annotations

import click

from ..group import CommandGroup
from .shape import shape
from .tracking import tracking


@click.group(cls=CommandGroup, commands=[tracking, shape])
def analyze() -> None:
    """Analyses of recorded runs: tracking error, shape."""
