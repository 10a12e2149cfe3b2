"""`deltact-fab calibrate`: what turns images into millimetres and newtons, one file each."""

from __future__ import annotations

from pathlib import Path

import click

from ..group import CommandGroup, tell_moved
from .depth import depth
from .force import force
from .lens import lens


class _Calibrate(CommandGroup):
    """Until version 0.4 the images of a lens may stand where its name does now."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args[0] not in self.commands and (args[0][:1] == "-" or Path(args[0]).exists()):
            tell_moved(ctx.command_path, "calibrate lens")
            args = ["lens", *args]
        return super().resolve_command(ctx, args)


@click.group(
    cls=_Calibrate,
    commands=[lens, depth, force],
    context_settings={"ignore_unknown_options": True},
)
def calibrate() -> None:
    """Calibrations of a sensor, in this order: lens, depth, force. Each is one file."""
