"""Error against CPU time: every setting of an engine in a process of its own."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from ..errors import RunFailed
from .engine import CurveSetting, Engine
from .process import WorkerDied, answers


@dataclass(frozen=True)
class CurveRow:
    """One point. cpu_s, cpu_most_s: best and slowest of `repeats` after one warm-up call.

    All threads' together. wall_s: best. compile_s: CPU time of the warm-up beyond the best
    (compiling, plans, caches). peak_mb: memory above what libraries and inputs hold. error,
    reference_error: in `unit`. kind: of the reference. times_as_fast: CPU time of the baseline, the
    first setting of the case, over its own. pareto: no setting of the case takes less CPU time and
    is nearer.
    """

    engine: str
    case: str
    series: str
    setting: str
    threads: int
    cpu_s: float
    cpu_most_s: float
    wall_s: float
    compile_s: float
    peak_mb: float
    error: float | None
    unit: str
    reference: str
    reference_error: float
    repeats: int
    kind: str = "independent"
    baseline: str = ""
    times_as_fast: float = 1.0
    pareto: bool = False

    def as_dict(self) -> dict[str, Any]:
        """Plain data, in the order of the CSV."""
        return asdict(self)


def measure(
    engine: Engine, module: str, settings: list[CurveSetting], scratch: Path, quick: bool
) -> Iterator[CurveRow]:
    """Time settings one after the other. Raises RunFailed naming a setting that failed."""
    for setting in settings:
        job = {
            "kind": "curve",
            "module": module,
            "key": setting.key,
            "threads": setting.threads,
            "scratch": str(scratch),
            "quick": quick,
        }
        try:
            (found,) = answers(job)
        except WorkerDied as why:
            raise RunFailed(f"numerics: {engine.name}: {setting.key}: {why}") from why
        yield CurveRow(
            engine=engine.name,
            case=setting.case,
            series=setting.series,
            setting=setting.name,
            threads=setting.threads,
            unit=setting.unit,
            reference=setting.reference,
            reference_error=setting.reference_error,
            kind=setting.kind,
            **found,
        )


def compared(rows: list[CurveRow]) -> list[CurveRow]:
    """The rows beside the first of their case, and with their front marked, case by case."""
    first: dict[tuple[str, str], CurveRow] = {}
    for row in rows:
        first.setdefault((row.engine, row.case), row)
    return [
        replace(
            row,
            baseline=f"{base.series}, {base.setting}",
            times_as_fast=base.cpu_s / row.cpu_s if row.cpu_s else math.inf,
            pareto=not _dominated(row, rows),
        )
        for row in rows
        for base in [first[row.engine, row.case]]
    ]


def _dominated(row: CurveRow, rows: list[CurveRow]) -> bool:
    if row.error is None:
        return True
    for other in rows:
        if (other.engine, other.case) != (row.engine, row.case) or other.error is None:
            continue
        no_worse = other.cpu_s <= row.cpu_s and other.error <= row.error
        if no_worse and (other.cpu_s, other.error) != (row.cpu_s, row.error):
            return True
    return False
