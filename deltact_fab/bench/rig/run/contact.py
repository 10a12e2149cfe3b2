"""End of a contact: the tip goes straight up until the force sensor feels nothing.

A force ends a contact, not a height: a tip longer than declared touches above the expected face.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress

import numpy as np

from deltact_fab.common import DeltactFabError, InputError, Point, StageError, Stopped, to_ns

from ..interface import CONTACT_N, LIFT_FEED_MM_MIN, Clock, ForceSensor, Guard, Stage

# By hand: a lift is long enough to leave the gel, a step short, a mean less noisy than a sample.
MIN_LIFT_MM = 2.0
LIFT_STEP_MM = 1.0
LETS_GO_MM = 5.0  # within these a contact with a gel has lost more than half of its force
MEAN_FORCE_S = 0.05
STEADY_N = 0.05  # a force below the threshold is none if it is less, or changes by less in a step
NOT_LIFTED = (
    "the tip was NOT lifted and may be in the gel: switch the motors off and turn z up by hand"
)
FeltForce = Callable[[], float | None]
"""Magnitude of the present force (N); None without a reading."""


def mean_force_n(clock: Clock, force: ForceSensor) -> float:
    """Magnitude of the mean force (N) of the next MEAN_FORCE_S, the stream on.

    Raises SensorError.
    """
    start_ns = clock.now_ns()
    total, n = np.zeros(3), 0
    while True:
        samples = force.read()
        fresh_n = samples.force_n[samples.t_ns >= start_ns]
        total, n = total + fresh_n.sum(axis=0), n + len(fresh_n)
        if n and samples.t_ns[-1] >= start_ns + to_ns(MEAN_FORCE_S):
            return float(np.linalg.norm(total / n))


@contextmanager
def streaming(clock: Clock, force: ForceSensor | None) -> Iterator[FeltForce]:
    """Start the force sensor with its last tare and yield its force; a failed one reads None."""
    if force is None:
        yield lambda: None
        return

    def felt_n() -> float | None:
        with suppress(DeltactFabError):
            force.stop()  # nobody may have read it meanwhile
            force.start()
            return mean_force_n(clock, force)
        return None

    with suppress(DeltactFabError):
        force.start()
    try:
        yield felt_n
    finally:
        with suppress(DeltactFabError):
            force.stop()


def end_contact(
    stage: Stage, felt_n: FeltForce, contact_n: float = CONTACT_N, to_mm: float | None = None
) -> str:
    """Stop and go straight up until nothing is felt; return the outcome, never raise.

    At least MIN_LIFT_MM, and to the height to_mm (sensor frame) if that is higher; at most to the
    top of the travel. With the position lost only if the controller rests with its count kept.
    """
    try:
        if stage.homed and _stops(stage):
            return _lift(stage, stage.position_mm()[2], felt_n, contact_n, to_mm)
        with stage.recovery() as at_mm:
            if at_mm is None:
                return NOT_LIFTED
            outcome = _lift(stage, at_mm[2], felt_n, contact_n, to_mm)
            return f"the controller kept its position: {outcome}"
    except KeyboardInterrupt:
        stage.cancel()
        return "the lift was stopped by the operator"
    except DeltactFabError as error:
        force_n = felt_n()
        place = "" if force_n is None or force_n <= contact_n else f", in the gel, {force_n:.1f} N"
        return f"the tip could NOT be lifted{place}: {error}"


def eased(guard: Guard | None) -> AbstractContextManager[None]:
    """Raise the limits of a guard, if there is one, for a lift."""
    return nullcontext() if guard is None else guard.easing()


def _stops(stage: Stage) -> bool:
    with suppress(StageError):
        stage.stop()
        return True
    return False


def _lift(
    stage: Stage, z_mm: float, felt_n: FeltForce, contact_n: float, to_mm: float | None
) -> str:
    step_mm = max(MIN_LIFT_MM, 0.0 if to_mm is None else to_mm - z_mm)
    risen_mm, forces_n = 0.0, [math.inf]
    while True:
        up_mm = stage.lift(step_mm, LIFT_FEED_MM_MIN)
        if up_mm is None:
            return NOT_LIFTED
        risen_mm, at_top = risen_mm + up_mm, up_mm < step_mm - 1e-3
        force_n = felt_n()
        if force_n is None:
            return f"the tip was raised by {risen_mm:.2f} mm, contact unknown: no force reading"
        steady = force_n <= STEADY_N or forces_n[-1] - force_n <= STEADY_N
        if force_n <= contact_n and (steady or at_top):
            return f"the tip was lifted by {risen_mm:.2f} mm, force {force_n:.2f} N"
        forces_n.append(force_n)
        stays = risen_mm >= LETS_GO_MM and force_n > forces_n[1] / 2
        if at_top or stays:
            reason = "at the top of the travel" if at_top else "it has not fallen, or drifts"
            text = f"force {force_n:.1f} N, {risen_mm:.2f} mm higher, {reason}"
            return f"the tip may be in the gel: {text}"
        step_mm = LIFT_STEP_MM


def position_text(position_mm: Point) -> str:
    """Format a tip position."""
    x, y, z = (round(p, 3) + 0.0 for p in position_mm)
    return f"x {x:.3f}, y {y:.3f}, z {z:.3f} mm (sensor)"


@contextmanager
def lift_after_error(
    stage: Stage, clock: Clock, force: ForceSensor | None, guard: Guard | None
) -> Iterator[None]:
    """Lift the tip if the block fails or is interrupted, which raises Stopped.

    The error's line ends with the outcome. An InputError, before any motion, lifts nothing.
    """
    try:
        yield
    except InputError:
        raise
    except (DeltactFabError, KeyboardInterrupt) as error:
        with eased(guard), streaming(clock, force) as felt_n:
            outcome = end_contact(stage, felt_n)
        if isinstance(error, KeyboardInterrupt):
            place = ""
            with suppress(StageError):
                place = f" at {position_text(stage.position_mm())}"
            raise Stopped(f"stopped by the operator; {outcome}{place}") from error
        raise type(error)(f"{error}; {outcome}") from error
