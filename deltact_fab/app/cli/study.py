"""`deltact-fab study`: the paper's experiments, on the virtual rig or on recorded runs.

Each command is generated from its entry in the registry.
"""

from __future__ import annotations

from concurrent.futures import Executor
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .group import CommandGroup
from .options import GRID_OPTIONS, NAME_OR_PATH, PATH_TYPE, Decorator, Finite, out_folder, seed
from .output import Answer, answers, listing, progress

if TYPE_CHECKING:
    from deltact_fab.studies import Study

DEFAULT_OUT = "study-out"


@click.group(cls=CommandGroup)
def study() -> None:
    """The paper's experiments and better ones, on the virtual rig or on recorded runs."""


@study.command("list")
@answers
def list_() -> Answer:
    """List the studies and their subjects."""
    from deltact_fab.studies import STUDIES

    return listing(("study", "about"), [(name, entry.line) for name, entry in STUDIES.items()])


class Studies(CommandGroup):
    """Commands of the studies, made on demand."""

    noun = "study"

    def list_commands(self, ctx: click.Context) -> list[str]:
        from deltact_fab.studies import STUDIES

        return list(STUDIES)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        from deltact_fab.studies import find_study

        return make_command(cmd_name, find_study(cmd_name))


@study.group("run", cls=Studies)
def run(**_: Any) -> None:
    """Run a study, which writes a page, tables and figures into a folder.

    All results are cached: if stopped, the same command continues.
    """


def _shared(scale: float | None) -> dict[str, tuple[Decorator, ...]]:
    """Return the shared options by their names in `Study.takes`."""
    return {
        "scale": (
            click.option("--scale", type=Finite(0, 1, min_open=True), default=scale,
                         metavar="SHARE", help="Fraction of the paper's points or frames."),
        ),
        "seed": (seed("Seed of all random numbers."),),
        "rig": (
            click.option("--rig", type=NAME_OR_PATH, metavar="RIG", show_default="the study's own",
                         help="Virtual rig: a name of `rig list` or a path."),
        ),
        "from": (
            click.option("--from", multiple=True, type=PATH_TYPE, metavar="RUN",
                         help="Recorded run to use; repeatable."),
        ),
        "grid": GRID_OPTIONS,
    }  # fmt: skip


def make_command(name: str, spec: Study) -> click.Command:
    """Make `study run NAME` with the options of this study."""
    options = [o for key, group in _shared(spec.scale).items() if key in spec.takes for o in group]
    options += [click.option(flag, **settings) for flag, settings in spec.options.items()]
    options.append(out_folder("Folder for page and tables.", default=Path(DEFAULT_OUT) / name))
    options.append(
        out_folder("Also write the figures as SVG and PDF into this folder.", flag="--figures")
    )
    run_command = answers(lambda **settings: _run_study(name, spec, settings))
    for option in reversed(options):
        run_command = option(run_command)
    about = f"{spec.line}\n\n{spec.about}".strip()
    return click.command(name, help=about, short_help=spec.line)(run_command)


def _run_study(name: str, spec: Study, values: dict[str, Any]) -> Answer:
    """Run a study with the options of its command.

    Obstacles to writing its page are reported before anything is computed.
    """
    from deltact_fab.common import open_executor
    from deltact_fab.present import require_ready_study, write_study_figures, write_study_page
    from deltact_fab.studies import StudyRequest, run_study

    out, figures = values["out"], values["figures"]
    require_ready_study(name, out)
    extra_keys = (flag.removeprefix("--").replace("-", "_") for flag in spec.options)
    grid: AbstractContextManager[Executor | None] = nullcontext()
    if "on" in values:
        grid = open_executor(values["on"], values["jobs"])
    with grid as executor, progress(name) as tick:
        result = run_study(
            name,
            StudyRequest(
                scale=values.get("scale"),
                seed=values.get("seed", 0),
                rig=values.get("rig"),
                runs=values.get("from", ()),
                executor=executor,
                progress=tick,
                say=lambda text: click.echo(text, err=True),
                options={key: values[key] for key in extra_keys},
            ),
        )
    click.echo(f"report: {write_study_page(result, out)}", err=True)
    if figures is not None:
        files = write_study_figures(result, figures)
        click.echo(f"figures: {len(files)} files in {figures}", err=True)
    missing = (
        f"warning: {len(result.missing)} jobs failed and are not included: "
        f"{', '.join(result.missing[:5])}{', ...' if len(result.missing) > 5 else ''}; "
        "run the same command to retry"
    )
    return Answer(result.data, result.verdict, asides=[missing] if result.missing else ())
