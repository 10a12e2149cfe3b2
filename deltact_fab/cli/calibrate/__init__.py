"""`deltact-fab calibrate`: what turns images into millimetres and newtons, one file each."""

from __future__ import annotations

import click

from ..group import CommandGroup
from .depth import depth
from .force import force
from .lens import lens


@click.group(
    cls=CommandGroup,
    commands=[lens, depth, force],
    context_settings={"ignore_unknown_options": True},
)
def calibrate() -> None:
    """Calibrations of a sensor, in this order: lens, depth, force. Each is one file."""
