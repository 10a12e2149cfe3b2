"""A lab's own protocol and rig file through every fault, on the simulated bench in lockstep.

A cell is one fault at one moment: what the run ended in, how far the carriage went, and what is
kept. It goes on with a run whose first press is committed, so that there is something to lose.
"""

from __future__ import annotations

import math
import random
import shutil
import tempfile
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from deltact_fab.bench import GrblStage, open_run, read_press_rows
from deltact_fab.common import DeltactFabError, Progress, RunFailed, run_each
from deltact_fab.simulate import FaultBench, FaultScenario

from .kinds import BEFORE, FAULTS, HOMING, FaultKind

REACTION_S = 0.010  # of motion, beyond the braking distance
ROUNDING_MM = 0.003
HOMING_S = 60.0  # a homing board answers nothing until it is done, so that long it is waited for
STOPS = (b"\x85", b"\x18", b"!")
Rows = dict[str, list[tuple[Any, ...]]]


@dataclass(frozen=True)
class FaultOutcome:
    """outcome: "success" or the error. travel_mm, allowed_mm: after the error; None where nothing
    moved or nothing failed. known_s: from the fault until the host could know, or knew. wrong: what
    is not as it must be, "" when all is. deeper_mm: than at the fault."""

    fault: str
    moment: str
    outcome: str
    travel_mm: float | None = None
    allowed_mm: float | None = None
    known_s: float | None = None
    wrong: str = ""
    deeper_mm: float = 0.0


class Matrix:
    """What all cells share: the undisturbed run, the one begun, and when its moments are."""

    def __init__(self, folder: Path, of: FaultScenario) -> None:
        self.folder, self.of = folder, of
        self._undisturbed = folder / "undisturbed"
        self.begun = folder / "begun"
        FaultBench(self.of).run(self._undisturbed)
        self.whole = read_press_rows(self._undisturbed)
        # A run that was stopped in its second press.
        assert ended(FaultBench(self.of), self.begun, self._stop) != "success"
        # The press that was cut off is done again whole: none of its rows is to be kept.
        self.committed = {
            table: [row for row in part if not str(row[0]).startswith(self.of.second)]
            for table, part in read_press_rows(self.begun).items()
        }
        self.at_s = self._moments()

    def cell(self, fault: FaultKind, moment: str, folder: Path) -> FaultOutcome:
        """Strike, end, mend, resume, compare. folder: of the run, which is gone afterwards."""
        shutil.copytree(self.begun, folder)
        try:
            bench, at_s = FaultBench(self.of), self.at_s[moment]
            fault.strike(bench, at_s)
            found = FaultOutcome(fault.name, moment, ended(bench, folder))
            ended_ns = bench.clock.now_ns()
            FaultBench.free_disk()
            bench.clock.sleep_s(60.0)  # all rests, and silence is over
            if found.outcome != "success":
                found = travelled(bench, fault, found, at_s, ended_ns)
            wrong = misjudged(fault, found) or self.resumed(bench, folder, found.outcome)
            return replace(found, wrong=wrong)
        finally:
            FaultBench.free_disk()
            shutil.rmtree(folder)

    def wrong(self, folder: Path, all_rows: bool = True) -> str:
        """What of a finished record is not as in the undisturbed one, "" if nothing is.

        all_rows: not only ids and images have to be the same.
        """
        found = read_press_rows(folder)
        for table in found if all_rows else ():
            if found[table] != self.whole[table]:
                return f"{table} differ from the undisturbed run's"
        frame_ids = [row[0] for row in found["frames"]]
        if frame_ids != [row[0] for row in self.whole["frames"]]:
            return "the frames' ids are not those of the undisturbed run"
        for row in open_run(folder).frames().itertuples():
            image = (folder / str(row.file)).read_bytes()
            if image != (self._undisturbed / str(row.file)).read_bytes():
                return f"{row.file} differs from the undisturbed run's"
        return ""

    def lost(self, folder: Path, before: Rows) -> str:
        """What was committed and is not there any more."""
        now = read_press_rows(folder)
        for table in ("frames", "steps"):
            kept = {row[0]: row for row in now[table]}
            for row in before[table]:
                if kept.get(row[0]) != row:
                    return f"a committed row of {table} is lost or changed: {row[0]}"
        return ""

    def resumed(self, bench: FaultBench, folder: Path, outcome: str) -> str:
        """The fault is gone; the same board, as it was left, serves another session: what is wrong
        with the record then."""
        if lost := self.lost(folder, self.committed):
            return lost
        if outcome != "success":
            bench.clear_faults()
            if (again := ended(bench, folder)) != "success":
                return f"cannot be resumed: {again}"
        # A run that bore the fault may have its times and samples moved by it; not its images.
        return self.lost(folder, self.committed) or self.wrong(folder, outcome != "success")

    def _stop(self, done: int, total: int, what: str) -> None:
        if what.startswith(self.of.second):
            raise KeyboardInterrupt

    def _moments(self) -> dict[str, float]:
        """When they are in the session of a cell, in which nothing goes wrong."""
        folder = self.folder / "timed"
        shutil.copytree(self.begun, folder)
        bench = FaultBench(self.of)
        bench.run(folder)
        run = open_run(folder)
        began_ns = next(t for t, who, data in bench.trace if who == "host" and data == b"$H\n")
        events, steps = run.events(), run.steps().set_index("step_id").to_dict("index")
        shutil.rmtree(folder)

        second = self.of.second
        first = {
            HOMING: began_ns / 1e9 + 0.3,  # Z is on its way up, at full speed
            BEFORE: float(events[events["kind"] == "homed"]["t_s"].max()),
        }
        # Every change of state, and a moment drawn between.
        draw = random.Random(0)
        for name, row in ((str(name), row) for name, row in steps.items()):
            if name.startswith(f"{second}/"):
                leg, planned_s = name.removeprefix(f"{second}/"), row["planned_s"]
                first[f"{leg} begins"] = row["t_start_s"] + min(0.02, planned_s / 2)
                first[leg] = row["t_start_s"] + planned_s * draw.uniform(0.1, 1.0)
        return first


