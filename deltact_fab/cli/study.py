"""`deltact-fab study`: the paper's experiments, on the virtual rig or on recorded runs."""

from __future__ import annotations

from typing import Any

import click

from .study_index import index


@click.group()
def study() -> None:
    """The paper's experiments, and better ones: list, run, index."""


@study.command("list")
def list_() -> None:
    """Every study with one line."""
    from ..study.registry import STUDIES
    from .output import echo_table

    echo_table(("study", "what"), [(name, one.line) for name, one in STUDIES.items()])


class Studies(click.Group):
    """A command for each study, made when it is asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        from ..study.registry import STUDIES

        return list(STUDIES)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        from ..study.registry import find
        from .study_command import command

        return command(cmd_name, find(cmd_name))

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        from ..study.registry import STUDIES

        with formatter.section("Studies"):
            formatter.write_dl([(name, one.line) for name, one in STUDIES.items()])


@study.group("run", cls=Studies)
def run(**_: Any) -> None:
    """Run a study: a page, tables and figures in a folder.

    What a study computes is kept: stopped or killed, the same command goes on where it was.
    """


study.add_command(index)
