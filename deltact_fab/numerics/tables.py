"""The rows of both tables, made in processes of their own.

Error against CPU time, every setting in one of its own; and stiff and extreme cases: each is right
within its bound, or refused; anything else is wrong.
"""

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

from ..errors import DeltactFabError, RunFailed
from .engine import Case, CurveSetting
from .engines import alone, load, on_one_core

# A reference takes a minute on a quiet core and several on a busy one; this ends what hangs.
SILENCE_S = 600.0


def case_rows(
    name: str,
    module: str,
    cases: Sequence[Case],
    scratch: Path,
    quick: bool,
    silence_s: float = SILENCE_S,
) -> Iterator[dict[str, Any]]:
    """Judge the cases in one process; one that takes it down is wrong, another does the rest."""
    left = list(range(len(cases)))
    while left:
        with alone() as process:
            while left:
                k = left.pop(0)
                job = process.submit(judged, module, scratch, quick, k)
                try:
                    yield {"engine": name, **job.result(silence_s)}
                except (RunFailed, TimeoutError) as why:
                    said = f"the process died: {str(why) or f'no answer for {silence_s:g} s'}"
                    yield {"engine": name, **_row(cases[k], "wrong", None, said)}
                    break


def judged(module: str, scratch: Path, quick: bool, k: int) -> dict[str, Any]:
    """The row of a module's case, in its process."""
    on_one_core()
    return judge(load(module).cases(quick)[k], scratch)


def judge(case: Case, scratch: Path) -> dict[str, Any]:
    """One row of the table: what was expected, the figure, the outcome, and what was said.

    Outcome: right, refused or wrong. Seconds: wall clock.
    """
    start_s = time.perf_counter()
    figure: float | None = None
    note = ""
    try:
        found = case.check(scratch)
        figure, note = found if isinstance(found, tuple) else (found, "")
        figure = float(figure)
    except DeltactFabError as why:
        note = " ".join(str(why).split())
        came = "refused"
    except Exception as why:  # a crash is a verdict of its own
        note = f"{type(why).__name__}: {' '.join(str(why).split())}"[:300]
        came = "crashed"
    else:
        within = case.bound is not None and math.isfinite(figure) and abs(figure) <= case.bound
        came = "right" if within else "off"
    if came == "refused" and case.says not in note:
        came, note = "off", f"refused for another reason: {note}"
    outcome = came if came in case.expectation.split(" or ") else "wrong"
    return _row(case, outcome, plain(figure), note, time.perf_counter() - start_s)


def _row(
    case: Case, outcome: str, figure: float | None, note: str, seconds: float = 0.0
) -> dict[str, Any]:
    return {
        "case": case.name, "expectation": case.expectation, "bound": case.bound, "figure": figure,
        "unit": case.unit, "outcome": outcome, "note": note, "seconds": seconds,
    }  # fmt: skip


def plain(figure: float | None) -> float | None:
    """JSON knows no NaN: a figure that is none is null."""
    return None if figure is None or not math.isfinite(figure) else float(figure)


REPEATS = 5
MAX_REPEATS = 25
LONG_ENOUGH_S = 0.3  # with five repeats done, no more are added past this


def curve_rows(
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
