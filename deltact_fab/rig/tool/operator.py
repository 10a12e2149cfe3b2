"""The operator: who is asked, and what counts as a confirmation; homing, which may need his word.

A session begins at a stage that somebody left somewhere, after a failure with the tip in the gel as
likely as not. Homing goes up first (GRBL homes z before x and y), but fast, and a firmware that was
built with another order drags the tip through the gel.
"""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray

from ...errors import RunFailed, StageError
from ..interface import LIFT_FEED_MM_MIN, Clock, ForceSensor, Guard, Stage
from ..run.loop import watched

TRIES = 5
LIFT_MM = 25.0
STANDING_S = 0.1
CONTACT_N = 0.3
"""More than this, on the tare of whoever measured last, is a tip that touches or a sensor that was
never tared: both are for the operator to see."""
CLEAR = "clear"


class TerminalOperator:
    """Asks on standard error and reads lines of standard input."""

    def tell(self, text: str) -> None:
        """A line on standard error, so that standard output stays what the command prints."""
        print(text, file=sys.stderr, flush=True)

    def ask(self, text: str) -> str:
        """Wait for a line, without blanks at its ends. Raises RunFailed when none can come."""
        print(f"{text}: ", end="", file=sys.stderr, flush=True)
        line = sys.stdin.readline()
        if not line:
            raise RunFailed(f"nobody answered ({text}): standard input has ended")
        return line.strip()


def confirm(operator: TerminalOperator, name: str, what: str) -> None:
    """Wait until somebody types the name of what they mounted; another name is asked again.

    what: ends "type NAME to confirm that". Raises RunFailed after TRIES other answers.
    """
    for _ in range(TRIES):
        answer = operator.ask(f"type {name} to confirm that {what}")
        if answer == name:
            return
        operator.tell(f"that was {answer!r}, not {name!r}")
    raise RunFailed(f"{name}: not confirmed in {TRIES} answers")


def clear_the_face(
    stage: Stage,
    clock: Clock,
    force: ForceSensor | None,
    operator: TerminalOperator | None,
    *,
    tip_is_clear: bool = False,
    air: bool = False,
) -> str:
    """Make sure that homing drags no tip through the gel; says how.

    stage: connected, not moved yet. Where its position is known it goes straight up, slowly, as far
    as its travel goes but no more than LIFT_MM. Where it is lost nothing can be lifted: then the
    force sensor has to feel nothing, or the operator to give his word, here (`operator`) or before
    (tip_is_clear). air: of a rig without a force sensor nothing is asked, for no run of it pressed.
    Raises StageError when neither is there.
    """
    if stage.lift(LIFT_MM, LIFT_FEED_MM_MIN):
        return "the position was known: lifted straight up before homing"
    if tip_is_clear:
        return "the position was lost; the operator's word that the tip is clear"
    why = "no force sensor can tell whether the tip is in the gel"
    if force is not None:
        felt_n = _standing_n(clock, force)
        if felt_n <= CONTACT_N:
            return f"the position was lost; the force sensor feels {felt_n:.2f} N: clear"
        why = (
            f"the force sensor feels {felt_n:.2f} N: the tip may be in the gel (or the sensor was "
            "not tared since it was mounted)"
        )
    elif air:
        return "the position was lost; a rig without a force sensor, in air"
    if operator is None:
        raise StageError(
            f"not homed: the position is lost, and {why}; look, turn z up by hand, and give "
            "--tip-is-clear"
        )
    operator.tell(f"the position is lost, and {why}; look, and turn z up by hand if it is")
    confirm(operator, CLEAR, "the tip touches nothing")
    return "the position was lost; the operator confirmed that the tip is clear"


def home_safely(
    stage: Stage,
    clock: Clock,
    force: ForceSensor | None,
    operator: TerminalOperator | None,
    *,
    tip_is_clear: bool = False,
    guard: Guard | None = None,
) -> str:
    """Clear the face, then home with the guard armed; says how. Raises StageError, SensorError."""
    how = clear_the_face(stage, clock, force, operator, tip_is_clear=tip_is_clear)
    with watched(stage, clock, force, guard):
        stage.home()
    return how


def _standing_n(clock: Clock, force: ForceSensor) -> float:
    """Size of the mean force while nothing moves, on the tare that the sensor still has."""
    force.start()
    try:
        parts: list[NDArray[np.float64]] = []
        end_s = clock.now_s() + STANDING_S
        while not parts or clock.now_s() < end_s:
            parts.append(force.read().force_n)
        return float(np.linalg.norm(np.concatenate(parts).mean(axis=0)))
    finally:
        force.stop()
