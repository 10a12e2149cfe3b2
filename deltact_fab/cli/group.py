"""Groups of commands: in the order in which they are used, and a near miss told what was meant."""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Mapping
from types import MappingProxyType

import click

from ..errors import did_you_mean


def command_at(path: str, ctx: click.Context) -> click.Command:
    """A command by what is typed, as in "rig check"; its noun stands in the module of its name."""
    noun, *names = path.split()
    command = getattr(importlib.import_module(f"{__package__}.{noun}"), noun)
    for name in names:
        command = command.get_command(ctx, name)
    return command


def tell_moved(old: str, now: str) -> None:
    """One line on stderr: what was typed still works."""
    click.echo(f"`{old}` is `deltact-fab {now}` now; the old form goes with version 0.4", err=True)


class CommandGroup(click.Group):
    """A group whose commands stand in its help as they were added. noun: what one is called."""

    noun = "command"
    moved: Mapping[str, str] = MappingProxyType({})
    """Old names of commands, each with what is typed now; they go with version 0.4."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        rows = []
        for name in self.list_commands(ctx):
            command = self.get_command(ctx, name)
            text = "" if command is None else inspect.cleandoc(command.help or "")
            # The first sentence, whole: click's own short help ends in dots.
            rows.append((name, re.split(r"(?<=\.)\s|\n\n", text, maxsplit=1)[0]))
        with formatter.section("Commands"):
            formatter.write_dl(rows)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        name = args[0]
        if name in self.moved:
            tell_moved(f"{ctx.command_path} {name}", self.moved[name])
            return name, command_at(self.moved[name], ctx), args[1:]
        known = self.list_commands(ctx)
        # An option that stands where a command should is click's to refuse.
        if name not in known and not name.startswith("-") and not ctx.resilient_parsing:
            raise click.UsageError(
                f"{name!r}: no such {self.noun}; {did_you_mean(name, known)}", ctx
            )
        return super().resolve_command(ctx, args)
