"""A lab's own protocol and rig file through every fault, on the simulated bench in lockstep."""

from __future__ import annotations

import random
import shutil
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ...aliases import Progress
from ...errors import RunFailed
from ...jobs import each
from .cell import Disk, FaultOutcome, Matrix
from .kinds import FAULTS, HOMING
from .scenario import Scenario

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
        """Those that did not end as they must."""
        return tuple(cell for cell in self.cells if cell.wrong)

    def verdict(self) -> str:
        """In one sentence."""
        n = len(self.cells)
        far_mm = max(cell.deeper_mm for cell in self.cells)
        what = (
            f"{len(self.wrong)} of {n} faults did NOT end as they must"
            if self.wrong
            else f"all {n} faults ended at rest, and every run went on to the same record"
        )
        return f"{what}; the tip went {far_mm:.2f} mm lower at most, in air or gel (simulated)"

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        rows = [{**asdict(cell), "passed": not cell.wrong} for cell in self.cells]
        return {
            "passed": not self.wrong, "verdict": self.verdict(), "simulated": True,
            "of": self.of, "steps": self.steps, "cells": rows,
        }  # fmt: skip


def rehearse(of: Scenario, thorough: bool, progress: Progress | None = None) -> Rehearsal:
    """Every fault, at every moment or at some of them, each moment met by some fault.

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
        cells = each(_cell, jobs, names, progress=progress)
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
    folder = made.folder / f"cell-{number}"
    folder.mkdir()
    try:
        fault = next(fault for fault in FAULTS if fault.name == name)
        return made.cell(fault, moment, Disk(folder))
    finally:
        shutil.rmtree(folder)
