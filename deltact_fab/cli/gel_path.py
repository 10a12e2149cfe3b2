"""`deltact-fab gel path`: a protocol's presses solved ahead of its run."""

from __future__ import annotations

import time
from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from ..errors import InputError
from .options import NAME_OR_PATH, ON, PROCESSES, RIG
from .output import Answer, answers, columns_of, progress

if TYPE_CHECKING:
    from ..virtual.presolve import PressRow


@click.command(epilog="Example: deltact-fab gel path pattern-selection --jobs 2")
@click.argument("protocol", type=NAME_OR_PATH)
@RIG
@PROCESSES
@ON
@answers
def path(protocol: str, rig_name: str, jobs: int | None, on: str) -> Answer:
    """Solve every press of PROTOCOL on the simulated gel and keep the results for `run`.

    When it is stopped, the same command continues: presses that are complete are kept. A press that
    fails does not stop the others; exit code 1 when one failed. `run` finds what was solved with
    the [virtual.gel] settings of its rig file.
    """
    from ..cad.design import load_design
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
    started = time.monotonic()
    with executor(on, jobs) as where, progress("gel path") as tick:
        rows = solve_ahead(
            declared, sensor.skin, rig.virtual.gel, where,
            lambda row: tick(row.done, row.knots, row.press),
        )  # fmt: skip
    seconds = time.monotonic() - started
    failed = [row for row in rows if row.failure]
    data = {
        "protocol": declared.name,
        "level": level,
        "wall_seconds": seconds,
        "failed": len(failed),
        "presses": [asdict(row) for row in rows],
    }
    return Answer(data, _lines(rows, level, seconds), "" if failed else None, _asides(rows))


def _lines(rows: list[PressRow], level: str, seconds: float) -> list[str]:
    names = ("press", "knots", "done", "found", "like", "seconds")
    zones = ("contact_area_mm2", "contact_area_error_mm2", "stick_area_mm2", "stick_area_error_mm2")
    solved = sum(r.done for r in rows if not r.found)
    return [
        *columns_of((*names, *zones), [{**vars(row), **asdict(row.zones)} for row in rows]),
        f"{len(rows)} presses (simulated, {level}), {solved} knots solved in {seconds:.1f} s; "
        "found: in the store; like: a mirror image of that press; zones at the end of the press",
    ]


def _asides(rows: list[PressRow]) -> list[str]:
    lines = []
    for row in rows:
        for flag, count in ({} if row.like else row.flags).items():
            lines.append(f"warning: {row.press}: {flag} ({count} of {row.knots} knots)")
        if row.failure:
            lines.append(f"failed: {row.press}: {row.failure}")
    return lines
