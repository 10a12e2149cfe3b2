"""Rehearsal of a lab's protocol and rig file under every fault, on the simulated bench.

A cell is one fault at one moment: outcome, travel and the record. It continues a run whose first
press is committed, so that there is data to lose.
"""

from __future__ import annotations

import math
import random
import shutil
import tempfile
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from deltact_fab.bench import GrblStage, open_run
from deltact_fab.common import DeltactFabError, Progress, RunFailed, run_each
from deltact_fab.simulate import FaultBench, FaultScenario

from .kinds import BEFORE_MOVE_MOMENT, FAULT_KINDS, HOMING_MOMENT, FaultKind

REACTION_S = 0.010  # decision 0075: travel at the feed, beyond the braking distance
TRAVEL_ROUNDING_MM = 0.003  # decision 0075: motor steps
HOMING_S = 60.0  # by hand: a homing board does not answer; longer hides a dead one
STOP_BYTES = (b"\x85", b"\x18", b"!")
PressRows = dict[str, list[tuple[Any, ...]]]


@dataclass(frozen=True)
class FaultOutcome:
    """outcome: "success" or the error. travel_mm, allowed_mm: after the error; None if nothing
    moved or failed. known_s: detection time. wrong: violated requirement, or "". deeper_mm: tip
    depth beyond that at the fault."""

    fault: str
    moment: str
    outcome: str
    travel_mm: float | None = None
    allowed_mm: float | None = None
    known_s: float | None = None
    wrong: str = ""
    deeper_mm: float = 0.0


class FaultMatrix:
    """Common data of all cells: the undisturbed run, the interrupted run, its moments."""

    def __init__(self, folder: Path, scenario: FaultScenario) -> None:
        self.folder, self.scenario = folder, scenario
        self._undisturbed = folder / "undisturbed"
        self.begun = folder / "begun"
        FaultBench(self.scenario).run(self._undisturbed)
        self.undisturbed_rows = open_run(self._undisturbed).press_rows()
        # A run stopped in its second press.
        assert run_outcome(FaultBench(self.scenario), self.begun, self._stop) != "success"
        # The interrupted press is repeated from its start: none of its rows is kept.
        self.committed = {
            table: [row for row in part if not str(row[0]).startswith(f"{self.scenario.second}/")]
            for table, part in open_run(self.begun).press_rows().items()
        }
        self.at_s = self._moments()

    def run_cell(self, fault: FaultKind, moment: str, folder: Path) -> FaultOutcome:
        """Inject a fault, repair, resume, compare. folder: of the run; removed at the end."""
        shutil.copytree(self.begun, folder)
        try:
            bench, at_s = FaultBench(self.scenario), self.at_s[moment]
            fault.strike(bench, at_s)
            result = FaultOutcome(fault.name, moment, run_outcome(bench, folder))
            ended_ns = bench.clock.now_ns()
            FaultBench.free_disk()
            bench.clock.sleep_s(60.0)  # until everything is at rest
            if result.outcome != "success":
                result = measure_travel(bench, fault, result, at_s, ended_ns)
            wrong = end_error(fault, result) or self.resume_error(bench, folder, result.outcome)
            return replace(result, wrong=wrong)
        finally:
            FaultBench.free_disk()
            shutil.rmtree(folder)

    def difference(self, folder: Path, all_rows: bool = True) -> str:
        """First difference of a finished record from the undisturbed one, or "".

        all_rows: compare all rows, not only ids and images.
        """
        rows = open_run(folder).press_rows()
        for table in rows if all_rows else ():
            if rows[table] != self.undisturbed_rows[table]:
                return f"{table} differ from the undisturbed run's"
        frame_ids = [row[0] for row in rows["frames"]]
        if frame_ids != [row[0] for row in self.undisturbed_rows["frames"]]:
            return "the frames' ids are not those of the undisturbed run"
        for row in open_run(folder).frames().itertuples():
            image = (folder / str(row.file)).read_bytes()
            if image != (self._undisturbed / str(row.file)).read_bytes():
                return f"{row.file} differs from the undisturbed run's"
        return ""

    def lost_row(self, folder: Path, committed: PressRows) -> str:
        """First committed row that is missing or changed, or ""."""
        current = open_run(folder).press_rows()
        for table in ("frames", "steps"):
            by_id = {row[0]: row for row in current[table]}
            for row in committed[table]:
                if by_id.get(row[0]) != row:
                    return f"a committed row of {table} is lost or changed: {row[0]}"
        return ""

    def resume_error(self, bench: FaultBench, folder: Path, outcome: str) -> str:
        """Resume on the same board without the fault; return the record's first error, or ""."""
        if row_error := self.lost_row(folder, self.committed):
            return row_error
        if outcome != "success":
            bench.clear_faults()
            if (ending := run_outcome(bench, folder)) != "success":
                return f"cannot be resumed: {ending}"
        # A fault that a run survives may change times and samples, not images.
        return self.lost_row(folder, self.committed) or self.difference(
            folder, outcome != "success"
        )

    def _stop(self, count: int, total: int, label: str) -> None:
        if label.startswith(f"{self.scenario.second}/"):
            raise KeyboardInterrupt

    def _moments(self) -> dict[str, float]:
        """Times of the moments, s, in an undisturbed session of a cell."""
        folder = self.folder / "timed"
        shutil.copytree(self.begun, folder)
        bench = FaultBench(self.scenario)
        bench.run(folder)
        run = open_run(folder)
        began_ns = next(t for t, who, data in bench.trace if who == "host" and data == b"$H\n")
        events, steps = run.events(), run.steps().set_index("step_id").to_dict("index")
        shutil.rmtree(folder)

        second = self.scenario.second
        first = {
            HOMING_MOMENT: began_ns / 1e9 + 0.3,  # Z is on its way up, at full speed
            BEFORE_MOVE_MOMENT: float(events[events["kind"] == "homed"]["t_s"].max()),
        }
        # Every change of state, and a random moment between.
        draw = random.Random(0)
        for name, row in ((str(name), row) for name, row in steps.items()):
            if name.startswith(f"{second}/"):
                leg, planned_s = name.removeprefix(f"{second}/"), row["planned_s"]
                first[f"{leg} begins"] = row["t_start_s"] + min(0.02, planned_s / 2)
                first[leg] = row["t_start_s"] + planned_s * draw.uniform(0.1, 1.0)
        return first


