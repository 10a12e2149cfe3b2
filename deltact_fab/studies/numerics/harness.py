"""Benchmark of the chosen engines, as one result with its files.

Error against CPU time, every setting in a process of its own; stiff and extreme cases, each right
within its bound or refused; anything else is wrong.
"""

from __future__ import annotations

import functools
import importlib
import math
import os
import platform
import secrets
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from deltact_fab.common import InputError, Progress, RunFailed, did_you_mean, open_executor
from deltact_fab.version import library_versions

from . import extremes
from .engine import (
    Case,
    CurveSetting,
    Engine,
    finite_or_none,
    judge,
    peak_resident_mb,
    reset_peak_mb,
    stability_row,
)

# Modules, imported only when asked for: an engine needs libraries that another does not.
ENGINE_MODULES = {n: f"{__package__}.engines.{n}" for n in (
    "gel", "camera", "flow", "contact", "measure", "pattern", "search",
)}  # fmt: skip


def check_names(names: tuple[str, ...]) -> tuple[str, ...]:
    """Engine names without duplicates, all by default. Raises InputError for an unknown one."""
    for name in names:
        if name not in ENGINE_MODULES:
            raise InputError(f"engine {name!r}: unknown; {did_you_mean(name, ENGINE_MODULES)}")
    return tuple(dict.fromkeys(names)) or tuple(ENGINE_MODULES)


def load_engine(module: str) -> Engine:
    """Load the engine of a module. Raises TypeError for a module without one."""
    engine = importlib.import_module(module).ENGINE
    if not isinstance(engine, Engine):
        raise TypeError(f"{module}.ENGINE is no Engine")
    return engine


def pin_to_one_core() -> None:
    """Pin the process to one core if the system can; standard output to standard error."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, [max(os.sched_getaffinity(0))])
    os.dup2(2, 1)


ResultRows = list[dict[str, Any]]


@dataclass(frozen=True)
class Numerics:
    """Benchmark results as plain rows.

    engines: name, title, about. curves: rows of `compare_to_baseline`. stability: of `judge`.
    extremes: of `extremes.stored_rows`, those computed anew marked.
    """

    meta: dict[str, Any]
    engines: ResultRows
    curves: ResultRows
    stability: ResultRows
    extremes: ResultRows

    @property
    def wrong(self) -> ResultRows:
        """Rows of cases that fail the command."""
        return [row for row in self.stability + self.extremes if row["outcome"] == "wrong"]

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, as printed by `numerics --json`."""
        return {**asdict(self), "wrong": len(self.wrong)}

    def save(self, out: Path) -> list[Path]:
        """Write numerics.json, the tables as CSV and numerics.html; returns the files.

        Raises InputError when the folder cannot be made, RunFailed when the disk refuses and
        MissingLibrary, after all but the page, without the extra `report`.
        """
        import pandas as pd

        from deltact_fab.estimate import write_results
        from deltact_fab.present import write_numerics_page

        data = self.as_dict()
        tables = {f"{name}.csv": pd.DataFrame(data[name], dtype=object)
                  for name in ("curves", "stability", "extremes") if data[name]}  # fmt: skip
        files = write_results(out, {"numerics.json": data, **tables})
        page = out / "numerics.html"
        write_numerics_page(data, page)
        return [*files, page]


