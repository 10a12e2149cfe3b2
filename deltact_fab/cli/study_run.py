"""A study from its command: asked, run, written, told."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..errors import InputError
from ..study.registry import Study
from ..study.registry import run as run_study

if TYPE_CHECKING:
    from ..report.result import StudyResult


def run(name: str, one: Study, given: dict[str, Any]) -> None:
    """Run a study with the options of its command, by their names.

    What would keep its page from being written is said before anything is computed.
    """
    from ..report import study_page
    from ..report.figures import save
    from ..study.request import StudyRequest
    from .output import echo_json, progress

    out, figures = given["out"], given["figures"]
    named = [out] if figures is None else [out, figures]
    before = [path for one in named for path in (one, *one.parents) if not path.exists()]
    with _none_left(*before):
        study_page.ready(name, out, figures)
    more = (option.name.replace("-", "_") for option in one.options)
    with _none_left(*before), _executor(given) as executor, progress(name) as tick:
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
                more={key: given[key] for key in more},
            ),
        )
    click.echo(f"report: {study_page.write(found, out, _layer_costs(found))}", err=True)
    if figures is not None:
        files = save(found, figures)
        click.echo(f"figures: {len(files)} files in {figures}", err=True)
    if given["as_json"]:
        echo_json(found.data)
    else:
        for line in found.verdict:
            click.echo(line)
    if found.missing:
        click.echo(
            f"warning: {len(found.missing)} jobs have no result and are left out: "
            f"{', '.join(found.missing[:5])}{', ...' if len(found.missing) > 5 else ''}; "
            "the same command tries them again",
            err=True,
        )


def _layer_costs(found: StudyResult) -> list[dict[str, Any]]:
    """What this machine has measured of layers that were left out, perhaps nothing."""
    if not any(one.layer for one in found.left_out):
        return []
    from ..numerics.scenes import costs

    return costs()


@contextmanager
def _none_left(*new: Path) -> Iterator[None]:
    """Folders that were made for a study go again when its input is refused."""
    try:
        yield
    except InputError:
        for folder in new:
            with suppress(OSError):
                folder.rmdir()
        raise


@contextmanager
def _executor(given: dict[str, Any]) -> Iterator[Executor | None]:
    if "on" not in given:
        yield None
        return
    from ..jobs import executor

    with executor(given["on"], given["jobs"]) as found:
        yield found
