"""`deltact-fab study`: the paper's experiments, on the virtual rig or on recorded runs.

The command of each is made from what the registry declares: asked, run, written, told.
"""

from __future__ import annotations

from concurrent.futures import Executor
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .group import CommandGroup
from .options import NAME_OR_PATH, ON, PATH, PROCESSES, Decorator, Finite, out_folder, seed
from .output import Answer, answers, listed, progress

if TYPE_CHECKING:
    from deltact_fab.studies import Study

OUT = "study-out"


@click.group(cls=CommandGroup)
def study() -> None:
    """The paper's experiments and better ones, on the virtual rig or on recorded runs."""


@study.command("list")
@answers
def list_() -> Answer:
    """Every study, with what it is about."""
    from deltact_fab.studies import STUDIES

    return listed(("study", "about"), [(name, one.line) for name, one in STUDIES.items()])


class Studies(CommandGroup):
    """A command for each study, made when it is needed."""

    noun = "study"

    def list_commands(self, ctx: click.Context) -> list[str]:
        from deltact_fab.studies import STUDIES

        return list(STUDIES)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        from deltact_fab.studies import find_study

        return command(cmd_name, find_study(cmd_name))


@study.group("run", cls=Studies)
def run(**_: Any) -> None:
    """Run a study, which writes a page, tables and figures into a folder.

    Whatever a study computes is kept: when it is stopped, the same command continues.
    """


def _common(scale: float | None) -> dict[str, tuple[Decorator, ...]]:
    """The options that studies share, by what `Study.takes` calls them."""
    return {
        "scale": (
            click.option("--scale", type=Finite(0, 1, min_open=True), default=scale,
                         metavar="SHARE", help="Share of the paper's points or frames, up to 1."),
        ),
        "seed": (seed("Seed of everything random."),),
        "rig": (
            click.option("--rig", type=NAME_OR_PATH, metavar="RIG", show_default="the study's own",
                         help="Virtual rig: a name of `rig list` or a path."),
        ),
        "from": (
            click.option("--from", multiple=True, type=PATH, metavar="RUN",
                         help="A recorded run, in place of a simulated one; repeatable."),
        ),
        "grid": (PROCESSES, ON),
    }  # fmt: skip


def command(name: str, one: Study) -> click.Command:
    """`study run NAME`, with the options that this study takes."""
    options = [o for what, own in _common(one.scale).items() if what in one.takes for o in own]
    options += [click.option(flag, **given) for flag, given in one.options.items()]
    options.append(out_folder("Folder for the page and the tables.", default=Path(OUT) / name))
    options.append(
        out_folder("Also write the figures as SVG and PDF into this folder.", flag="--figures")
    )
    made = answers(lambda **given: _run(name, one, given))
    for option in reversed(options):
        made = option(made)
    about = f"{one.line}\n\n{one.about}".strip()
    return click.command(name, help=about, short_help=one.line)(made)


def _run(name: str, one: Study, given: dict[str, Any]) -> Answer:
    """Run a study with the options of its command, by their names.

    What would keep its page from being written is said before anything is computed.
    """
    from deltact_fab.common import open_executor
    from deltact_fab.present import require_ready_study, write_study_figures, write_study_page
    from deltact_fab.studies import StudyRequest, run_study

    out, figures = given["out"], given["figures"]
    require_ready_study(name, out)
    more = (flag.removeprefix("--").replace("-", "_") for flag in one.options)
    grid: AbstractContextManager[Executor | None] = nullcontext()
    if "on" in given:
        grid = open_executor(given["on"], given["jobs"])
    with grid as executor, progress(name) as tick:
        found = run_study(
            name,
            StudyRequest(
                scale=given.get("scale"),
                seed=given.get("seed", 0),
                rig=given.get("rig"),
                runs=given.get("from", ()),
                executor=executor,
                progress=tick,
                say=lambda text: click.echo(text, err=True),
                options={key: given[key] for key in more},
            ),
        )
    click.echo(f"report: {write_study_page(found, out)}", err=True)
    if figures is not None:
        files = write_study_figures(found, figures)
        click.echo(f"figures: {len(files)} files in {figures}", err=True)
    missing = (
        f"warning: {len(found.missing)} jobs have no result and are left out: "
        f"{', '.join(found.missing[:5])}{', ...' if len(found.missing) > 5 else ''}; "
        "the same command tries them again"
    )
    return Answer(found.data, found.verdict, asides=[missing] if found.missing else ())
