"""`deltact-fab rig status|home|jog|goto|reset`: a real rig's stage, one command at a time."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from typing import TYPE_CHECKING

import click

from deltact_fab.common import InputError, RunFailed, StageError

from .options import DESIGN, NAME_OR_PATH, TIP_IS_CLEAR, Finite
from .output import Answer, answers

if TYPE_CHECKING:
    from deltact_fab.bench import GrblConfig, GrblStage, Watchdog

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
    config, stage = _stage(rig)
    with closing(stage):
        stage.connect()
        return _now(stage, config)


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
    from deltact_fab.bench import TerminalOperator, home_safely, stopped_by_ctrl_c

    config, stage = _stage(rig)
    question = "homing moves every axis to its end switch; is the path clear?"
    if not (yes or click.confirm(question, err=True)):
        raise RunFailed("not homed")
    with _driven(config, stage) as guard:
        start_s = time.monotonic()
        with stopped_by_ctrl_c(stage):
            how = home_safely(
                stage, stage.clock, guard, None if yes else TerminalOperator(),
                tip_is_clear=tip_is_clear, guard=guard,
            )  # fmt: skip
        seconds = time.monotonic() - start_s
        now = _now(stage, config)
    told = [f"{how}; homed in {seconds:.1f} s", *now.lines]
    return Answer({"how": how, "seconds": seconds, "state": now.data}, told)


@click.command(context_settings=NUMBERS, epilog="Example: deltact-fab rig jog bench 0 0 5")
@RIG
@click.argument("by_mm", type=Finite(), nargs=3, required=False, metavar="[DX DY DZ]")
@FEED
@click.option("--most", type=Finite(0), default=10.0, metavar="MM",
              help="Longest move that is allowed.")  # fmt: skip
@INTO_GEL
@click.option("--indenter", default="sphere:10", metavar="sphere:MM",
              help="The ball that the key r registers with.")  # fmt: skip
@DESIGN
@answers
def jog(
    rig: str, by_mm: tuple[float, float, float] | None, feed: float, most: float,
    into_gel: bool, indenter: str, design: str,
) -> Answer:  # fmt: skip
    """Move the tip by DX DY DZ mm in the sensor frame, whose z is up, out of the gel.

    Relies on the position that the controller has counted since it was homed. Ctrl-C stops it. The
    guard on the force sensor of the rig file stops it as in a run. Without DX DY DZ the keys move
    it, in one session on one open port: homing, origin and registration (written beside the rig
    file) as well, with the force on the screen.
    """
    from deltact_fab.bench import (
        move_to,
        plan_move,
        require_short_move,
        stopped_by_ctrl_c,
        watch_force,
    )

    config, stage = _stage(rig)
    if by_mm is None:
        return _by_keys(rig, config, stage, into_gel, indenter, design)
    require_short_move(by_mm, most)  # before a port is opened, which may restart the board
    with _driven(config, stage) as guard:
        _count(stage)
        with stopped_by_ctrl_c(stage), watch_force(stage, stage.clock, guard, guard):
            move_to(stage, *plan_move(stage, by_mm, feed, most, into_gel))
        return _now(stage, config)


def _by_keys(
    rig: str, config: GrblConfig, stage: GrblStage, into_gel: bool, indenter: str, design: str
) -> Answer:
    from pathlib import Path

    from deltact_fab.bench import (
        GuardedStage,
        HandSession,
        TerminalOperator,
        home_safely,
        load_rig,
        register_face,
        requested_tool,
        stopped_by_ctrl_c,
        write_registration,
    )
    from deltact_fab.fabricate import load_design

    from .keys import keys, whole_lines

    if not sys.stdin.isatty():
        raise InputError("DX DY DZ: missing; keys need a terminal")
    source = load_rig(rig)[1]
    out, operator = Path(f"{source.stem}-registration.toml"), TerminalOperator()
    asked = requested_tool(config, source, load_design(design), indenter)
    with _driven(config, stage) as guard, keys() as key:

        def home() -> str:
            with whole_lines():
                return home_safely(stage, stage.clock, guard, operator, guard=guard) + "; homed"

        def register() -> str:
            if guard is None:
                return "registration needs a force sensor"
            bench = GuardedStage(stage, guard, guard)
            with whole_lines():
                found = register_face(bench, asked, operator)
            write_registration(found, out)
            return f"{out}: {found.line()}"

        def tell(line: str) -> None:
            click.echo(f"\r\x1b[K{line}", err=True)

        def show(line: str) -> None:
            click.echo(f"\r\x1b[K{line}", nl=False, err=True)

        others = {"h": home, "r": register}
        with stopped_by_ctrl_c(stage):
            HandSession(stage, guard, guard, key, tell, show, into_gel, others).run()
        click.echo("", err=True)
        return _now(stage, config)


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
    from deltact_fab.bench import go_to, home_safely, stopped_by_ctrl_c, watch_force

    config, stage = _stage(rig)
    if home_first == as_counted:
        raise InputError("give either --home or --as-counted: the stage must know where it is")
    with _driven(config, stage) as guard:
        with stopped_by_ctrl_c(stage):
            if home_first:
                home_safely(stage, stage.clock, guard, None, tip_is_clear=True, guard=guard)
            else:
                _count(stage)
            with watch_force(stage, stage.clock, guard, guard):
                go_to(stage, target_mm, feed, into_gel)
        return _now(stage, config)


@click.command()
@RIG
@answers
def reset(rig: str) -> Answer:
    """Reset the controller of RIG (0x18).

    For one that answers nothing else after an alarm, or that sleeps. All motion stops at once, and
    the position is lost.
    """
    _, stage = _stage(rig)
    with closing(stage):
        stage.reset()
        banner = stage.identity()["banner"]
    return Answer({"banner": banner}, [f"{banner}; its position is lost: home next"])


COMMANDS = (status, home, jog, goto, reset)


def _stage(name: str) -> tuple[GrblConfig, GrblStage]:
    """The stage of a rig file, its port not yet open. Raises InputError for a virtual one."""
    from deltact_fab.bench import GrblConfig, GrblStage, WallClock, load_rig

    found, path = load_rig(name)
    if not isinstance(found, GrblConfig):
        raise InputError(f"{path}: kind: a {found.kind!r} rig has no stage to drive; 'grbl' has")
    return found, GrblStage.of(found.stage, WallClock())


@contextmanager
def _driven(config: GrblConfig, stage: GrblStage) -> Iterator[Watchdog | None]:
    """The stage connected, and the guard on the force sensor; None where the file names none."""
    from deltact_fab.bench import open_guarded

    with ExitStack() as opened:
        opened.callback(stage.close)
        stage.connect()
        guard = None
        if config.force is not None and config.force.reachable:
            guard = open_guarded(config.force, config.guard, stage)
            opened.callback(guard.close)
        yield guard


def _count(stage: GrblStage) -> None:
    if not stage.trust_count():
        raise StageError("the controller is locked, its position is lost: `rig home` first")


def _now(stage: GrblStage, config: GrblConfig) -> Answer:
    """State and position, as the controller says them; sensor_mm: None where it is locked."""
    from deltact_fab.bench import position_text, state_text

    seen = stage.look()
    known = seen.state.partition(":")[0] not in ("Alarm", "Sleep")
    sensor_mm = config.stage.frame.to_sensor_mm(seen.machine_mm) if known else None
    machine = ", ".join(f"{p:.3f}" for p in seen.machine_mm)
    where = "locked: home first" if sensor_mm is None else position_text(sensor_mm)
    data = {
        "state": seen.state,
        "machine_mm": list(seen.machine_mm),
        "sensor_mm": sensor_mm and list(sensor_mm),
    }
    return Answer(data, [f"{state_text(seen.state)}, {where}; machine {machine}"])
