"""Groups of commands: in the order in which they are used, and a near miss told what was meant."""

from __future__ import annotations

import click

from ..errors import did_you_mean


class Group(click.Group):
    """A group whose commands stand in its help as they were added."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        name = args[0]
        known = self.list_commands(ctx)
        # An option that stands where a command should is click's to refuse.
        if name not in known and not name.startswith("-") and not ctx.resilient_parsing:
            raise click.UsageError(f"{name!r}: no such command; {did_you_mean(name, known)}", ctx)
        return super().resolve_command(ctx, args)
