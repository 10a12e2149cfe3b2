"""One move of a GRBL controller: sent as a jog, listened to, followed to its end."""

from __future__ import annotations

from ...aliases import Vector
from ...errors import InputError
from ...protocols.motion import minus, move_duration_s
from ..interface import StageState
from .controller import JOG_CANCEL, MARGIN_S, POLL_END_S, Controller, Move, in_mm
from .exchange import NoAnswer, TalkFault
from .grbl_messages import state_in_words
from .settings import AXES

ANSWER_S = 0.5  # it comes within .1 s, and without it the carriage may be on its way
HEAR_S = 0.005  # between two looks at what was said without being asked for
POLL_S = 0.1  # while a move is under way; the firmware's documents ask for at most 10 a second


def begin(c: Controller, target_mm: Vector, feed_mm_min: float) -> float:
    """Send one straight move to machine coordinates; its planned time (s). Within an exchange.

    Raises InputError, with nothing sent, beyond travel or feed; Fault where it does not begin.
    """
    x, y, z = (round(p, 4) + 0.0 for p in target_mm)
    machine = (x, y, z)
    delta = minus(machine, c.at_mm)
    limits = c.limits
    if why := limits.target_refusal(machine) or limits.feed_refusal(delta, feed_mm_min):
        raise InputError(f"{c.url}: {why}")
    planned_s = move_duration_s(delta, feed_mm_min, limits.axes(110), limits.axes(120))
    words = "".join(f"{axis}{p:.4f}" for axis, p in zip(AXES, machine, strict=True))
    c.talk.drain()
    c.move = Move(machine, c.port.now_ns(), planned_s)
    if c.cancelled:
        raise TalkFault("stopped before it moved")
    _send(c, f"$J=G90G21G53{words}F{feed_mm_min:.3f}")
    if c.cancelled:  # while the line was read, which drops the byte
        c.port.write(JOG_CANCEL)
    return planned_s


def follow(c: Controller, move: Move) -> StageState:
    """Wait until the move is at its target, polling. Raises StageError when it does not come to."""
    limit_s = move.planned_s * 1.1 + MARGIN_S
    idle_short = 0
    while True:
        left_s = move.planned_s - move.since_s(c.port.now_ns())
        if left_s > 0 or idle_short:
            listen(c, min(POLL_S, max(left_s + 0.002, POLL_END_S)))
        with c.exchange():
            state = poll(c)
            if state.state == "Idle":
                if c.limits.same_place(move.target_mm, state.machine_mm):
                    c.move = None
                    # The next move starts from what was commanded, not from its rounding.
                    c.at_mm = move.target_mm
                    return state
                idle_short += 1
                if idle_short == 2:
                    c.move = None
                    raise TalkFault(
                        f"stopped at {in_mm(state.machine_mm)} short of {in_mm(move.target_mm)}"
                    )
            elif state.state != "Jog":
                raise TalkFault(
                    f"{state_in_words(state.state)} during a move to {in_mm(move.target_mm)}, "
                    "expected Jog"
                )
            if move.since_s(c.port.now_ns()) > limit_s:
                raise TalkFault(
                    f"still {state.state} at {in_mm(state.machine_mm)} after {limit_s:.1f} s; the "
                    f"move to {in_mm(move.target_mm)} was planned to take {move.planned_s:.1f} s"
                )
        if left_s <= 0 and not idle_short:
            listen(c, POLL_END_S)


def listen(c: Controller, seconds: float) -> None:
    """Let that much time pass, hearing what the controller says meanwhile. Raises StageError."""
    deadline = c.port.deadline_ns(seconds)
    while True:
        if c.port.is_open:
            with c.exchange():
                c.talk.overhear()
        left_ns = deadline - c.port.now_ns()
        if left_ns <= 0:
            return
        c.clock.sleep_s(min(left_ns / 1e9, HEAR_S))


def poll(c: Controller) -> StageState:
    """Ask once. Raises StageError for an alarm, a restart or silence: the first reason is told."""
    with c.exchange():
        if c.trouble:
            raise TalkFault(c.trouble)
        state = c.status()
        c.at_mm = state.machine_mm
        c.require_position(state)
        if c.cancelled and state.state == "Jog":  # it came before the jog began
            c.port.write(JOG_CANCEL)
        return state


def _send(c: Controller, line: str) -> None:
    """In Hold or behind an open door it is heard, and not answered."""
    try:
        c.talk.command(line, ANSWER_S)
    except NoAnswer as why:
        halted = c.halt()
        state = c.status().state
        if state.partition(":")[0] not in ("Hold", "Door"):
            raise TalkFault(f"{why.why}{halted}", lost=True) from why
        # The line waits in the controller: the reset of the next `stop` is what forgets it.
        raise TalkFault(f"{state_in_words(state)}: no move begins{halted}") from why
