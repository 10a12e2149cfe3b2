"""`deltact-fab protocol plan`: protocols that are planned for a goal."""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
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


SENSOR_OPTIONS = (
    click.option("--serial", metavar="TEXT", help="Serial number of the sensor, for its ledger."),
    click.option("--pattern", type=NAME_OR_PATH, metavar="RECIPE",
                 help="Pattern of the sensor; by default the pilot's."),
)  # fmt: skip
MEAN_OPTIONS = (
    click.option("--goal", type=Quantity("%", "mm"), required=True, metavar="SIZE",
                 help="Half width of the 95 % interval of the mean: in %, or as 0.002mm."),
    *SENSOR_OPTIONS,
)  # fmt: skip
PLAN_OPTIONS = (
    RIG_OPTION,
    click.option("--design", type=NAME_OR_PATH, metavar="DESIGN",
                 help="Design of the sensor; by default the ledger's, or the pilot's."),
    click.option("--pilot", "pilots", multiple=True, type=PATH_TYPE, metavar="RUN",
                 help="Run that the errors are estimated from: on the same sensor, for a "
                 "comparison on several; repeatable."),
    click.option("--range", "range_n", type=Quantity("N"), required=True, metavar="FORCE",
                 help="Largest normal force, such as 8N."),
    click.option("--time", "time_s", type=Quantity("s"), default="8h", show_default=True,
                 metavar="TIME", help="Longest run, such as 90min."),
    click.option("--tip", "tips", multiple=True, metavar="INDENTER", show_default="the pilot's",
                 help="Indenter; repeatable."),
    click.option("--unattended", is_flag=True, help="For `run --unattended`: a single tip."),
    seed("Seed of the places, the choice and the order."),
    out_file("Protocol to write, or its name; an existing one is never overwritten.",
             required=True),
)  # fmt: skip


def plan_options(*options: Callable[..., Any]) -> Callable[..., Any]:
    """Add options of one kind of plan, those of all, and `--json`."""

    def add(command: Callable[..., Any]) -> Callable[..., Any]:
        return reduce(lambda c, o: o(c), (*PLAN_OPTIONS[::-1], *options[::-1]), answers(command))

    return add


def _answer(
    quantity: str, out: Path, rig_name: str, range_n: float, goal: tuple[float, str], time_s: float,
    pilots: tuple[Path, ...], design: str | None, serial: str | None = None,
    pattern: str | None = None, **settings: Any,
) -> Answer:  # fmt: skip
    """Write a plan and report it."""
    from deltact_fab.studies import write_plan

    from ..lab import new_file

    out = out if out.suffix else new_file("protocol", out.name, None)
    specimen = {"serial": serial, "design": design, "pattern": pattern}
    with progress("plan") as report:
        result = write_plan(out, quantity, rig_name, range_n, goal, time_s, pilots,
                            specimen=specimen, progress=report, **settings)  # fmt: skip
    return Answer(result.as_dict(), [*result.lines, files_line(result.files)])


@plan.command(
    epilog="Example: deltact-fab protocol plan force --pilot pilot-run --range 8N --goal 0.1N "
    "--time 8h -o night.toml"
)
@plan_options(
    click.option("--goal", type=Quantity("N"), required=True, metavar="FORCE",
                 help="Rms error of the normal force at a place that was not pressed."),
    *SENSOR_OPTIONS,
)  # fmt: skip
def force(goal: float, **settings: Any) -> Answer:
    """Plan a force calibration: the fewest presses that meet a goal with chance 0.9.

    Tips, places, depths and drags are chosen for the least predicted error of the model that
    `calibrate force` fits. Presses to validate are never fitted. Errors come from --pilot; without
    it, or where it has one place or one tip, they are assumed and reported so.
    """
    return _answer("force", goal=(goal, "N"), **settings)


