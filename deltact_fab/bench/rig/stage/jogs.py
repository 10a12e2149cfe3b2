"""One move of a GRBL controller: sent as jogs, monitored, followed to its end.

Unless it leads away from the face it is sent in pieces, each as late as its speed allows: if the
host dies or the cable is pulled, the tip goes on for PLANNED_AHEAD_S at most.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from deltact_fab.common import InputError, Point

from ...protocols.motion import along_line, move_duration_s, subtract_vectors
from ..interface import StageState
from .controller import (
    AHEAD_CLEAR_S,
    FEED_HOLD,
    JOG_CANCEL,
    PLANNED_AHEAD_S,
    POLL_END_S,
    STOP_MARGIN_S,
    STOPS_BY_STATE,
    Controller,
    Move,
    in_mm,
)
from .exchange import LineRefused, NoAnswer, TalkFault, state_text
from .settings import AXIS_LETTERS, as_commanded

# Decision 0073; by hand: longer waits overrun in the gel, shorter ones stop a slow controller.
JOG_ANSWER_S = 0.5  # measured: 0.05 s (docs/evidence/firmware.md)
LISTEN_PERIOD_S = 0.005  # between two reads of unsolicited lines
STATUS_POLL_S = 0.1  # in a move; GRBL's documents ask for at most 10 per second
MIN_UP_SHARE = 0.9  # upward share of a move that leads away from the face
HELD_S, HELD_CLEAR_S = 0.03, 0.1  # largest delay in the gel, and clear of the face
JOG_ATTEMPTS = 3  # for a line without an answer, clear of the face
ERROR_NOT_IDLE = "8"  # STATUS_IDLE_ERROR of GRBL 1.1


def start_move(
    c: Controller, target_mm: Point, feed_mm_min: float, clear: bool, at_once: bool = False
) -> float:
    """Start one straight move to machine coordinates; return its planned time (s).

    Call within an exchange. clear: stays clear of the face, so that a lost answer does not end it.
    at_once: send all of it. Raises InputError, with nothing sent, beyond travel or feed; TalkFault
    if it does not begin.
    """
    machine, limits = as_commanded(target_mm), c.limits
    delta = subtract_vectors(machine, c.at_mm)
    if refusal := limits.move_refusal(c.at_mm, machine, feed_mm_min):
        raise InputError(f"{c.url}: {refusal}")
    planned_s = move_duration_s(delta, feed_mm_min, limits.axes(110), limits.axes(120))
    accel = along_line(delta, limits.axes(120)) if any(delta) else math.inf
    send_all = at_once or delta[2] >= MIN_UP_SHARE * math.hypot(*delta)
    ahead_s = max(AHEAD_CLEAR_S if clear else PLANNED_AHEAD_S, feed_mm_min / 60 / accel)
    c.talk.drain()
    now_ns = c.port.now_ns()
    c.clear = clear
    c.move = Move(
        c.at_mm, machine, feed_mm_min, accel, now_ns, planned_s, math.inf if send_all else ahead_s
    )
    if c.cancelled:
        raise TalkFault("stopped before it moved")
    _send(c, _jog_command(c, c.move, c.move.first_mm()))
    if not send_all:  # begun by now, and not long before with a slow answer
        c.move = replace(c.move, start_ns=c.port.now_ns())
    if c.cancelled:  # in reading the line the controller drops the byte
        c.port.write(JOG_CANCEL)
    return planned_s


def send_due_piece(c: Controller) -> None:
    """Send the next piece of the present move if due. Call within an exchange."""
    move = c.move
    if move is None or move.is_sent or c.cancelled:
        return
    now_ns = c.port.now_ns()
    if c.talk.posted is not None:
        line, since_ns = c.talk.posted
        if now_ns - since_ns > JOG_ANSWER_S * 1e9:
            fault = NoAnswer(f"no answer to {line} within {JOG_ANSWER_S:g} s", position_lost=True)
            if not _answer_came_late(c, fault):
                _send(c, line)
        return
    if move.runs_dry(now_ns, braking=True):
        c.waits += 1
        c.move = move = replace(move, late_ns=now_ns)
    if move.runs_dry(now_ns):
        c.move = move = _remainder(c, move, move.point_at_mm(move.sent_mm))
    if (due_mm := move.due_mm(now_ns)) is not None:
        c.talk.post(_jog_command(c, move, due_mm))
        if c.cancelled:  # by another thread
            c.port.write(JOG_CANCEL)


def wait_for_target(c: Controller, stops: Callable[[], bool] | None = None) -> StageState | None:
    """Poll until the move is at its target; None when `stops` returned True before.

    stops: called before each part of the move is sent. Raises StageError if it does not arrive.
    """
    idle_short = 0
    while (move := c.move) is not None:
        limit_s = move.planned_s * 1.1 + STOP_MARGIN_S
        left_s = move.planned_s - move.since_s(c.port.now_ns())
        if left_s > 0 or idle_short:
            slice_s = max(left_s + 0.002, POLL_END_S)
            if listen(c, slice_s if stops else min(STATUS_POLL_S, slice_s), stops):
                return None
        with c.exchange():
            state = poll(c)
            if state.state == "Idle":
                if c.limits.same_place(move.target_mm, state.machine_mm):
                    c.move = None
                    # The next move starts from the commanded position, not its rounding.
                    c.at_mm = move.target_mm
                    return state
                idle_short += move.is_sent or c.cancelled
                if idle_short == 2:
                    c.move = None
                    raise TalkFault(
                        f"stopped at {in_mm(state.machine_mm)} short of {in_mm(move.target_mm)}"
                    )
            elif state.state == "Run":
                _wait_for_run(c, TalkFault(f"Run during a move to {in_mm(move.target_mm)}"))
            elif state.state != "Jog":
                raise TalkFault(
                    f"{state_text(state.state)} during a move to {in_mm(move.target_mm)}, "
                    "expected Jog"
                )
            if move.since_s(c.port.now_ns()) > limit_s:
                raise TalkFault(
                    f"still {state.state} at {in_mm(state.machine_mm)} after {limit_s:.1f} s; the "
                    f"move to {in_mm(move.target_mm)} was planned to take {move.planned_s:.1f} s"
                )
        if left_s <= 0 and not idle_short and listen(c, POLL_END_S, stops):
            return None
    return poll(c)


def listen(c: Controller, seconds: float, stops: Callable[[], bool] | None = None) -> bool:
    """Wait; meanwhile handle the controller's lines and send due pieces.

    Returns True as soon as `stops` does. Raises StageError.
    """
    deadline = c.port.deadline_ns(seconds)
    while True:
        if stops is not None and stops():
            return True
        if c.port.is_open:
            with c.exchange():
                try:
                    c.talk.handle_received()
                    send_due_piece(c)
                except LineRefused as refusal:
                    _wait_for_run(c, refusal)
        left_ns = deadline - c.port.now_ns()
        if left_ns <= 0:
            return False
        c.clock.sleep_s(min(left_ns / 1e9, LISTEN_PERIOD_S))


def _wait_for_run(c: Controller, fault: TalkFault) -> None:
    """Wait for the end of a jog that the controller began as Run, then continue from rest.

    A line read just as the one before it ends is begun so; then jogs and their stop byte are
    refused. Raises the fault if it does not end, or for a line refused for another reason.
    """
    move = c.move
    if move is None or (isinstance(fault, LineRefused) and fault.number != ERROR_NOT_IDLE):
        raise fault
    deadline = c.port.deadline_ns(c.limits.braking_s() + move.ahead_s + STOP_MARGIN_S)
    while (state := c.status()).state == "Run" and c.port.now_ns() < deadline:
        if c.cancelled:
            c.port.write(FEED_HOLD)
        c.clock.sleep_s(POLL_END_S)
    if state.state != "Idle":
        raise fault
    c.waits += 1
    c.move = _remainder(c, move, state.machine_mm)


def _remainder(c: Controller, move: Move, from_mm: Point) -> Move:
    """Return the remainder of a move, from rest."""
    now_ns, axes = c.port.now_ns(), c.limits.axes
    delta_mm = subtract_vectors(move.target_mm, from_mm)
    planned_s = move_duration_s(delta_mm, move.feed_mm_min, axes(110), axes(120))
    return replace(
        move, start_mm=from_mm, start_ns=now_ns, planned_s=planned_s, sent_mm=0.0, late_ns=now_ns
    )


def poll(c: Controller) -> StageState:
    """Request one status. Raises StageError for an alarm, a restart or silence."""
    with c.exchange():
        if c.trouble:
            raise TalkFault(c.trouble)
        try:
            state = c.status()
        except LineRefused as refusal:
            _wait_for_run(c, refusal)
            state = c.status()
        c.at_mm = state.machine_mm
        c.require_position(state)
        if c.move is not None and state.state in ("Jog", "Idle") and not c.cancelled:
            # A hold ends only one jog: send no other.
            c.cancelled |= c.move.was_held(state, HELD_CLEAR_S if c.clear else HELD_S)
            c.move = c.move.retimed(state)
        if c.cancelled and state.state in STOPS_BY_STATE:  # it came before the jog, or is not heard
            c.port.write(STOPS_BY_STATE[state.state])
        return state


def _jog_command(c: Controller, move: Move, due_mm: float) -> str:
    """Return the jog command to a distance along the move."""
    machine = move.point_at_mm(due_mm)
    c.move = replace(move, sent_mm=due_mm)
    words = "".join(f"{axis}{p:.4f}" for axis, p in zip(AXIS_LETTERS, machine, strict=True))
    return f"$J=G90G21G53{words}F{move.feed_mm_min:.3f}"


def _send(c: Controller, line: str) -> None:
    """Send a line and wait for its ok; a repetition is safe, as its target is absolute."""
    for attempts_left in range(JOG_ATTEMPTS - 1, -1, -1):
        try:
            c.talk.command(line, JOG_ANSWER_S)
        except NoAnswer as fault:
            if _answer_came_late(c, fault):
                return
            if not attempts_left:
                raise
        else:
            return


def _answer_came_late(c: Controller, fault: NoAnswer) -> bool:
    """Return True if a missing answer came late, False to send again; raise in the gel.

    In Hold or behind an open door a line is accepted but not answered.
    """
    halted = "" if c.clear else c.halt()
    state = c.status().state
    if state.partition(":")[0] in ("Hold", "Door"):
        # The line waits in the controller until the reset of the next `stop`.
        raise TalkFault(f"{state_text(state)}: no move was started{halted or c.halt()}") from fault
    if not c.clear or state not in ("Idle", "Jog"):
        raise TalkFault(f"{fault.reason}{halted}", position_lost=True) from fault
    c.waits += 1
    if c.talk.posted is None:
        return True
    c.talk.forget_posted()
    return False