def ended(bench: FaultBench, folder: Path, progress: Any = None) -> str:
    """What a session ends in: "success" or its error."""
    try:
        bench.run(folder, progress)
    except DeltactFabError as why:
        return " ".join(str(why).replace(str(folder), "RUN").split())
    return "success"


def misjudged(fault: FaultKind, found: FaultOutcome) -> str:
    """What of an end is not as the fault lets it be, "" if all is."""
    if found.outcome == "success":
        return "" if fault.success else "success, and an error was due"
    if not any(words in found.outcome for words in fault.says):
        return "another error than the fault's"
    if found.wrong or found.travel_mm is None or found.known_s is None:
        return found.wrong
    if found.allowed_mm is not None and found.travel_mm > found.allowed_mm:
        return f"{found.travel_mm:.2f} mm of travel, {found.allowed_mm:.2f} allowed"
    limit_s = (fault.within_s or 0.0) + (HOMING_S if found.moment == HOMING else 0.0)
    if found.known_s > limit_s:
        return f"known after {found.known_s:.2f} s, {limit_s:g} expected"
    return ""


def travelled(
    bench: FaultBench, fault: FaultKind, found: FaultOutcome, at_s: float, ended_ns: int
) -> FaultOutcome:
    """How far the carriage went after the error, and how far it may have.

    Counted from when the fault had come to the host, or from its stop byte where that had to wait
    for a time-out; to rest, over every line begun before the stop byte. A lift is begun after it.
    """
    at_ns = bench.fault_ns(at_s)
    segments = bench.board.segments
    stop_ns = next(
        (t for t, who, data in bench.trace if who == "host" and data in STOPS and t >= at_ns),
        ended_ns,
    )
    heard = fault.within_s is None or not fault.carries
    known_ns = at_ns if heard else stop_ns
    begun = {s.block for s in segments if s.start_ns < min(stop_ns, ended_ns)}
    pieces = [s for s in segments if s.end_ns > max(known_ns, s.start_ns)]
    moved = [s for s in pieces if s.block in begun]
    later = [s for s in pieces if s.block not in begun]
    low_mm = min((s.end_mm[2] for s in segments if s.end_ns > at_ns), default=0.0)
    deeper_mm = max(bench.board.position_mm(at_ns / 1e9)[2] - low_mm, 0.0)
    found = replace(found, known_s=(known_ns - at_ns) / 1e9, deeper_mm=deeper_mm)
    if moved:
        blocks = {s.block for s in moved}
        speeds = [phase[2] for s in segments if s.block in blocks for phase in s.phases]
        speed, accel = max(speeds, default=0.0), min(s.accel_mm_s2 for s in moved)
        way = [math.dist(s.position_mm(max(known_ns, s.start_ns)), s.end_mm) for s in moved]
        most = speed**2 / (2 * accel) + speed * REACTION_S if fault.carries else None
        if not fault.carries and moved[-1].end_mm[2] <= moved[0].start_mm[2]:  # a dead man
            most = speed * max(GrblStage.planned_ahead_s, speed / accel)
        allowed_mm = None if most is None else most + ROUNDING_MM
        found = replace(found, travel_mm=sum(way), allowed_mm=allowed_mm)
    rises = all(
        s.end_mm[2] > s.start_mm[2] and math.dist(s.start_mm[:2], s.end_mm[:2]) < ROUNDING_MM
        for s in later
    )
    if fault.carries and not rises:
        return replace(found, wrong="it moved again after the stop, and not straight up")
    return found