def run_engines(
    names: Sequence[str] = (),
    quick: bool = False,
    progress: Progress | None = None,
    seed: int | None = None,
) -> Numerics:
    """Run the curves and the hard cases of the named engines, all by default.

    quick: a few settings and cases per engine. seed: of the cells of the map that are computed
    anew; None: random. Raises InputError for an unknown engine, RunFailed when a setting cannot be
    timed.
    """

    started = time.monotonic()
    tell = progress or (lambda count, total, label: None)
    engines = {name: load_engine(ENGINE_MODULES[name]) for name in check_names(tuple(names))}
    seed = secrets.randbelow(2**31) if seed is None else seed
    cells = extremes.draw({name: e.extremes() for name, e in engines.items()}, quick, seed)
    plans = {
        name: (choose_settings(e, quick), [*e.cases(quick), *cells[name]])
        for name, e in engines.items()
    }
    total = sum(len(settings) + len(cases) for settings, cases in plans.values())
    curves: ResultRows = []
    stability: ResultRows = []
    with tempfile.TemporaryDirectory(prefix="deltact-fab-") as folder:
        scratch = Path(folder)
        for name in engines:
            settings, cases = plans[name]
            place = name, ENGINE_MODULES[name]
            for row in curve_rows(*place, settings, scratch, quick):
                curves.append(row)
                tell(len(curves) + len(stability), total, f"{name}: {row['setting']}")
            for row in case_rows(*place, cases, scratch, quick):
                stability.append(row)
                tell(len(curves) + len(stability), total, f"{name}: {row['case']}")
    stored, about = extremes.stored_rows(tuple(engines))
    return Numerics(
        meta={
            "quick": quick,
            "seed": seed,
            "map": about,
            "seconds": time.monotonic() - started,
            "machine": describe_machine(),
            "versions": library_versions(),
        },
        engines=[{"name": n, "title": e.title, "about": e.about} for n, e in engines.items()],
        curves=compare_to_baseline(curves),
        stability=[row for row in stability if "chart" not in row],
        extremes=extremes.update(stored, [row for row in stability if "chart" in row]),
    )


def choose_settings(engine: Engine, quick: bool) -> list[CurveSetting]:
    """Settings to time; if quick the baseline and the default of the first case."""
    settings = list(engine.curves())
    if not quick:
        return settings
    first = [s for s in settings if s.case == settings[0].case]
    default = [s for s in first[1:] if s.recommended] or first[1:]
    return [] if engine.slow else [first[0], *default[:1]]


SILENCE_S = 600.0  # by hand: a reference takes minutes on a busy core; longer waits on a hung one


def case_rows(
    name: str,
    module: str,
    cases: Sequence[Case],
    scratch: Path,
    quick: bool,
    silence_s: float = SILENCE_S,
) -> Iterator[dict[str, Any]]:
    """Judge the cases in one process; after a crash (wrong) the rest in another."""
    pending = list(cases)
    while pending:
        with open_executor(workers=1, threads=1) as process:
            while pending:
                case = pending.pop(0)
                job = process.submit(judge_case, module, scratch, quick, case.name)
                try:
                    yield {"engine": name, **job.result(silence_s)}
                except (RunFailed, TimeoutError) as error:
                    note = f"the process died: {str(error) or f'no answer for {silence_s:g} s'}"
                    yield {"engine": name, **stability_row(case, "wrong", None, note)}
                    break


def judge_case(module: str, scratch: Path, quick: bool, name: str) -> dict[str, Any]:
    """Row of a module's case; runs in its process."""
    pin_to_one_core()
    engine = load_engine(module)
    cases = (*engine.cases(quick), *engine.extremes())
    return judge(next(case for case in cases if case.name == name), scratch)


MIN_REPEATS = 5  # decision 0060
LONG_REPEATS = {1.0: 2, 5.0: 1}  # by hand: repeats over so much CPU time, whose noise is small
FIRST_COUNTS_S = 10.0  # by hand: CPU time of a setting whose warm-up is its only call
MAX_REPEATS = 25  # by hand: more tightens the best of short runs, slower
LONG_ENOUGH_S = 0.3  # by hand: total CPU time after which five repeats suffice


def curve_rows(
    name: str, module: str, settings: Sequence[CurveSetting], scratch: Path, quick: bool
) -> Iterator[dict[str, Any]]:
    """Time settings one by one, in a process each; if quick in one for all.

    Raises RunFailed naming a setting that failed.
    """
    for group in [settings] if quick else [[setting] for setting in settings]:
        with open_executor(workers=1, threads=1) as process:
            for setting in group:
                try:
                    job = process.submit(time_setting, module, scratch, setting.key)
                    row = job.result(SILENCE_S)
                except Exception as error:
                    raise RunFailed(f"numerics: {name}: {setting.key}: {error}") from error
                yield {"engine": name, **row}


