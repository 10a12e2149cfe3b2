"""What a row of evidence computes, in the row's own process."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from deltact_fab.studies.numerics.engine import Case, judge, peak_resident_mb, reset_peak_mb
from deltact_fab.studies.numerics.engines import gel_press
from deltact_fab.studies.numerics.engines.gel_press import (
    GelAnswer,
    PressSetup,
    errors,
    solve_finite,
)

from .gel_press import FINE, STEPS_MM, reference


def case_row(case: Case) -> dict[str, Any]:
    """A line of a stability table, judged."""
    with tempfile.TemporaryDirectory() as scratch:
        return judge(case, Path(scratch))


def reference_row(depth_mm: float, friction: float) -> dict[str, Any]:
    """A reference of the curves, and what it says of its own error."""
    truth = reference(depth_mm, friction)
    cells_mm, step = (FINE, STEPS_MM[0]) if friction else (gel_press.REFERENCE_CELLS_MM, 1.0)
    return {
        "depth_mm": depth_mm, "friction": friction, "meshes_mm": list(cells_mm), "step_mm": step,
        "normal_n": truth.normal_n, "own_force_percent": truth.force_error,
        "own_in_plane_mm": truth.in_plane_error,
    }  # fmt: skip


def curve_row(solve: Callable[[Any], GelAnswer], run: PressSetup) -> dict[str, Any]:
    """A point on a curve: time, memory and error, once after a warm-up."""
    truth = reference(run.depth_mm, run.friction)
    solve_finite(PressSetup("hyperelastic", 0.5, run.friction, 3.0))
    if run.level == "linear":
        solve(replace(run, depth_mm=0.5, spacing_mm=1.0))
    before = reset_peak_mb()
    wall, cpu = time.perf_counter(), time.process_time()
    answer = solve(run)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    force, in_plane = errors(answer, truth)
    return {
        "case": run.case, "series": run.series, "setting": run.name,
        "wall_s": answer.inner_s or wall, "cpu_s": None if answer.inner_s else cpu,
        "peak_mb": None if answer.inner_s else max(0.0, peak_resident_mb() - before),
        "force_percent": force, "in_plane_mm": in_plane, "note": answer.note,
    }  # fmt: skip
