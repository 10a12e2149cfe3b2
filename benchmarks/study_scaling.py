"""How the pattern selection grows: processes, patterns, frames, and its memory.

`python -m benchmarks.study_scaling` prints one run's figures, with the load of the machine at its
begin and end; on a machine at other work the ratios of wall times say little, those of CPU seconds
(patterns, frames) still hold. One press of a ball on the layer gel, 1 mm deep, as cheap a gel as
there is; drawing and tracking are the study's own.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from deltact_fab.cad.design import load_design
from deltact_fab.jobs import each
from deltact_fab.numerics.work_precision import peak_resident_mb, reset_peak_mb
from deltact_fab.patterns.series.job import recipes
from deltact_fab.protocols import plan
from deltact_fab.protocols.plan import Protocol
from deltact_fab.rig import config as rig_config
from deltact_fab.rig.config import VirtualConfig
from deltact_fab.study.pattern_press import follow, solve_gel
from deltact_fab.study.pattern_scene import METHODS
from deltact_fab.study.press_jobs import given

PATTERNS, FRAMES = (1, 2, 4, 8), (10, 20, 40, 80)
JOBS, JOB_PATTERNS, JOB_FRAMES = 4, 4, 24
ENOUGH = 1.7  # two processes against one, on two idle cores


def protocol_of(frames: int) -> Protocol:
    """A press of a ball with about so many frames, 1 mm deep and dragged by 1 mm each way in x."""
    whole = plan.load("smoke")[0].model_dump()
    shear = {"amplitude_mm": 1.0, "axes": ("x",)}
    length_mm = 1.5 + 4.0
    capture = {"rate_hz": (frames - 2) * whole["motion"]["press_feed_mm_min"] / 60 / length_mm}
    return Protocol.model_validate(
        whole | {"indenters": ("sphere:10",), "depths_mm": (1.0,), "channels": ("image", "dots",
        "shear"), "shear": shear, "capture": capture}
    )  # fmt: skip


def told(frames: int, patterns: int) -> dict[str, Any]:
    """What a job is given."""
    config, source = rig_config.load("virtual-coarse")
    assert isinstance(config, VirtualConfig)
    protocol = protocol_of(frames)
    chosen = {entry.name: entry.recipe.model_dump(mode="json") for entry in recipes()[:patterns]}
    sensor = load_design(protocol.specimen.design)
    return given(
        protocol, sensor, config, source, press="sphere-10/p1", patterns=chosen,
        methods=list(METHODS), seed=0,
    )  # fmt: skip


def measured(job: dict[str, Any]) -> dict[str, float]:
    """One job in a process of its own: frames, CPU seconds, and the memory that it grew to."""
    follow(told(FRAMES[0], 1))  # imports and kernels are no part of it
    before_mb, start_s = reset_peak_mb(), time.process_time()
    frames = follow(job)["frames"]
    spent_s = time.process_time() - start_s
    return {"frames": frames, "cpu_s": spent_s, "peak_mb": peak_resident_mb(), "held_mb": before_mb}


def alone(job: dict[str, Any]) -> dict[str, float]:
    """In a fresh process, so that memory is its own."""
    (found,) = each(measured, [job], [""], workers=1)
    return found


def cpu_s_of(rows: dict[int, dict[str, float]]) -> list[float]:
    """Of each row."""
    return [row["cpu_s"] for row in rows.values()]


def line(x: Sequence[float], y: Sequence[float]) -> dict[str, float]:
    """Least squares y = a + b x, and the largest departure from it as a share of y."""
    import numpy as np

    b, a = np.polyfit(x, y, 1)
    off = np.abs(np.array(y) - (a + b * np.array(x))) / np.array(y)
    return {"first": float(a), "each": float(b), "off_line_share": float(off.max())}


def two_against_one() -> dict[str, Any]:
    """Wall seconds of equal jobs, processes and their imports in it."""
    jobs, names = [told(JOB_FRAMES, JOB_PATTERNS)] * JOBS, [str(k) for k in range(JOBS)]
    wall_s = {}
    for workers in (1, 2):
        start_s = time.perf_counter()
        each(follow, jobs, names, workers=workers)
        wall_s[workers] = time.perf_counter() - start_s
    return {"jobs": JOBS, "one_s": wall_s[1], "two_s": wall_s[2], "ratio": wall_s[1] / wall_s[2]}


def main() -> int:
    """Print the figures as JSON; 1 where two processes are not worth ENOUGH."""
    load = os.getloadavg()[0]
    print("some ten minutes on two idle cores", file=sys.stderr)
    solve_gel(told(FRAMES[0], 0))
    for frames in FRAMES[1:]:  # the same gel: a rate is no part of its path
        solve_gel(told(frames, 0))
    by_patterns = {n: alone(told(JOB_FRAMES, n)) for n in PATTERNS}
    by_frames = {n: alone(told(n, 1)) for n in FRAMES}
    counts = [row["frames"] for row in by_frames.values()]
    found: dict[str, Any] = {
        "two_processes": two_against_one(),
        "cpu_s_by_patterns": line(
            [*map(float, by_patterns)], [r["cpu_s"] for r in by_patterns.values()]
        ),
        "cpu_s_by_frames": line(counts, [r["cpu_s"] for r in by_frames.values()]),
        "peak_mb_by_frames": {int(r["frames"]): round(r["peak_mb"]) for r in by_frames.values()},
        "peak_mb_by_patterns": {n: round(r["peak_mb"]) for n, r in by_patterns.items()},
        "frames_a_job_of_patterns": JOB_FRAMES,
        "load_before": load,
        "load_after": os.getloadavg()[0],
        "cores": os.cpu_count(),
        "command": f"python -m {Path(__file__).parent.name}.{Path(__file__).stem}",
    }
    json.dump(found, sys.stdout, indent=1)
    print()
    return 0 if found["two_processes"]["ratio"] >= ENOUGH else 1


if __name__ == "__main__":
    from benchmarks import study_scaling  # by its own name, so that a process finds its functions

    sys.exit(study_scaling.main())
