"""A study from its command: asked, run, written, told."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any

import click

from ..study.registry import Study
from ..study.registry import run as run_study


def run(name: str, one: Study, given: dict[str, Any]) -> None:
    """Run a study with the options of its command, by their names."""
    from ..report.study_page import write
    from ..study.asked import Asked
    from ..study.folder import refuse_strange, replaced
    from .output import echo_json, progress

    out, as_json = given["out"], given["as_json"]
    refuse_strange(out, name)
    more = {option.name.replace("-", "_"): None for option in one.options}
    more = {key: given[key] for key in more}
    with _executor(given) as executor, progress(name) as tick:
        found = run_study(
            name,
            Asked(
                scale=given.get("scale"),
                seed=given.get("seed", 0),
                rig=given.get("rig"),
                runs=given.get("from", ()),
                executor=executor,
                progress=tick,
                say=lambda text: click.echo(text, err=True),
                more=more,
            ),
        )
    with replaced(out, name) as folder:
        page = write(found, folder).relative_to(folder)
    click.echo(f"report: {out / page}", err=True)
    if as_json:
        echo_json(found.data)
    else:
        for line in found.verdict:
            click.echo(line)
    for job in found.missing:
        click.echo(f"missing: {job}", err=True)


@contextmanager
def _executor(given: dict[str, Any]) -> Iterator[Executor | None]:
    if "on" not in given:
        yield None
        return
    from ..jobs import executor

    with executor(given["on"], given["jobs"]) as found:
        yield found
