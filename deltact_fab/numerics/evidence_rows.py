"""What a row of evidence computes, in the row's own process.

At its top only the standard library: what a row needs is loaded when it is called.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any


def case_row(case: Any) -> dict[str, Any]:
    """A line of a stability table, judged."""
    import tempfile

    from .worker import judge

    with tempfile.TemporaryDirectory() as scratch:
        return judge(case, Path(scratch))


def reference_row(depth_mm: float, friction: float) -> dict[str, Any]:
    """A reference of the curves, and what it says of its own error."""
    from .engines import gel

    truth = gel.reference(depth_mm, friction)
    coarse, fine, step, _ = gel.FINE[friction == 0]
    return {
        "depth_mm": depth_mm, "friction": friction, "meshes_mm": [coarse, fine], "step_mm": step,
        "normal_n": truth.normal_n, "own_force_percent": truth.force_error,
        "own_in_plane_mm": truth.in_plane_error,
    }  # fmt: skip


def curve_row(run: Any) -> dict[str, Any]:
    """A point on a curve: time, memory and error, once after a warm-up."""
    from dataclasses import replace

    from .engines import gel, gel_run
    from .memory import peak_resident_mb, reset_peak_mb

    truth = gel.reference(run.depth_mm, run.friction)
    warm = "layer" if run.level == "layer" else "hyperelastic"
    gel_run.solve(
        replace(run, level=warm, depth_mm=0.5, spacing_mm=1.0 if warm == "layer" else 3.0,
                part="quarter", solver="auto")
    )  # fmt: skip
    before = reset_peak_mb()
    wall, cpu = time.perf_counter(), time.process_time()
    answer = gel_run.solve(run)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    force, in_plane = gel.errors(answer, truth)
    return {
        "case": run.case, "series": run.series, "setting": run.name,
        "wall_s": answer.inner_s or wall, "cpu_s": None if answer.inner_s else cpu,
        "peak_mb": None if answer.inner_s else max(0.0, peak_resident_mb() - before),
        "force_percent": force, "in_plane_mm": in_plane, "note": answer.note,
    }  # fmt: skip
