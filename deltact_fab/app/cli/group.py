"""Command groups: commands in order of use, suggestions for misspelt and moved ones."""

from __future__ import annotations

import importlib
import inspect
import re
from pathlib import Path

import click

from deltact_fab.common import did_you_mean

MOVED_COMMANDS = {
    "analyze force": "calibrate force",
    "cad cameras": "cad list cameras",
    "cad designs": "cad list designs",
    "calibrate-depth": "calibrate depth",
    "calibrate PATH": "calibrate lens",
    "pattern from": "pattern make",
    "rig probe": "rig check",
    "study index": "report",
}
"""Old forms and their replacements. PATH: an option or a path, which is passed on."""

BEGIN_COMMANDS = ("init", "demo", "doctor", "schema")


class CommandGroup(click.Group):
    """Group that lists commands in the order added. noun: name of one in messages."""

    noun = "command"

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        rows = []
        for name in self.list_commands(ctx):
            command = self.get_command(ctx, name)
            text = "" if command is None else inspect.cleandoc(command.help or "")
            # The complete first sentence: click's own short help is truncated.
            rows.append((name, re.split(r"(?<=\.)\s|\n\n", text, maxsplit=1)[0]))
        with formatter.section("Commands"):
            formatter.write_dl(rows)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        name, commands = args[0], self.list_commands(ctx)
        if name in commands or ctx.resilient_parsing:
            return super().resolve_command(ctx, args)
        typed = "" if self.name == "main" else str(self.name)
        is_path = name.startswith("-") or Path(name).exists()
        for old, remaining in ((name, args[1:]), ("PATH" if is_path else "", args)):
            if replacement := MOVED_COMMANDS.get(f"{typed} {old}".strip()):
                old_words = f"{typed} {'' if remaining is args else old}".strip()
                notice = f"`deltact-fab {old_words}` is now `deltact-fab {replacement}`"
                click.echo(f"{notice}; the old name is removed in 0.4", err=True)
                return _resolve_words(replacement, remaining)
        # An option in place of a command is refused by click.
        if not name.startswith("-"):
            raise click.UsageError(
                f"{name!r}: no such {self.noun}; {did_you_mean(name, commands)}", ctx
            )
        return super().resolve_command(ctx, args)


def load_command(noun: str) -> click.Command:
    """Load the command of a noun from the module of its name, or from `begin`."""
    module = "begin" if noun in BEGIN_COMMANDS else noun
    command: click.Command = getattr(importlib.import_module(f"{__package__}.{module}"), noun)
    return command


def _resolve_words(typed: str, args: list[str]) -> tuple[str, click.Command, list[str]]:
    """Return the result of `resolve_command` for typed words, such as "cad list designs"."""
    noun, *words = typed.split()
    command = load_command(noun)
    while isinstance(command, click.Group):
        command = command.commands[words.pop(0)]
    return str(command.name), command, [*words, *args]
