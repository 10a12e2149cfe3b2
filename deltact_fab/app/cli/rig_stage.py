"""`deltact-fab rig status|home|jog|goto|reset`: a real rig's stage, one command at a time."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from deltact_fab.common import InputError, RunFailed

from .options import DESIGN, NAME_OR_PATH, TIP_IS_CLEAR, Finite
from .output import Answer, answers

if TYPE_CHECKING:
    from deltact_fab.bench import HandStage

RIG = click.argument("rig", type=NAME_OR_PATH)
FEED = click.option(
    "--feed", type=Finite(0, min_open=True), default=300.0, metavar="MM/MIN", help="Speed.",
)  # fmt: skip
INTO_GEL = click.option(
    "--into-gel", is_flag=True,
    help="Allow heights below 5 mm over the face; the stage moves slowly there.",
)  # fmt: skip
NUMBERS = {"ignore_unknown_options": True}  # -1.5 is no option


@click.command()
@RIG
@answers
def status(rig: str) -> Answer:
    """Say what the stage is doing and where it is. Nothing moves."""
    from deltact_fab.bench import HandStage

    state = HandStage(rig).status()
    return Answer(asdict(state), [state.line()])


@click.command()
@RIG
@click.option("--yes", is_flag=True, help="Do not ask whether the path is clear.")
@TIP_IS_CLEAR
@answers
def home(rig: str, yes: bool, tip_is_clear: bool) -> Answer:
    """Home the stage: every axis moves to its end switch.

    If the position is known, the tip is lifted first. If it is lost, the force sensor, you, or
    --tip-is-clear must confirm that the tip is not in the gel. The force sensor of the rig file is
    watched meanwhile, and its guard stops the stage as in a run.
    """
    from deltact_fab.bench import HandStage

    stage = HandStage(rig)
    question = "homing moves every axis to its end switch; is the path clear?"
    if not (yes or click.confirm(question, err=True)):
        raise RunFailed("not homed")
    how, seconds, state = stage.home(tip_is_clear, ask=not yes)
    lines = [f"{how}; homed in {seconds:.1f} s", state.line()]
    return Answer({"how": how, "seconds": seconds, "state": asdict(state)}, lines)


@click.command(context_settings=NUMBERS, epilog="Example: deltact-fab rig jog bench 0 0 5")
@RIG
@click.argument("by_mm", type=Finite(), nargs=3, required=False, metavar="[DX DY DZ]")
@FEED
@click.option("--most", "max_mm", type=Finite(0), default=10.0, metavar="MM",
              help="Longest move that is allowed.")  # fmt: skip
@INTO_GEL
@click.option("--indenter", default="sphere:10", metavar="sphere:MM",
              help="The ball that the key r registers with.")  # fmt: skip
@DESIGN
@answers
def jog(
    rig: str, by_mm: tuple[float, float, float] | None, feed: float, max_mm: float,
    into_gel: bool, indenter: str, design: str,
) -> Answer:  # fmt: skip
    """Move the tip by DX DY DZ mm in the sensor frame, whose z is up, out of the gel.

    Relies on the position that the controller has counted since it was homed. Ctrl-C stops it. The
    guard on the force sensor of the rig file stops it as in a run. Without DX DY DZ the keys move
    it, in one session on one open port: homing, origin and registration (written beside the rig
    file) as well, with the force on the screen.
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
        raise InputError("DX DY DZ: missing; keys need a terminal")

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


@click.command(context_settings=NUMBERS, epilog="Example: deltact-fab rig goto bench 0 0 10 --home")
@RIG
@click.argument("target_mm", type=Finite(), nargs=3, metavar="X Y Z")
@FEED
@INTO_GEL
@click.option("--as-counted", is_flag=True,
              help="The stage was homed, and not unlocked by $X since.")  # fmt: skip
@click.option("--home", "home_first", is_flag=True,
              help="Home first; you confirm that the tip touches nothing.")  # fmt: skip
@answers
def goto(
    rig: str, target_mm: tuple[float, float, float], feed: float, into_gel: bool,
    as_counted: bool, home_first: bool,
) -> Answer:  # fmt: skip
    """Move the tip to X Y Z mm in the sensor frame, whose z = 0 is the resting face.

    It goes up, then sideways, then down. Give --home or --as-counted, as the stage must know where
    it is. Ctrl-C stops it, and the guard on the force sensor of the rig file as in a run.
    """
    from deltact_fab.bench import HandStage

    stage = HandStage(rig)
    if home_first == as_counted:
        raise InputError("give either --home or --as-counted: the stage must know where it is")
    state = stage.go_to(target_mm, feed, into_gel, home_first)
    return Answer(asdict(state), [state.line()])


@click.command()
@RIG
@answers
def reset(rig: str) -> Answer:
    """Reset the controller of RIG (0x18).

    For one that answers nothing else after an alarm, or that sleeps. All motion stops at once, and
    the position is lost.
    """
    from deltact_fab.bench import HandStage

    banner = HandStage(rig).reset()
    return Answer({"banner": banner}, [f"{banner}; its position is lost: home next"])


COMMANDS = (status, home, jog, goto, reset)