def run_outcome(bench: FaultBench, folder: Path, progress: Any = None) -> str:
    """Run a session; return "success" or its error."""
    try:
        bench.run(folder, progress)
    except DeltactFabError as error:
        return " ".join(str(error).replace(str(folder), "RUN").split())
    return "success"


def end_error(fault: FaultKind, result: FaultOutcome) -> str:
    """First violation of the fault's allowed outcome, or ""."""
    if result.outcome == "success":
        return "" if fault.success else "success, expected an error"
    if not any(words in result.outcome for words in fault.says):
        return "an error other than the fault's"
    if result.wrong or result.travel_mm is None or result.known_s is None:
        return result.wrong
    if result.allowed_mm is not None and result.travel_mm > result.allowed_mm:
        return f"{result.travel_mm:.2f} mm of travel, {result.allowed_mm:.2f} allowed"
    limit_s = (fault.within_s or 0.0) + (HOMING_S if result.moment == HOMING_MOMENT else 0.0)
    if result.known_s > limit_s:
        return f"detected after {result.known_s:.2f} s, {limit_s:g} expected"
    return ""


def measure_travel(
    bench: FaultBench, fault: FaultKind, result: FaultOutcome, at_s: float, ended_ns: int
) -> FaultOutcome:
    """Travel of the carriage after the error, and its limit.

    From the fault's arrival at the host, or from the stop byte if the host had to time out; to
    rest, over every line begun before the stop byte. A lift begins after it.
    """
    at_ns = bench.fault_ns(at_s)
    segments = bench.board.segments
    stop_ns = next(
        (t for t, who, data in bench.trace if who == "host" and data in STOP_BYTES and t >= at_ns),
        ended_ns,
    )
    known_at_once = fault.within_s is None or not fault.carries
    known_ns = at_ns if known_at_once else stop_ns
    begun = {s.block for s in segments if s.start_ns < min(stop_ns, ended_ns)}
    pieces = [s for s in segments if s.end_ns > max(known_ns, s.start_ns)]
    moves = [s for s in pieces if s.block in begun]
    later = [s for s in pieces if s.block not in begun]
    low_mm = min((s.end_mm[2] for s in segments if s.end_ns > at_ns), default=0.0)
    deeper_mm = max(bench.board.position_mm(at_ns / 1e9)[2] - low_mm, 0.0)
    result = replace(result, known_s=(known_ns - at_ns) / 1e9, deeper_mm=deeper_mm)
    if moves:
        blocks = {s.block for s in moves}
        speeds = [phase[2] for s in segments if s.block in blocks for phase in s.phases]
        speed, accel = max(speeds, default=0.0), min(s.accel_mm_s2 for s in moves)
        legs_mm = [math.dist(s.position_mm(max(known_ns, s.start_ns)), s.end_mm) for s in moves]
        limit_mm = speed**2 / (2 * accel) + speed * REACTION_S if fault.carries else None
        if not fault.carries and moves[-1].end_mm[2] <= moves[0].start_mm[2]:  # link-loss stop
            limit_mm = speed * max(GrblStage.planned_ahead_s, speed / accel)
        allowed_mm = None if limit_mm is None else limit_mm + TRAVEL_ROUNDING_MM
        result = replace(result, travel_mm=sum(legs_mm), allowed_mm=allowed_mm)
    rises = all(
        s.end_mm[2] > s.start_mm[2] and math.dist(s.start_mm[:2], s.end_mm[:2]) < TRAVEL_ROUNDING_MM
        for s in later
    )
    if fault.carries and not rises:
        return replace(result, wrong="moved again after the stop, not straight up")
    return result


