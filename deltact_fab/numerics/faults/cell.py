"""One fault at one moment: what the run ended in, how far the carriage went, and what is kept.

Every cell goes on with a run whose first press is committed, so that there is something to lose.
"""

from __future__ import annotations

import math
import shutil
import sqlite3
from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ...errors import DeltactFabError
from ...record import CLOCK_COLUMNS, PRESS_TABLES
from ...record import open as open_run
from ...virtual.motion import Segment
from .bench import FaultBench
from .disk import Disk
from .kinds import BEFORE, DRAG, HOMING, PRESS, TRAVEL, WRITING, FaultKind

SECOND = "sphere-6/p2"
REACTION_S = 0.010  # of motion, beyond the braking distance
ROUNDING_MM = 0.003
ELAPSED = 0.37  # of a move when the fault strikes: at full speed, and at no moment of a report
HOMING_S = 60.0  # a homing board answers nothing until it is done, so that long it is waited for
STOPS = (b"\x85", b"\x18", b"!")
Rows = dict[str, list[tuple[Any, ...]]]


@dataclass(frozen=True)
class FaultOutcome:
    """outcome: "success" or the error. travel_mm, allowed_mm: after the error; None where nothing
    moved or nothing failed. known_s: from the fault until the host could know, or knew. wrong: what
    is not as it must be, "" when all is."""

    fault: str
    moment: str
    outcome: str
    travel_mm: float | None = None
    allowed_mm: float | None = None
    known_s: float | None = None
    lifted: bool = False
    wrong: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self)

    @property
    def says(self) -> str:
        """The cell of the table."""
        what = "success" if self.outcome == "success" else "error"
        if self.travel_mm is not None:
            mark = "" if not self.known_s else "*"
            what += f" {self.travel_mm:.2f} mm{mark}"
        if self.allowed_mm is None and self.travel_mm is not None:
            what += "+"
        return f"WRONG: {what}" if self.wrong else what


