"""`deltact-fab gel path`: a protocol's presses solved ahead of its run."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from ..rig.simulator import GelConfig
    from ..virtual.presolve import Row, Told


@click.command()
@click.argument("protocol")
@click.option("--rig", "rig_name", default="virtual", show_default=True, help="Its gel counts.")
@click.option(
    "--jobs", default=2, show_default=True, type=click.IntRange(1, 256), help="Presses at a time."
)
@click.option("--spacing", "spacing_mm", type=float, help="Cells below the indenter, mm.")
@click.option("--tolerance", type=float, help="Of force; picks the cells where --spacing does not.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def path(
    protocol: str,
    rig_name: str,
    jobs: int,
    spacing_mm: float | None,
    tolerance: float | None,
    as_json: bool,
) -> None:
    """Solve every press of PROTOCOL on the simulated gel and keep it for `run`.

    Stopped or killed, it goes on where it was: presses that are whole are kept. A press that fails
    stops no other; exit 1 when one did. `run` finds what was solved with the [virtual.gel] of the
    rig file.
    """
    from ..cad.design import load_design
    from ..errors import InputError
    from ..protocols import plan
    from ..rig import config as rig_config
    from ..virtual.feasibility import require_gel_level
    from ..virtual.presolve import solve_ahead
    from .output import echo_json

    declared, source = plan.load(protocol)
    rig, rig_source = rig_config.load(rig_name)
    if rig.kind != "virtual":
        raise InputError(f"{rig_source}: kind: {rig.kind!r} has no gel; name a virtual rig")
    sensor = load_design(declared.specimen.design)
    require_gel_level(declared, sensor, str(source))
    level = declared.specimen.gel_model
    gel, differs = _chosen(rig.virtual.gel, level, spacing_mm, tolerance)
    started = time.monotonic()
    with _bar(as_json) as told:
        rows = solve_ahead(declared, sensor.skin, gel, jobs, told)
    failed = [row for row in rows if row.failure]
    if as_json:
        echo_json(
            {
                "protocol": declared.name,
                "level": level,
                "wall_seconds": time.monotonic() - started,
                "failed": len(failed),
                "presses": [row.as_dict() for row in rows],
            }
        )
    else:
        _show(rows, level, time.monotonic() - started)
    if differs:
        click.echo(f"`run` finds these only when {rig_source} says so: {differs}", err=True)
    raise click.exceptions.Exit(1 if failed else 0)


def _chosen(
    gel: GelConfig, level: str, spacing_mm: float | None, tolerance: float | None
) -> tuple[GelConfig, str]:
    """The rig's resolution with what the command line overrides, and what that is."""
    from ..catalog import validate
    from ..errors import InputError
    from ..rig.simulator import GelConfig

    data = gel.model_dump()
    if level == "hyperelastic":
        table, words, name = data["hyperelastic"], "[virtual.gel.hyperelastic]", "cell_mm"
    else:
        table, words, name = data, "[virtual.gel]", "spacing_mm"
        if tolerance is not None:
            raise InputError(f"--tolerance: the level {level!r} takes its grid from --spacing")
    changes = {name: spacing_mm, "tolerance": tolerance}
    changes = {k: v for k, v in changes.items() if v is not None and v != table[k]}
    table.update(changes)
    differs = ", ".join(f"{words} {k} = {v:g}" for k, v in changes.items() if v is not None)
    return validate(GelConfig, data, "options"), differs


def _show(rows: list[Row], level: str, seconds: float) -> None:
    from .output import echo_table

    echo_table(
        ("press", "knots", "done", "from", "s", "s/knot", "between_mm", "between_n"),
        [
            (r.press, r.knots, r.done, _from(r), r.seconds, r.seconds / max(r.done, 1),
             r.between_mm, r.between_n)
            for r in rows
        ],
    )  # fmt: skip
    solved = sum(r.done for r in rows if not r.found)
    click.echo(
        f"{len(rows)} presses (simulated, {level}), {solved} knots solved in {seconds:.1f} s; "
        "between_*: largest error of interpolation between knots where it was tried"
    )
    for row in rows:
        for flag, count in ({} if row.like else row.flags).items():
            click.echo(f"warning: {row.press}: {flag} ({count} of {row.knots} knots)", err=True)
        if row.failure:
            click.echo(f"failed: {row.press}: {row.failure}", err=True)


def _from(row: Row) -> str:
    if row.like:
        return f"mirror of {row.like}"
    return "store" if row.found else "solved"


@contextmanager
def _bar(quiet: bool) -> Iterator[Told]:
    """One line a press under way on a terminal and one for all; in a log one a press at its end."""
    if quiet:
        yield lambda row: None
        return
    if not sys.stderr.isatty():
        ended: set[str] = set()

        def log(row: Row) -> None:
            if row.found or row.press in ended or not (row.failure or row.done == row.knots):
                return
            ended.add(row.press)
            how = f"failed: {row.failure}" if row.failure else "solved"
            click.echo(
                f"{row.press}: {row.done} of {row.knots} knots in {row.seconds:.0f} s, {how}",
                err=True,
            )

        yield log
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TaskID,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    with Progress(
        TextColumn("{task.description:<20}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]:>11}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(elapsed_when_finished=True),
        console=Console(stderr=True),
    ) as bar:
        whole = bar.add_task("all knots", total=0, rate="")
        tasks: dict[str, TaskID] = {}
        rows: dict[str, Row] = {}

        def told(row: Row) -> None:
            rows[row.press] = row
            if row.press not in tasks and 0 < row.done < row.knots and not row.failure:
                tasks[row.press] = bar.add_task(row.press, total=row.knots, rate="")
            if row.press in tasks:
                rate = f"{row.seconds / max(row.done, 1):.2f} s/knot"
                bar.update(tasks[row.press], completed=row.done, rate=rate)
                if row.failure or row.done == row.knots:
                    bar.remove_task(tasks.pop(row.press))
            if row.failure:
                bar.console.print(f"failed: {row.press}: {row.failure}", markup=False)
            total = sum(r.done if r.failure else r.knots for r in rows.values())
            bar.update(whole, total=total, completed=sum(r.done for r in rows.values()))

        yield told
