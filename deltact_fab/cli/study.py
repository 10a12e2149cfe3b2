"""`deltact-fab study`: the paper's experiments, on the virtual rig or on recorded runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from .group import CommandGroup
from .options import JSON, PATH, out_file


@click.command()
@click.argument("folder", type=PATH)
@out_file("Page to write.", show_default="FOLDER/index.html")
@JSON
def index(folder: Path, out: Path | None, as_json: bool) -> None:
    """Write one page that lists all runs and studies below FOLDER.

    Unfinished and damaged ones are marked.
    """
    from ..report.index_page import write
    from .output import echo_written

    echo_written(write(folder, out or folder / "index.html"), as_json)


@click.group(cls=CommandGroup)
def study() -> None:
    """The paper's experiments and better ones, on the virtual rig or on recorded runs."""


@study.command("list")
@JSON
def list_(as_json: bool) -> None:
    """Every study, with what it is about."""
    from ..study.registry import STUDIES
    from .output import echo_rows

    rows = [(name, one.line) for name, one in STUDIES.items()]
    echo_rows(("study", "about"), rows, as_json)


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


study.add_command(index)
