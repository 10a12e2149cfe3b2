"""Rehearsed faults: injection, allowed outcomes, detection time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from deltact_fab.simulate import FaultBench

FALSE_BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
GARBAGE_BYTES = b"\xff\x00\x8a~|<\xff\x00\x00\xfe\r\n\xff\x00"  # one line and a part of the next
DRIFT_S = 10.0  # by hand: time to the guard's limit; slower outlasts a step
UNFELT_S = 60.0  # by hand: a scale that is stuck is told by a press, not before
PUSH_FACTOR = 1.05  # by hand: times that limit; more may saturate the sensor

# Moments outside of the steps.
HOMING_MOMENT, BEFORE_MOVE_MOMENT = "homing", "before the first move"
Strike = Callable[[FaultBench, float], None]


@dataclass(frozen=True)
class FaultKind:
    """strike: schedules the fault, s. says: error texts, one of which the run must end with.
    success: the run may also finish undisturbed.

    within_s: None if the fault is an event (a line, a sample): travel counts from it. Else a lack
    of one, which the host detects after a timeout of at most this; travel counts from detection.
    homing: the fault can also strike during homing.
    """

    name: str
    strike: Strike
    says: tuple[str, ...]
    success: bool = False
    within_s: float | None = None
    homing: bool = True
    carries: bool = True
    """True if a stop byte can reach the board; else the move goes on to its target."""


def _box(field: str, value: float, for_s: float = 1e6) -> Strike:
    def strike(bench: FaultBench, at_s: float) -> None:
        bench.call_at(at_s, lambda: setattr(bench.box_faults, field, value))
        bench.call_at(at_s + for_s, lambda: setattr(bench.box_faults, field, 0))

    return strike


def _push(for_s: float) -> Strike:
    def strike(bench: FaultBench, at_s: float) -> None:
        push_n = PUSH_FACTOR * bench.scenario.limit_n  # within the sensor's range, if possible
        bench.extra_n = lambda t_s: push_n if at_s <= t_s < at_s + for_s else 0.0

    return strike


def _drift(bench: FaultBench, at_s: float) -> None:
    rate_n_s = bench.scenario.limit_n / DRIFT_S
    bench.extra_n = lambda t_s: max(t_s - at_s, 0.0) * rate_n_s


FAULT_KINDS: tuple[FaultKind, ...] = (
    FaultKind("lost ok", lambda b, at_s: b.board.lose(b"ok", at_s, limit=1),
              ("no answer to $",), success=True, within_s=0.6),
    FaultKind("doubled ok", lambda b, at_s: b.board.alter_lines(lambda s: s + s, b"ok", at_s), (),
              success=True),
    FaultKind("false banner", lambda b, at_s: b.board.inject(FALSE_BANNER, at_s), ("restarted",)),
    FaultKind("false alarm", lambda b, at_s: b.board.inject(b"ALARM:3\r\n", at_s), ("ALARM:3",)),
    FaultKind("garbage, 0xFF and NUL", lambda b, at_s: b.board.inject(GARBAGE_BYTES, at_s),
              ("no answer to", "not understood"), success=True, within_s=1.2),
    FaultKind("half lines",
              lambda b, at_s: b.board.alter_lines(lambda s: s[: len(s) // 2], b"", at_s, limit=3),
              ("no answer to", "cannot be read"), success=True, within_s=1.2),
    FaultKind("limit switch", lambda b, at_s: b.board.fault("limit", at_s), ("ALARM:1",)),
    FaultKind("soft limit", lambda b, at_s: b.board.fault("soft limit", at_s), ("ALARM:2",)),
    FaultKind("safety door", lambda b, at_s: b.board.fault("door", at_s),
              ("Door", "door", "ALARM:6", "ALARM:7"), success=True),
    FaultKind("reboot", lambda b, at_s: b.board.fault("reboot", at_s),
              ("restarted", "no answer to"), within_s=1.2),
    FaultKind("unplugged for 0.5 s", lambda b, at_s: b.link.unplug(0.5, at_s),
              ("the link is lost",), success=True, within_s=0.7),
    FaultKind("unplugged for good", lambda b, at_s: b.link.unplug(1e9, at_s),
              ("the link is lost",), carries=False),
    FaultKind("silent for 1 s", lambda b, at_s: b.board.lose(at_s=at_s, for_s=1.0),
              ("no answer to",), success=True, within_s=1.2),
    FaultKind("silent for 30 s", lambda b, at_s: b.board.lose(at_s=at_s, for_s=30.0),
              ("no answer to",), within_s=1.2),
    FaultKind("disk full", lambda b, at_s: b.call_at(at_s, FaultBench.fill_disk),
              ("No space left", "disk is full", "disk I/O error", "too large"), within_s=3.0),
    FaultKind("force over the limit", _push(1e6), ("over the guard's",), homing=False),
    FaultKind("force spike of 5 ms", _push(0.005), ("over the guard's",), homing=False),
    FaultKind("force drifting", _drift, ("over the guard's",), success=True, homing=False),
    FaultKind("force silent", _box("silent", True), ("no sample within",), within_s=0.2,
              homing=False),
    FaultKind("force late by 0.15 s", _box("late_s", 0.15), ("no sample within", "late"),
              within_s=0.2, homing=False, success=True),
    FaultKind("force late by 0.03 s", _box("late_s", 0.03), ("late",), homing=False, success=True),
    FaultKind("force faulted", _box("error", True), ("fault, status word",), homing=False),
    FaultKind("force saturated", _box("saturated", True), ("saturated",), homing=False),
    FaultKind("force frozen", _box("frozen", True), ("the FT sequence stands",), within_s=0.2,
              homing=False),
    FaultKind("force values frozen", _box("stuck", True), ("readings do not change",), within_s=0.3,
              homing=False),
    FaultKind("scale stuck", lambda b, at_s: setattr(b, "scale_stuck_s", at_s),
              ("readings do not change",), success=True, within_s=UNFELT_S, homing=False),
    FaultKind("force gaps of 20 ms", _box("silent", True, 0.02), ("missing",), success=True,
              homing=False),
    FaultKind("camera stalled", lambda b, at_s: b.camera_faults.update(stalled=at_s),
              ("stalled: no image within",), within_s=1.2, homing=False),
    FaultKind("camera repeating", lambda b, at_s: b.camera_faults.update(hung=at_s),
              ("the same image ",), within_s=1.2, homing=False),
)  # fmt: skip
