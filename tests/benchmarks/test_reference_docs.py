"""docs/reference says what the program has, all of it, and nothing else."""

from __future__ import annotations

import click

from benchmarks import reference


def test_pages_match_the_program() -> None:
    kept = {file.name: file.read_text() for file in reference.FOLDER.glob("*.md")}
    assert kept == reference.pages(), "python -m benchmarks.reference writes them anew"


def test_commands_and_options_have_help() -> None:
    silent = []
    for context, command in reference.commands():
        if command.hidden or not (command.help or "").strip():
            silent.append(context.command_path)
        for param in command.params:
            if isinstance(param, click.Option) and (param.hidden or not (param.help or "").strip()):
                silent.append(f"{context.command_path} {param.opts[0]}")
    assert not silent


def test_pages_hold_nothing_of_this_machine() -> None:
    for text in reference.pages().values():
        assert str(reference.FOLDER.parents[1]) not in text
        assert "/home/" not in text