def clear_caches(folder: Path) -> None:
    """Empty this process's caches: the store, which gets a new folder, and those of `functools`.

    Machine code stays compiled.
    """
    os.environ["DELTACT_FAB_CACHE"] = tempfile.mkdtemp(dir=folder)
    for module in [m for m in sys.modules.values() if isinstance(m, ModuleType)]:
        for value in list(vars(module).values()):
            for member in (value, *(vars(value).values() if isinstance(value, type) else ())):
                cached = getattr(member, "__func__", member)
                if isinstance(cached, functools._lru_cache_wrapper):
                    cached.cache_clear()


def time_setting(module: str, scratch: Path, key: str) -> dict[str, Any]:
    """Row of one setting of a module, timed after a warm-up call; runs in its process.

    No call finds an earlier one's results: caches are emptied before each. cpu_s, cpu_most_s: best
    and slowest of `repeats`; other load only adds time. wall_s: best. compile_s: CPU time of the
    warm-up beyond the best (compiling, plans). peak_mb: memory beyond libraries and inputs.
    error, reference_error: in `unit`. kind: of the reference.
    """
    pin_to_one_core()
    setting = next(s for s in load_engine(module).curves() if s.key == key)
    work = setting.build(scratch)
    before_mb = reset_peak_mb()
    clear_caches(scratch)
    start_s, start_cpu_s = time.perf_counter(), time.process_time()
    result = work.run()
    first_s = time.process_time() - start_cpu_s
    only = first_s >= FIRST_COUNTS_S
    wall_s = [time.perf_counter() - start_s] if only else []
    cpu_s = [first_s] if only else []
    min_repeats = min(n for s, n in {0.0: MIN_REPEATS, **LONG_REPEATS}.items() if first_s >= s)
    while len(cpu_s) < min_repeats or (sum(cpu_s) < LONG_ENOUGH_S and len(cpu_s) < MAX_REPEATS):
        clear_caches(scratch)
        start_s, start_cpu_s = time.perf_counter(), time.process_time()
        result = work.run()
        wall_s.append(time.perf_counter() - start_s)
        cpu_s.append(time.process_time() - start_cpu_s)
    peak_mb = peak_resident_mb() - before_mb
    return {
        "case": setting.case, "series": setting.series, "setting": setting.name,
        "cpu_s": min(cpu_s), "cpu_most_s": max(cpu_s), "wall_s": min(wall_s),
        "compile_s": max(0.0, first_s - min(cpu_s)), "peak_mb": max(0.0, peak_mb),
        "error": finite_or_none(work.error(result)), "unit": setting.unit,
        "reference": setting.reference, "reference_error": setting.reference_error,
        "repeats": len(cpu_s), "kind": setting.kind, "recommended": setting.recommended,
    }  # fmt: skip


def compare_to_baseline(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows compared with their case's baseline, its first setting.

    times_as_fast: CPU time of the baseline over the row's. pareto: no setting of the case is both
    faster and more accurate, and its error is known from outside.
    """
    out = []
    for row in rows:
        same_case = [r for r in rows if (r["engine"], r["case"]) == (row["engine"], row["case"])]
        cost = row["cpu_s"], row["error"]
        comparable = [r for r in same_case if r["error"] is not None and r["kind"] != "finer self"]
        beaten = row not in comparable or any(
            r["cpu_s"] <= row["cpu_s"]
            and r["error"] <= row["error"]
            and (r["cpu_s"], r["error"]) != cost
            for r in comparable
        )
        out.append(row | {
            "baseline": f"{same_case[0]['series']}, {same_case[0]['setting']}",
            "times_as_fast": same_case[0]["cpu_s"] / row["cpu_s"] if row["cpu_s"] else math.inf,
            "pareto": not beaten,
        })  # fmt: skip
    return out


def describe_machine() -> dict[str, Any]:
    """Machine of the timings: processor, cores, system."""
    model = platform.processor() or platform.machine()
    if Path("/proc/cpuinfo").exists():
        for line in Path("/proc/cpuinfo").read_text(errors="replace").splitlines():
            if line.startswith("model name"):
                model = line.partition(":")[2].strip()
                break
    return {"processor": model, "cores": os.cpu_count(), "system": platform.system()}
