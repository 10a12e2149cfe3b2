"""One move of a GRBL controller: sent as jogs, listened to, followed to its end.

Unless it leads away from the face it is sent in pieces, each as late as its speed allows: a host
that dies, or whose cable is out, leaves a tip that goes on for `AHEAD_S` and no further.
"""

from __future__ import annotations

import math
from dataclasses import replace

from deltact_fab.common import InputError, Point

from ...protocols.motion import along_line, move_duration_s, subtract_vectors
from ..interface import StageState
from .controller import (
    AHEAD_CLEAR_S,
    JOG_CANCEL,
    PLANNED_AHEAD_S,
    POLL_END_S,
    STOP_MARGIN_S,
    Controller,
    Move,
    in_mm,
)
from .exchange import NoAnswer, TalkFault, state_text
from .settings import AXIS_LETTERS

JOG_ANSWER_S = 0.5  # it comes within 0.1 s, and without it the carriage may be on its way
LISTEN_PERIOD_S = 0.005  # between two looks at what was said without being asked for
STATUS_POLL_S = 0.1
MIN_UP_SHARE = 0.9  # of a way that leads away from the face, at least so much is upwards
HELD_S, HELD_CLEAR_S = 0.03, 0.1  # behind its plan: in the gel, and where nothing is touched
JOG_ATTEMPTS = 3  # of a line that is not answered, where nothing is touched


def begin(
    c: Controller, target_mm: Point, feed_mm_min: float, clear: bool, at_once: bool = False
) -> float:
    """Start one straight move to machine coordinates; its planned time (s). Within an exchange.

    clear: nothing is touched on the way, and an answer that is lost does not end it. at_once: the
    controller is told all of it. Raises InputError, with nothing sent, beyond travel or feed;
    TalkFault where it does not begin.
    """
    x, y, z = (round(p, 4) + 0.0 for p in target_mm)
    machine = (x, y, z)
    delta = subtract_vectors(machine, c.at_mm)
    limits = c.limits
    if refusal := limits.target_refusal(machine) or limits.feed_refusal(delta, feed_mm_min):
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
    _send(c, _line(c, c.move, c.move.first_mm()))
    if not send_all:  # it has begun by now, and not long before that where an answer is slow
        c.move = replace(c.move, start_ns=c.port.now_ns())
    if c.cancelled:  # while the line was read, which drops the byte
        c.port.write(JOG_CANCEL)
    return planned_s


def feed(c: Controller) -> None:
    """Send the next piece of the move under way if it is due. Within an exchange."""
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
    late = move.runs_dry(now_ns, braking=True)
    if late:
        c.waits += 1
        c.move = move = replace(move, late_ns=now_ns)
    if move.runs_dry(now_ns):
        from_mm = move.point_at_mm(move.sent_mm)
        rest_mm = subtract_vectors(move.target_mm, from_mm)
        axes = c.limits.axes
        planned_s = move_duration_s(rest_mm, move.feed_mm_min, axes(110), axes(120))
        c.move = move = move.remainder(from_mm, now_ns, planned_s)
    if (due_mm := move.due_mm(now_ns)) is not None:
        c.talk.post(_line(c, move, due_mm))
        if c.cancelled:  # meanwhile, by another thread
            c.port.write(JOG_CANCEL)


def follow(c: Controller) -> StageState:
    """Wait until the move is at its target, polling. Raises StageError when it does not come to."""
    idle_short = 0
    while (move := c.move) is not None:
        limit_s = move.planned_s * 1.1 + STOP_MARGIN_S
        left_s = move.planned_s - move.since_s(c.port.now_ns())
        if left_s > 0 or idle_short:
            listen(c, min(STATUS_POLL_S, max(left_s + 0.002, POLL_END_S)))
        with c.exchange():
            state = poll(c)
            if state.state == "Idle":
                if c.limits.same_place(move.target_mm, state.machine_mm):
                    c.move = None
                    # The next move starts from what was commanded, not from its rounding.
                    c.at_mm = move.target_mm
                    return state
                idle_short += move.is_sent or c.cancelled
                if idle_short == 2:
                    c.move = None
                    raise TalkFault(
                        f"stopped at {in_mm(state.machine_mm)} short of {in_mm(move.target_mm)}"
                    )
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
        if left_s <= 0 and not idle_short:
            listen(c, POLL_END_S)
    return poll(c)


def listen(c: Controller, seconds: float) -> None:
    """Let that much time pass; what the controller says is heard, what is due is sent meanwhile.

    Raises StageError.
    """
    deadline = c.port.deadline_ns(seconds)
    while True:
        if c.port.is_open:
            with c.exchange():
                c.talk.handle_received()
                feed(c)
        left_ns = deadline - c.port.now_ns()
        if left_ns <= 0:
            return
        c.clock.sleep_s(min(left_ns / 1e9, LISTEN_PERIOD_S))


def poll(c: Controller) -> StageState:
    """Ask once. Raises StageError for an alarm, a restart or silence: the first reason is told."""
    with c.exchange():
        if c.trouble:
            raise TalkFault(c.trouble)
        state = c.status()
        c.at_mm = state.machine_mm
        c.require_position(state)
        if c.move is not None and state.state in ("Jog", "Idle") and not c.cancelled:
            # A hold ends one jog: no other follows it.
            c.cancelled |= c.move.was_held(state, HELD_CLEAR_S if c.clear else HELD_S)
            c.move = c.move.retimed(state)
        if c.cancelled and state.state == "Jog":  # the byte came before the jog began
            c.port.write(JOG_CANCEL)
        return state


def _line(c: Controller, move: Move, due_mm: float) -> str:
    """The jog that leads so far along it."""
    machine = move.point_at_mm(due_mm)
    c.move = replace(move, sent_mm=due_mm)
    words = "".join(f"{axis}{p:.4f}" for axis, p in zip(AXIS_LETTERS, machine, strict=True))
    return f"$J=G90G21G53{words}F{move.feed_mm_min:.3f}"


def _send(c: Controller, line: str) -> None:
    """Send it and hear its ok. The same place once more is no motion, so it may be sent again."""
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
    """A line was not answered in time: raise, unless nothing is touched and it may go on.

    In Hold or behind an open door a line is heard, and not answered.
    """
    halted = "" if c.clear else c.halt()
    state = c.status().state
    if state.partition(":")[0] in ("Hold", "Door"):
        # The line waits in the controller: the reset of the next `stop` is what forgets it.
        raise TalkFault(f"{state_text(state)}: no move begins{halted or c.halt()}") from fault
    if not c.clear or state not in ("Idle", "Jog"):
        raise TalkFault(f"{fault.reason}{halted}", position_lost=True) from fault
    c.waits += 1
    if c.talk.posted is None:
        return True
    c.talk.forget_posted()
    return False
