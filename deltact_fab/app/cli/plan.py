"""`deltact-fab protocol plan`: protocols that are planned for a goal."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from .group import CommandGroup
from .options import (
    JOBS_OPTION,
    NAME_OR_PATH,
    ON_OPTION,
    PATH_TYPE,
    RIG_OPTION,
    Quantity,
    out_file,
    seed,
)
from .output import Answer, answers, files_line, progress


@click.group(cls=CommandGroup)
def plan() -> None:
    """Plan an experiment for a goal, and predict what it will reach."""


PILOT_OPTION = click.option(
    "--pilot", "pilots", multiple=True, type=PATH_TYPE, metavar="RUN",
    help="Run on the same sensor that the errors are estimated from; repeatable.",
)  # fmt: skip


def sensor_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that name a sensor: serial number, design and pattern."""
    for option in (
        click.option("--pattern", type=NAME_OR_PATH, metavar="RECIPE",
                     help="Pattern of the sensor; by default the pilot's."),
        click.option("--design", type=NAME_OR_PATH, metavar="DESIGN",
                     help="Design of the sensor; by default the ledger's, or the pilot's."),
        click.option("--serial", metavar="TEXT",
                     help="Serial number of the sensor, for its ledger."),
    ):  # fmt: skip
        command = option(command)
    return command


@plan.command(
    epilog="Example: deltact-fab protocol plan force --pilot pilot-run --range 8N --goal 0.1N "
    "--time 8h -o night.toml"
)
@RIG_OPTION
@sensor_options
@PILOT_OPTION
@click.option("--range", "range_n", type=Quantity("N"), required=True, metavar="FORCE",
              help="Largest normal force, such as 8N.")  # fmt: skip
@click.option("--goal", "goal_n", type=Quantity("N"), required=True, metavar="FORCE",
              help="Rms error of the normal force at a place that was not pressed.")  # fmt: skip
@click.option("--time", "time_s", type=Quantity("s"), default="8h", show_default=True,
              metavar="TIME", help="Longest run, such as 90min.")  # fmt: skip
@click.option("--tip", "tips", multiple=True, metavar="INDENTER", show_default="the pilot's",
              help="Indenter; repeatable.")  # fmt: skip
@click.option("--unattended", is_flag=True, help="For `run --unattended`: a single tip.")
@seed("Seed of the places, the choice and the order.")
@out_file("Protocol to write, or its name; an existing one is never overwritten.", required=True)
@answers
def force(
    rig_name: str, serial: str | None, design: str | None, pattern: str | None,
    pilots: tuple[Path, ...], range_n: float, goal_n: float, time_s: float, tips: tuple[str, ...],
    unattended: bool, seed: int, out: Path,
) -> Answer:  # fmt: skip
    """Plan a force calibration: the fewest presses that meet a goal with chance 0.9.

    Tips, places, depths and drags are chosen for the least predicted error of the model that
    `calibrate force` fits. Presses to validate are never fitted. Errors come from --pilot; without
    it, or where it has one place or one tip, they are assumed and reported so.
    """
    from deltact_fab.studies import plan_force

    from ..lab import new_file

    out = out if out.suffix else new_file("protocol", out.name, None)
    with progress("plan") as report:
        specimen = {"serial": serial, "design": design, "pattern": pattern}
        result = plan_force(
            out, rig_name, range_n, goal_n, time_s, pilots, tips=tips, specimen=specimen,
            unattended=unattended, seed=seed, progress=report,
        )  # fmt: skip
    return Answer({**result.data, "file": str(out)}, [*result.lines, files_line([out])])


@click.command("try", epilog="Example: deltact-fab protocol try night --rig sensors.toml")
@click.argument("plan_name", metavar="PLAN", type=NAME_OR_PATH)
@RIG_OPTION
@click.option("--times", type=click.IntRange(2, 1000), default=100, show_default=True,
              metavar="N", help="Number of sensors that are drawn.")  # fmt: skip
@click.option("--gel", type=click.Choice(["linear", "hyperelastic"]), default="linear",
              show_default=True, help="Gel that is pressed; a plan's is linear.")  # fmt: skip
@JOBS_OPTION
@ON_OPTION
@answers
def try_(plan_name: str, rig_name: str, times: int, gel: Any, jobs: int | None, on: str) -> Answer:
    """Try a plan on virtual sensors that are drawn from the rig's [virtual.population].

    Ten sensors are tracked in images of all presses. The others have images of every 16th, and else
    the true flow with the noise that images gave; both are compared. The same command goes on
    where a stopped one was.
    """
    from deltact_fab.common import open_executor
    from deltact_fab.studies import try_plan

    with open_executor(on, jobs) as executor, progress("try") as tick:
        report = try_plan(
            plan_name, rig_name, times, gel, executor, tick,
            lambda text: click.echo(text, err=True),
        )  # fmt: skip
    return Answer(report.as_dict(), report.lines)
