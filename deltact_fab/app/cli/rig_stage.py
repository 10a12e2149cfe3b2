"""`deltact-fab rig status|home|jog|goto|reset`: commands for a real rig's stage."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from deltact_fab.common import InputError, RunFailed

from .options import DESIGN_OPTION, NAME_OR_PATH, TIP_IS_CLEAR, Finite
from .output import Answer, answers

if TYPE_CHECKING:
    from deltact_fab.bench import HandStage

STAGE_RIG_ARGUMENT = click.argument("rig", type=NAME_OR_PATH)
FEED_OPTION = click.option(
    "--feed", type=Finite(0, min_open=True), default=300.0, metavar="MM/MIN", help="Feed.",
)  # fmt: skip
INTO_GEL = click.option(
    "--into-gel", is_flag=True,
    help="Allow heights of less than 5 mm above the face, at a slow feed."
)  # fmt: skip
NEGATIVE_NUMBERS = {"ignore_unknown_options": True}  # -1.5 is not an option


@click.command()
@STAGE_RIG_ARGUMENT
@answers
def status(rig: str) -> Answer:
    """Show state and position of the stage. Nothing moves.

    The position is the controller's count, true if every axis was homed since it started.
    """
    from deltact_fab.bench import HandStage

    state = HandStage(rig).status()
    return Answer(asdict(state), [state.line()])


@click.command()
@STAGE_RIG_ARGUMENT
@click.option("--yes", is_flag=True, help="Do not ask whether the path is clear.")
@TIP_IS_CLEAR
@answers
def home(rig: str, yes: bool, tip_is_clear: bool) -> Answer:
    """Home the stage: every axis moves to its end switch.

    If the position is known, the tip is lifted first. If it is lost, the force sensor, you, or
    --tip-is-clear must confirm that the tip is not in the gel. The guard of the rig's force sensor
    stops the stage as in a run.
    """
    from deltact_fab.bench import HandStage

    stage = HandStage(rig)
    question = "homing moves every axis to its end switch; is the path clear?"
    if not (yes or click.confirm(question, err=True)):
        raise RunFailed("not homed")
    how, seconds, state = stage.home(tip_is_clear, ask=not yes)
    lines = [f"{how}; homed in {seconds:.1f} s", state.line()]
    return Answer({"how": how, "seconds": seconds, "state": asdict(state)}, lines)


@click.command(context_settings=NEGATIVE_NUMBERS, epilog="Example: deltact-fab rig jog bench 0 0 5")
@STAGE_RIG_ARGUMENT
@click.argument("by_mm", type=Finite(), nargs=3, required=False, metavar="[DX DY DZ]")
@FEED_OPTION
@click.option("--most", "max_mm", type=Finite(0), default=10.0, metavar="MM",
              help="Longest allowed move.")  # fmt: skip
@INTO_GEL
@click.option("--indenter", default="sphere:10", metavar="sphere:MM",
              help="Ball for registration with the key r.")  # fmt: skip
@DESIGN_OPTION
@answers
def jog(
    rig: str, by_mm: tuple[float, float, float] | None, feed: float, max_mm: float,
    into_gel: bool, indenter: str, design: str,
) -> Answer:  # fmt: skip
    """Move the tip by DX DY DZ mm in the sensor frame, whose z is up, out of the gel.

    Relies on the controller's position since homing. Ctrl-C stops the move, and so does the guard
    of the rig's force sensor, as in a run. Without DX DY DZ the keys move the tip in one session,
    with the force on the screen; they also home, set the origin and register (written next to the
    rig file).
    """
    from deltact_fab.bench import HandStage

    stage = HandStage(rig)
    if by_mm is None:
        return _jog_by_keys(stage, into_gel, indenter, design)
    state = stage.jog(by_mm, feed, max_mm, into_gel)
    return Answer(asdict(state), [state.line()])


def _jog_by_keys(stage: HandStage, into_gel: bool, indenter: str, design: str) -> Answer:
    from deltact_fab.fabricate import load_design

    from .keys import line_mode, read_keys

    if not sys.stdin.isatty():
        raise InputError("give DX DY DZ; moving by keys needs a terminal")

    @contextmanager
    def keyboard() -> Iterator[Callable[[float], str]]:
        with read_keys() as key:
            yield key
            click.echo("", err=True)

    def tell(line: str) -> None:
        click.echo(f"\r\x1b[K{line}", err=True)

    def show(line: str) -> None:
        click.echo(f"\r\x1b[K{line}", nl=False, err=True)

    state = stage.drive_by_keys(
        keyboard, line_mode, tell, show, load_design(design), indenter, into_gel
    )
    return Answer(asdict(state), [state.line()])


@click.command(context_settings=NEGATIVE_NUMBERS,
               epilog="Example: deltact-fab rig goto bench 0 0 10 --home")  # fmt: skip
@STAGE_RIG_ARGUMENT
@click.argument("target_mm", type=Finite(), nargs=3, metavar="X Y Z")
@FEED_OPTION
@INTO_GEL
@click.option("--as-counted", is_flag=True,
              help="Trust the position: every axis homed, and not unlocked by $X since. "
                   "The controller cannot show it.")  # fmt: skip
@click.option("--home", "home_first", is_flag=True,
              help="Home first; confirms that the tip touches nothing.")  # fmt: skip
@answers
def goto(
    rig: str, target_mm: tuple[float, float, float], feed: float, into_gel: bool,
    as_counted: bool, home_first: bool,
) -> Answer:  # fmt: skip
    """Move the tip to X Y Z mm in the sensor frame, whose z = 0 is the resting face.

    Moves up, then sideways, then down. Needs a known position: give --home or --as-counted. Ctrl-C
    stops the move, and so does the guard of the rig's force sensor, as in a run.
    """
    from deltact_fab.bench import HandStage

    stage = HandStage(rig)
    if home_first == as_counted:
        raise InputError("give either --home or --as-counted: the position must be known")
    state = stage.go_to(target_mm, feed, into_gel, home_first)
    return Answer(asdict(state), [state.line()])


@click.command()
@STAGE_RIG_ARGUMENT
@answers
def reset(rig: str) -> Answer:
    """Reset the controller of RIG (0x18).

    For a controller that no longer responds after an alarm, or sleeps. Motion stops immediately,
    and the position is lost.
    """
    from deltact_fab.bench import HandStage

    banner = HandStage(rig).reset()
    return Answer({"banner": banner}, [f"{banner}; position lost: home next"])


STAGE_COMMANDS = (status, home, jog, goto, reset)
