"""Every command that README and how-tos show exists, with the options that they show."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import click
import pytest
from doc_pages import ROOT, blocks, commands

from deltact_fab.app.cli.main import main

PAGES = [
    ROOT / "README.md",
    ROOT / "deltact_fab/assets/tour.md",
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs/how-to").glob("*.md")),
    *sorted((ROOT / "docs/tutorials").glob("*.md")),
]
IN_A_SENTENCE = re.compile(r"`(deltact-fab [a-z][^`|]*)`")


def shown(page: Path) -> list[str]:
    """The commands of a page, as they are typed: in its blocks, and in its sentences."""
    lines = [c for b in blocks(page) if b.language == "console" for c in commands(b)]
    typed = [line for line in lines if line.startswith("deltact-fab ")]
    return [c for c in typed + IN_A_SENTENCE.findall(page.read_text()) if "…" not in c]


def words_of(line: str) -> list[str]:
    words = shlex.split(re.split(r" (?:\||>|&&) ", line)[0], comments=True)
    return [word for word in words[1:] if not word.startswith("[")]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_that_is_shown_exists(page: Path) -> None:
    for line in shown(page):
        for part in line.split("`, `"):
            words = words_of(part)
            command: click.Command = main
            context = click.Context(main)
            while isinstance(command, click.Group) and words and not words[0].startswith("-"):
                name = words.pop(0).rstrip(",")
                found = command.get_command(context, name)
                assert found is not None, f"{page.name}: {line}: no command {name!r}"
                command = found
                context = click.Context(found, context, **found.context_settings)
            try:
                command.make_parser(context).parse_args([*words])
            except click.UsageError as why:
                pytest.fail(f"{page.name}: {line}: {why.format_message()}")
