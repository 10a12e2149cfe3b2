"""`deltact-fab gel path`: a protocol's presses solved ahead of its run."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import click

from .options import ON, PROCESSES, PROTOCOL_NAME, RIG
from .output import Answer, answers, progress, table

if TYPE_CHECKING:
    from ..rig.simulator import GelConfig
    from ..virtual.presolve import PressRow, Told


@click.command(epilog="Example: deltact-fab gel path pattern-selection --jobs 2")
@click.argument("protocol", type=PROTOCOL_NAME)
@RIG
@PROCESSES
@ON
@click.option("--spacing", "spacing_mm", type=float, metavar="MM", show_default="the rig's",
              help="Size of the cells below the indenter.")  # fmt: skip
@click.option("--tolerance", type=float, metavar="SHARE", show_default="the rig's",
              help="Relative error of the force, which chooses the cells where --spacing does not."
              )  # fmt: skip
@answers
def path(
    protocol: str, rig_name: str, jobs: int | None, on: str, spacing_mm: float | None,
    tolerance: float | None,
) -> Answer:  # fmt: skip
    """Solve every press of PROTOCOL on the simulated gel and keep the results for `run`.

    When it is stopped, the same command continues: presses that are complete are kept. A press that
    fails does not stop the others; exit code 1 when one failed. `run` finds what was solved with
    the [virtual.gel] settings of its rig file.
    """
    from dataclasses import asdict

    from ..cad.design import load_design
    from ..errors import InputError
    from ..jobs import executor
    from ..protocols import plan
    from ..rig import config as rig_config
    from ..virtual.feasibility import require_gel_level
    from ..virtual.presolve import solve_ahead

    declared, source = plan.load(protocol)
    rig, rig_source = rig_config.load(rig_name)
    if rig.kind != "virtual":
        raise InputError(
            f"{rig_source}: kind: {rig.kind!r} has no simulated gel; name a virtual rig"
        )
    sensor = load_design(declared.specimen.design)
    require_gel_level(declared, sensor, str(source))
    level = declared.specimen.gel_model
    gel, differs = _chosen(rig.virtual.gel, level, spacing_mm, tolerance)
    started = time.monotonic()
    with executor(on, jobs) as where, progress("gel path") as tick:
        rows = solve_ahead(declared, sensor.skin, gel, where, _told(tick))
    seconds = time.monotonic() - started
    failed = [row for row in rows if row.failure]
    data = {
        "protocol": declared.name,
        "level": level,
        "wall_seconds": seconds,
        "failed": len(failed),
        "presses": [asdict(row) for row in rows],
    }
    asides = _asides(rows)
    if differs:
        asides.append(f"`run` finds these only when {rig_source} says {differs}")
    return Answer(data, _lines(rows, level, seconds), "" if failed else None, asides)


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


def _told(tick: Callable[[int, int, str], None]) -> Told:
    """Knots of all presses together, with the one that was solved last and its pace."""
    rows: dict[str, PressRow] = {}

    def told(row: PressRow) -> None:
        rows[row.press] = row
        done = sum(r.done for r in rows.values())
        # A press that failed has no more to do.
        total = sum(r.done if r.failure else r.knots for r in rows.values())
        pace = "failed" if row.failure else f"{row.seconds / max(row.done, 1):.2g} s a knot"
        tick(done, total, f"{row.press}, {'found' if row.found else pace}")

    return told


def _lines(rows: list[PressRow], level: str, seconds: float) -> list[str]:
    told = table(
        ("press", "knots", "done", "from", "s", "s/knot", "between_mm", "between_n",
         "contact_mm2", "stick_mm2"),
        [
            (r.press, r.knots, r.done, _from(r), r.seconds, r.seconds / max(r.done, 1),
             r.between_mm, r.between_n,
             f"{r.zones.contact_area_mm2:.3g} ± {r.zones.contact_area_error_mm2:.1g}",
             f"{r.zones.stick_area_mm2:.3g} ± {r.zones.stick_area_error_mm2:.1g}")
            for r in rows
        ],
    )  # fmt: skip
    solved = sum(r.done for r in rows if not r.found)
    return [
        *told,
        f"{len(rows)} presses (simulated, {level}), {solved} knots solved in {seconds:.1f} s; "
        "between_*: largest error of interpolating between knots, where it was tested; contact and "
        "stick zone at the end",
    ]


def _asides(rows: list[PressRow]) -> list[str]:
    lines = []
    for row in rows:
        for flag, count in ({} if row.like else row.flags).items():
            lines.append(f"warning: {row.press}: {flag} ({count} of {row.knots} knots)")
        if row.failure:
            lines.append(f"failed: {row.press}: {row.failure}")
    return lines


def _from(row: PressRow) -> str:
    if row.like:
        return f"mirror of {row.like}"
    return "store" if row.found else "solved"
