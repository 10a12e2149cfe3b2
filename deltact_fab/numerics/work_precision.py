"""Error against CPU time: every setting of an engine in a process of its own."""

from __future__ import annotations

import contextlib
import math
import os
import platform
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ..errors import RunFailed
from .engine import CurveSetting
from .engines import alone, load, on_one_core
from .stability import SILENCE_S, plain

REPEATS = 5
MAX_REPEATS = 25
LONG_ENOUGH_S = 0.3  # with five repeats done, no more are added past this


def measure(
    name: str, module: str, settings: Sequence[CurveSetting], scratch: Path, quick: bool
) -> Iterator[dict[str, Any]]:
    """Time settings one after the other. Raises RunFailed naming a setting that failed."""
    for setting in settings:
        with alone() as process:
            try:
                row = process.submit(timed, module, scratch, quick, setting.key).result(SILENCE_S)
            except Exception as why:
                raise RunFailed(f"numerics: {name}: {setting.key}: {why}") from why
        yield {"engine": name, **row}


def timed(module: str, scratch: Path, quick: bool, key: str) -> dict[str, Any]:
    """The row of one setting of a module, in its process; the warm-up call is apart.

    cpu_s, cpu_most_s: best and slowest of `repeats`, for whatever else is at work only ever adds.
    wall_s: best. compile_s: CPU time of the warm-up beyond the best (compiling, plans, caches).
    peak_mb: memory above what libraries and inputs hold. error, reference_error: in `unit`. kind:
    of the reference.
    """
    on_one_core()
    setting = next(s for s in load(module).curves(quick) if s.key == key)
    work = setting.build(scratch)
    before_mb = reset_peak_mb()
    start_s = time.process_time()
    result = work.run()
    first_s = time.process_time() - start_s
    wall_s: list[float] = []
    cpu_s: list[float] = []
    while len(cpu_s) < REPEATS or (sum(cpu_s) < LONG_ENOUGH_S and len(cpu_s) < MAX_REPEATS):
        start_s, start_cpu_s = time.perf_counter(), time.process_time()
        result = work.run()
        wall_s.append(time.perf_counter() - start_s)
        cpu_s.append(time.process_time() - start_cpu_s)
    peak_mb = peak_resident_mb() - before_mb
    return {
        "case": setting.case, "series": setting.series, "setting": setting.name,
        "cpu_s": min(cpu_s), "cpu_most_s": max(cpu_s), "wall_s": min(wall_s),
        "compile_s": max(0.0, first_s - min(cpu_s)), "peak_mb": max(0.0, peak_mb),
        "error": plain(work.error(result)), "unit": setting.unit, "reference": setting.reference,
        "reference_error": setting.reference_error, "repeats": len(cpu_s), "kind": setting.kind,
    }  # fmt: skip


def compared(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The rows beside the first of their case, and with their front marked.

    times_as_fast: CPU time of the baseline, the first setting of the case, over its own. pareto: no
    setting of the case takes less CPU time and is nearer.
    """
    out = []
    for row in rows:
        here = [r for r in rows if (r["engine"], r["case"]) == (row["engine"], row["case"])]
        cost = row["cpu_s"], row["error"]
        beaten = row["error"] is None or any(
            r["error"] is not None
            and r["cpu_s"] <= row["cpu_s"]
            and r["error"] <= row["error"]
            and (r["cpu_s"], r["error"]) != cost
            for r in here
        )
        out.append(row | {
            "baseline": f"{here[0]['series']}, {here[0]['setting']}",
            "times_as_fast": here[0]["cpu_s"] / row["cpu_s"] if row["cpu_s"] else math.inf,
            "pareto": not beaten,
        })  # fmt: skip
    return out


def machine() -> dict[str, Any]:
    """What the times were measured on: processor, cores, system."""
    model = platform.processor() or platform.machine()
    if Path("/proc/cpuinfo").exists():
        for line in Path("/proc/cpuinfo").read_text(errors="replace").splitlines():
            if line.startswith("model name"):
                model = line.partition(":")[2].strip()
                break
    return {"processor": model, "cores": os.cpu_count(), "system": platform.system()}


def reset_peak_mb() -> float:
    """Start the record of the peak anew where the system can, and return the memory held now."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")
        return _status_mb("VmRSS:")
    return peak_resident_mb()


def peak_resident_mb() -> float:
    """Largest resident memory since `reset_peak_mb`; since the start where that cannot be reset."""
    with contextlib.suppress(OSError):
        return _status_mb("VmHWM:")
    import resource

    unit = 1024 * 1024 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


def _status_mb(key: str) -> float:
    words = Path("/proc/self/status").read_text().split()
    return int(words[words.index(key) + 1]) / 1024