SHORT_CELLS = len(FAULT_KINDS)  # cells of a rehearsal that is not thorough


@dataclass(frozen=True)
class Rehearsal:
    """cells: outcomes. moments: names, in order. total: number of cells of a thorough rehearsal."""

    cells: tuple[FaultOutcome, ...]
    moments: tuple[str, ...]
    total: int
    steps: int

    @property
    def wrong(self) -> tuple[FaultOutcome, ...]:
        return tuple(cell for cell in self.cells if cell.wrong)

    def verdict(self) -> str:
        n = len(self.cells)
        far_mm = max(cell.deeper_mm for cell in self.cells)
        summary = (
            f"{len(self.wrong)}/{n} faults FAILED"
            if self.wrong
            else f"{n}/{n} faults ended at rest, and every run resumed to the same record"
        )
        return f"{summary}; tip at most {far_mm:.2f} mm lower, in air or gel (simulated)"

    def as_dict(self) -> dict[str, Any]:
        rows = [{**asdict(cell), "passed": not cell.wrong} for cell in self.cells]
        return {
            "passed": not self.wrong, "verdict": self.verdict(), "simulated": True,
            "of": self.total, "steps": self.steps, "cells": rows,
        }  # fmt: skip


def rehearse(
    scenario: FaultScenario, thorough: bool, progress: Progress | None = None
) -> Rehearsal:
    """Rehearse every fault at every moment, or a subset that covers all faults and moments.

    Raises RunFailed if the undisturbed run ends in an error.
    """
    with tempfile.TemporaryDirectory(prefix="deltact-fab-") as name:
        folder = Path(name)
        try:
            matrix = FaultMatrix(folder, scenario)
        except AssertionError as error:
            raise RunFailed("the protocol cannot be stopped in its last press") from error
        moments = tuple(matrix.at_s)
        pairs = [
            (fault.name, moment)
            for fault in FAULT_KINDS
            for moment in moments
            if fault.homing or moment != HOMING_MOMENT
        ]
        total = len(pairs)
        if not thorough and len(pairs) > SHORT_CELLS:
            random.Random(0).shuffle(pairs)
            pairs = _covering(pairs)
        jobs = [(matrix, k, *pair) for k, pair in enumerate(pairs)]
        names = [f"{fault}: {moment}" for _, _, fault, moment in jobs]
        cells = run_each(_run_job, jobs, names, progress=progress)
    order = {fault.name: k for k, fault in enumerate(FAULT_KINDS)}
    cells.sort(key=lambda c: (order[c.fault], moments.index(c.moment)))
    return Rehearsal(tuple(cells), moments, total, len(scenario.steps))


def _covering(pairs: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """SHORT_CELLS pairs with faults and moments as evenly represented as possible."""
    chosen: list[tuple[str, str]] = []
    while len(chosen) < SHORT_CELLS:
        words = [word for pair in chosen for word in pair]
        rest = [p for p in pairs if p not in chosen]
        chosen.append(min(rest, key=lambda p: sum(map(words.count, p))))
    return chosen


def _run_job(job: tuple[FaultMatrix, int, str, str]) -> FaultOutcome:
    matrix, number, name, moment = job
    fault = next(fault for fault in FAULT_KINDS if fault.name == name)
    return matrix.run_cell(fault, moment, matrix.folder / f"cell-{number}")