@plan.command(
    epilog="Example: deltact-fab protocol plan tracking --range 6N --goal 10% -o tracking.toml"
)
@plan_options(*MEAN_OPTIONS)
def tracking(**settings: Any) -> Answer:
    """Plan presses that tell the mean tracking error: the fewest that meet a goal with chance 0.9.

    The mean is over the face, by these tips, over depths up to --range; every tip presses once at
    each place, and places are the units of its interval. In % it is the geometric mean.
    """
    return _answer("tracking", **settings)


@plan.command(epilog="Example: deltact-fab protocol plan depth --range 6N --goal 10% -o depth.toml")
@plan_options(*MEAN_OPTIONS)
def depth(**settings: Any) -> Answer:
    """Plan presses that tell the mean error of the depth, on a virtual rig, as `plan tracking`."""
    return _answer("depth", **settings)


@plan.command(
    epilog="Example: deltact-fab protocol plan compare octave recommended --difference 15% "
    "--sensors 3 --range 6N -o patterns.toml"
)
@plan_options(
    click.argument("a", type=NAME_OR_PATH),
    click.argument("b", type=NAME_OR_PATH),
    click.option("--measure", "quantity", default="tracking", show_default=True,
                 type=click.Choice(["tracking", "time", "depth", "noise", "force"]),
                 help="What is compared, as by `analyze compare`."),
    click.option("--difference", "goal", type=Quantity("%", "mm", "ms", "N"), required=True,
                 metavar="SIZE", help="Difference to find: in %, or as 0.02mm."),
    click.option("--sensors", type=click.IntRange(2, 1000), metavar="N",
                 show_default="the fewest with chance 0.8", help="Sensors a side."),
    click.option("--presses", type=click.IntRange(1, 128), metavar="N",
                 show_default="as many as matter, up to 24", help="Presses on a sensor."),
)  # fmt: skip
def compare(a: str, b: str, quantity: str, **settings: Any) -> Answer:
    """Plan a comparison of patterns A and B: sensors a side, and the chance to find a difference.

    A unit is a sensor with its own print and gel. Its spread is estimated from --pilot, runs of the
    same presses on several sensors; without it the spread is assumed, and reported so. Two
    protocols that differ in the pattern alone are written, FILE-A and FILE-B; a run of each sensor
    names it by specimen.serial, or by `run --sensor`.
    """
    return _answer(quantity, patterns=(a, b), **settings)


@click.command("try", epilog="Example: deltact-fab protocol try night")
@click.argument("plan_name", metavar="PLAN", type=NAME_OR_PATH)
@click.option("--rig", "rig_name", type=NAME_OR_PATH, default="virtual-sensors", metavar="RIG",
              help="Virtual rig with a [virtual.population].")  # fmt: skip
@click.option("--times", type=click.IntRange(2, 1000), default=100, show_default=True,
              metavar="N", help="Number of sensors, or of comparisons of them.")  # fmt: skip
@click.option("--gel", type=click.Choice(["linear", "hyperelastic"]), default="linear",
              show_default=True, help="Gel that is pressed; a plan's is linear.")  # fmt: skip
@JOBS_OPTION
@ON_OPTION
@answers
def try_(plan_name: str, rig_name: str, times: int, gel: Any, jobs: int | None, on: str) -> Answer:
    """Try a plan on virtual sensors that are drawn from a rig's [virtual.population].

    Of a force calibration ten sensors are tracked in images of all presses. The others have images
    of every 16th, and else the true flow with the noise that images gave; both are compared. A mean
    or a comparison is tried by whole runs. The same command goes on where a stopped one was.
    """
    from deltact_fab.common import open_executor
    from deltact_fab.studies import try_plan

    with open_executor(on, jobs) as executor, progress("try") as tick:
        report = try_plan(
            plan_name, rig_name, times, gel, executor, tick,
            lambda text: click.echo(text, err=True),
        )  # fmt: skip
    return Answer(report.as_dict(), report.lines)
