"""`deltact-fab study`: the paper's experiments, on the virtual rig or on recorded runs."""

from __future__ import annotations

from typing import Any

import click

from .group import CommandGroup
from .output import Answer, answers, listed


@click.group(cls=CommandGroup)
def study() -> None:
    """The paper's experiments and better ones, on the virtual rig or on recorded runs."""


@study.command("list")
@answers
def list_() -> Answer:
    """Every study, with what it is about."""
    from ..study.registry import STUDIES

    return listed(("study", "about"), [(name, one.line) for name, one in STUDIES.items()])


class Studies(CommandGroup):
    """A command for each study, made when it is needed."""

    noun = "study"

    def list_commands(self, ctx: click.Context) -> list[str]:
        from ..study.registry import STUDIES

        return list(STUDIES)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        from ..study.registry import find
        from .study_command import command

        return command(cmd_name, find(cmd_name))


@study.group("run", cls=Studies)
def run(**_: Any) -> None:
    """Run a study, which writes a page, tables and figures into a folder.

    Whatever a study computes is kept: when it is stopped, the same command continues.
    """