class Matrix:
    """What all cells share: the undisturbed run, the one begun, and when its moments are."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._undisturbed = folder / "undisturbed"
        self.begun = folder / "begun"
        bench = FaultBench()
        bench.run(self._undisturbed)
        self.whole = rows(self._undisturbed)
        self._begin(FaultBench())
        # The press that was cut off is done again whole: none of its rows is to be kept.
        self.committed = {
            table: [row for row in part if not str(row[0]).startswith(SECOND)]
            for table, part in rows(self.begun).items()
        }
        self.at_s = self._moments()

    def cell(self, fault: FaultKind, moment: str, disk: Disk) -> FaultOutcome:
        """Strike, end, mend, resume, compare. disk: where the run is, and what may fill up."""
        folder = disk.folder / "cell"
        shutil.copytree(self.begun, folder)
        try:
            return self._cell(fault, moment, folder, disk)
        finally:
            disk.free()
            shutil.rmtree(folder)

    def resumed_from_disk(self, folder: Path) -> str:
        """Go on with what a killed process left; what is wrong with that."""
        return self._resumed(FaultBench(), folder, "killed")

    def wrong(self, folder: Path, tables: Sequence[str] = PRESS_TABLES) -> str:
        """What of a finished record is not as in the undisturbed one, "" if nothing is."""
        found = rows(folder)
        for table in tables:
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
        now = rows(folder)
        for table in ("frames", "steps"):
            kept = {row[0]: row for row in now[table]}
            for row in before[table]:
                if kept.get(row[0]) != row:
                    return f"a committed row of {table} is lost or changed: {row[0]}"
        return ""

    def _cell(self, fault: FaultKind, moment: str, folder: Path, disk: Disk) -> FaultOutcome:
        bench, at_s = FaultBench(), self.at_s[moment]
        fault.strike(bench, disk, at_s)
        outcome = "success"
        try:
            bench.run(folder)
        except DeltactFabError as why:
            outcome = " ".join(str(why).split())
        ended_ns = bench.clock.now_ns()
        disk.free()
        bench.clock.sleep_s(60.0)  # all rests, and silence is over
        found = FaultOutcome(fault.name, moment, outcome)
        wrong = ""
        if outcome != "success":
            named = any(words in outcome for words in fault.says)
            wrong = "" if named else "another error than the fault's"
            found = travelled(bench, fault, found, at_s, ended_ns)
            wrong = wrong or found.wrong
            if not wrong and fault.carries and found.travel_mm is not None:
                assert found.allowed_mm is not None
                if found.travel_mm > found.allowed_mm:
                    wrong = f"{found.travel_mm:.2f} mm of travel, {found.allowed_mm:.2f} allowed"
            limit_s = (fault.within_s or 0.0) + (HOMING_S if moment == HOMING else 0.0)
            moved = found.travel_mm is not None
            if not wrong and moved and found.known_s is not None and found.known_s > limit_s:
                wrong = f"known after {found.known_s:.2f} s, {limit_s:g} expected"
        elif not fault.success:
            wrong = "success, and an error was due"
        wrong = wrong or self._resumed(bench, folder, outcome)
        return FaultOutcome(**{**found.as_dict(), "wrong": wrong})

    def _resumed(self, bench: FaultBench, folder: Path, outcome: str) -> str:
        """The fault is gone; the same board, as it was left, serves another session."""
        before = self.committed
        if lost := self.lost(folder, before):
            return lost
        if outcome != "success":
            bench.mend()
            try:
                bench.run(folder)
            except DeltactFabError as why:
                return f"cannot be resumed: {' '.join(str(why).split())}"
        # A run that bore the fault may have its times and samples moved by it; not its images.
        tables = () if outcome == "success" else PRESS_TABLES
        return self.lost(folder, before) or self.wrong(folder, tables)

    def _begin(self, bench: FaultBench) -> None:
        """A run that was stopped in its second press."""

        def stop(done: int, total: int, what: str) -> None:
            if what.startswith(SECOND):
                raise KeyboardInterrupt

        try:
            bench.run(self.begun, stop)
        except DeltactFabError:
            return
        raise AssertionError("it was to be stopped")

    def _moments(self) -> dict[str, float]:
        """When they are in the session of a cell, in which nothing goes wrong."""
        folder = self.folder / "timed"
        shutil.copytree(self.begun, folder)
        bench = FaultBench()
        bench.run(folder)
        run = open_run(folder)
        began_ns = next(t for t, who, data in bench.trace if who == "host" and data == b"$H\n")
        events = run.events()
        homed_s = max(events[events["kind"] == "homed"]["t_s"].tolist())
        steps = {str(row["step_id"]): row for _, row in run.steps().iterrows()}
        frames = {str(row["frame_id"]): row for _, row in run.frames().iterrows()}

        def within(step: str) -> float:
            row = steps[f"{SECOND}/{step}"]
            return float(row["t_start_s"] + row["planned_s"] * ELAPSED)

        shutil.rmtree(folder)
        return {
            HOMING: began_ns / 1e9 + 0.3,  # Z is on its way up, at full speed
            BEFORE: homed_s,
            TRAVEL: within("rest"),
            PRESS: within("d1.50/press"),
            DRAG: within("d1.50/shear-x-"),
            WRITING: float(frames[f"{SECOND}/d1.50/shear-x-#001"]["t_s"]),
        }


def travelled(
    bench: FaultBench, fault: FaultKind, found: FaultOutcome, at_s: float, ended_ns: int
) -> FaultOutcome:
    """How far the carriage went after the error, and how far it may have.

    Counted from when the fault had come to the host, or from its stop byte where that had to wait
    for a time-out; to rest, over every line begun before the stop byte. A lift is begun after it.
    """
    at_ns = bench.struck_ns(at_s)
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
    made = {**found.as_dict(), "known_s": (known_ns - at_ns) / 1e9, "lifted": bool(later)}
    if moved:
        blocks = {s.block for s in moved}
        speed = max(top_mm_s(s) for s in segments if s.block in blocks)
        accel = min(s.accel_mm_s2 for s in moved)
        made["travel_mm"] = sum(length_mm(s, known_ns) for s in moved)
        if fault.carries:
            made["allowed_mm"] = speed**2 / (2 * accel) + speed * REACTION_S + ROUNDING_MM
    if fault.carries and not all(rises(s) for s in later):
        made["wrong"] = "it moved again after the stop, and not straight up"
    return FaultOutcome(**made)


def rises(segment: Segment) -> bool:
    """Whether a piece leads straight up, but for a motor step."""
    (x, y, z), (u, v, w) = segment.start_mm, segment.end_mm
    return w > z and math.hypot(u - x, v - y) < ROUNDING_MM


def length_mm(segment: Segment, from_ns: int) -> float:
    """Way along a piece from a time on."""
    return math.dist(segment.position_mm(max(from_ns, segment.start_ns)), segment.end_mm)


def top_mm_s(segment: Segment) -> float:
    """The highest speed of a piece."""
    return max((speed for _, _, speed, _ in segment.phases), default=0.0)


def rows(folder: Path) -> Rows:
    """All columns but the clocks', the first of each row its id."""
    out: Rows = {}
    path = (folder / "journal.sqlite").absolute()
    with closing(sqlite3.connect(f"{path.as_uri()}?mode=ro", uri=True)) as db:
        for table in PRESS_TABLES:
            names = [c[1] for c in db.execute(f"PRAGMA table_info({table})")]
            keep = sorted(
                (n for n in names if n not in CLOCK_COLUMNS),
                key=lambda n: n not in ("frame_id", "step_id"),
            )
            out[table] = db.execute(
                f"SELECT {','.join(keep)} FROM {table} ORDER BY 1, 2"
            ).fetchall()
    return out