SHORT = len(FAULTS)  # faults at moments, where not all are asked for


@dataclass(frozen=True)
class Rehearsal:
    """cells: what each fault did. moments: when, in order. of: how many there would be in all."""

    cells: tuple[FaultOutcome, ...]
    moments: tuple[str, ...]
    of: int
    steps: int

    @property
    def wrong(self) -> tuple[FaultOutcome, ...]:
        return tuple(cell for cell in self.cells if cell.wrong)

    def verdict(self) -> str:
        n = len(self.cells)
        far_mm = max(cell.deeper_mm for cell in self.cells)
        what = (
            f"{len(self.wrong)} of {n} faults did NOT end as they must"
            if self.wrong
            else f"all {n} faults ended at rest, and every run went on to the same record"
        )
        return f"{what}; the tip went {far_mm:.2f} mm lower at most, in air or gel (simulated)"

    def as_dict(self) -> dict[str, Any]:
        rows = [{**asdict(cell), "passed": not cell.wrong} for cell in self.cells]
        return {
            "passed": not self.wrong, "verdict": self.verdict(), "simulated": True,
            "of": self.of, "steps": self.steps, "cells": rows,
        }  # fmt: skip


def rehearse(of: FaultScenario, thorough: bool, progress: Progress | None = None) -> Rehearsal:
    """Rehearse every fault, at every moment or at some of them, each moment met by some fault.

    Raises RunFailed where the undisturbed run ends in an error.
    """
    with tempfile.TemporaryDirectory(prefix="deltact-fab-") as name:
        folder = Path(name)
        try:
            made = Matrix(folder, of)
        except AssertionError as why:
            raise RunFailed("the protocol cannot be stopped in its last press") from why
        moments = tuple(made.at_s)
        pairs = [
            (fault.name, moment)
            for fault in FAULTS
            for moment in moments
            if fault.homing or moment != HOMING
        ]
        total = len(pairs)
        if not thorough and len(pairs) > SHORT:
            random.Random(0).shuffle(pairs)
            pairs = _covering(pairs)
        jobs = [(made, k, *pair) for k, pair in enumerate(pairs)]
        names = [f"{fault}: {moment}" for _, _, fault, moment in jobs]
        cells = run_each(_cell, jobs, names, progress=progress)
    order = {fault.name: k for k, fault in enumerate(FAULTS)}
    cells.sort(key=lambda c: (order[c.fault], moments.index(c.moment)))
    return Rehearsal(tuple(cells), moments, total, len(of.steps))


def _covering(pairs: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """SHORT of them in which every fault and every moment stands as often as any other can."""
    kept: list[tuple[str, str]] = []
    while len(kept) < SHORT:
        seen = [word for pair in kept for word in pair]
        kept.append(min((p for p in pairs if p not in kept), key=lambda p: sum(map(seen.count, p))))
    return kept


def _cell(job: tuple[Matrix, int, str, str]) -> FaultOutcome:
    made, number, name, moment = job
    fault = next(fault for fault in FAULTS if fault.name == name)
    return made.cell(fault, moment, made.folder / f"cell-{number}")
