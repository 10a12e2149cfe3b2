"""Groups of commands: in the order in which they are used, and a near miss told what was meant."""

from __future__ import annotations

import importlib
import inspect
import re
from pathlib import Path

import click

from deltact_fab.common import did_you_mean

MOVED = {
    "analyze force": "calibrate force",
    "cad cameras": "cad list cameras",
    "cad designs": "cad list designs",
    "calibrate-depth": "calibrate depth",
    "calibrate PATH": "calibrate lens",
    "pattern from": "pattern make",
    "rig probe": "rig check",
    "study index": "report",
}
"""What was typed before, and what is typed now. PATH: an option or a path, which stays."""

BEGIN = ("init", "demo", "doctor", "schema")


class CommandGroup(click.Group):
    """A group whose commands stand in its help as they were added. noun: what one is called."""

    noun = "command"

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
        name, commands = args[0], self.list_commands(ctx)
        if name in commands or ctx.resilient_parsing:
            return super().resolve_command(ctx, args)
        typed = "" if self.name == "main" else str(self.name)
        is_path = name.startswith("-") or Path(name).exists()
        for old, remaining in ((name, args[1:]), ("PATH" if is_path else "", args)):
            if replacement := MOVED.get(f"{typed} {old}".strip()):
                old_words = f"{typed} {'' if remaining is args else old}".strip()
                notice = f"`deltact-fab {old_words}` is now `deltact-fab {replacement}`"
                click.echo(f"{notice}; the old name is removed in 0.4", err=True)
                return _resolve_words(replacement, remaining)
        # An option that stands where a command should is click's to refuse.
        if not name.startswith("-"):
            raise click.UsageError(
                f"{name!r}: no such {self.noun}; {did_you_mean(name, commands)}", ctx
            )
        return super().resolve_command(ctx, args)


def load_command(noun: str) -> click.Command:
    """The command of a noun, which stands in the module of its name, or in `begin`."""
    module = "begin" if noun in BEGIN else noun
    command: click.Command = getattr(importlib.import_module(f"{__package__}.{module}"), noun)
    return command


def _resolve_words(typed: str, args: list[str]) -> tuple[str, click.Command, list[str]]:
    """What `resolve_command` gives for words that are typed, as in "cad list designs"."""
    noun, *words = typed.split()
    command = load_command(noun)
    while isinstance(command, click.Group):
        command = command.commands[words.pop(0)]
    return str(command.name), command, [*words, *args]
