"""The long tables: every row in a process of its own, kept in a file, written up as markdown.

`python -m deltact_fab.numerics.evidence [--only PREFIX] [--limit-s N] [--keep]`; `make evidence`
runs it. A row is run once for the sources that it depends on; what is there already is skipped, so
an interrupted run goes on where it stopped. A row that fails or dies is kept with its reason.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from .worker import THREAD_VARIABLES

FOLDER = Path("docs") / "evidence"
LIMIT_S = 3600.0
COMMAND = "make evidence"
RANDOM_PRESSES = 30
SEED = 20
COVERED, MEDIAN = 0.9, 5.0  # goals for the estimates


@dataclass(frozen=True)
class Row:
    """name: unique, starts with its table. call: made in the row's own process."""

    name: str
    call: Callable[[], dict[str, Any]]

    @property
    def file(self) -> str:
        """Under `rows`."""
        return re.sub(r"[^a-z0-9.+-]+", "-", self.name.lower()).strip("-") + ".json"


# -- rows ------------------------------------------------------------------------------------------


def rows() -> Iterator[Row]:
    """All rows, the cheap tables first."""
    from .engines import gel, gel_cases

    for case in gel_cases.every_case():
        yield Row(f"stability: {case.name}", partial(_case, case))
    for depth in (2.0, 5.0):
        for mu in (0.0, 0.5):
            yield Row(f"reference: {depth:g} mm, friction {mu:g}", partial(_reference, depth, mu))
    for run in gel.every_run():
        yield Row(f"curve: {run.case}: {run.series}: {run.name}", partial(_curve, run))
    for i in range(RANDOM_PRESSES):
        yield Row(f"press: {i + 1}", partial(_press, i))
    for case in long_cases():
        yield Row(f"drag: {case.name}", partial(_case, case))


def long_cases() -> Sequence[Any]:
    """Sharp indenters to 10 mm with +-10 mm of shear: half an hour each and more."""
    from .engine import Case
    from .engines import gel_cases

    out = []
    for name in gel_cases.SHARP:
        for axis, letter in ((0, "x"), (1, "y")):
            # A mirror where indenter and path have it: the star's only one is y = 0.
            mirrors = (axis == 1 and name != "star", axis == 0)
            wide, narrow = (-17.0, 17.0), (-6.0, 6.0)
            box = (*wide, *narrow) if axis == 0 else (*narrow, *wide)
            scene = gel_cases.Scene(name, 1.0, 0.5, focus=box, mirrors=mirrors)
            call = partial(_drag, scene, axis)
            out.append(Case(f"{name} to 10 mm, sheared +-10 mm in {letter}", "right or refused",
                            call, 0.05, "of the force", "t"))  # fmt: skip
    return out


def _drag(scene: Any, axis: int, scratch: Path) -> tuple[float, str]:
    """Worst breach of balance, cone and, where the indenter has it, mirror symmetry."""
    from .engines import gel_cases

    found = []
    for sign in (1.0, -1.0):
        end = [0.0, 0.0, 10.0]
        end[axis] = sign * 10.0
        path = gel_cases.solved(scene, 0.5, (0.0, 0.0, 10.0), (end[0], end[1], end[2]))
        found.append(gel_cases.trusted(path))
    worst = max(max(gel_cases.imbalance(f), gel_cases.cone_excess(f)) for f in found)
    note = "; ".join(f.note() for f in found)
    if not (scene.indenter == "star" and axis == 0):
        a, b = (max(abs(s.force_n[axis]) for s in f.states) for f in found)
        worst = max(worst, abs(a / b - 1))
        note += f"; largest side force {a:.4g} and {b:.4g} N"
    return worst, note


def _case(case: Any) -> dict[str, Any]:
    import tempfile

    from .worker import judge

    with tempfile.TemporaryDirectory() as scratch:
        return judge(case, Path(scratch))


def _reference(depth_mm: float, friction: float) -> dict[str, Any]:
    from .engines import gel

    truth = gel.reference(depth_mm, friction)
    coarse, fine, step, _ = gel.FINE[friction == 0]
    return {
        "depth_mm": depth_mm, "friction": friction, "meshes_mm": [coarse, fine], "step_mm": step,
        "normal_n": truth.normal_n, "own_force_percent": truth.force_error,
        "own_in_plane_mm": truth.in_plane_error,
    }  # fmt: skip


def _curve(run: Any) -> dict[str, Any]:
    from dataclasses import replace

    from .engines import gel
    from .worker import peak_resident_mb, reset_peak_mb

    truth = gel.reference(run.depth_mm, run.friction)
    warm = "layer" if run.level == "layer" else "hyperelastic"
    gel.solve(replace(run, level=warm, depth_mm=0.5, spacing_mm=1.0 if warm == "layer" else 3.0,
                      part="quarter", solver="auto"))  # fmt: skip
    before = reset_peak_mb()
    wall, cpu = time.perf_counter(), time.process_time()
    answer = gel.solve(run)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    force, in_plane = gel.errors(answer, truth)
    return {
        "case": run.case, "series": run.series, "setting": run.name,
        "wall_s": answer.inner_s or wall, "cpu_s": None if answer.inner_s else cpu,
        "peak_mb": None if answer.inner_s else max(0.0, peak_resident_mb() - before),
        "force_percent": force, "in_plane_mm": in_plane, "note": answer.note,
    }  # fmt: skip


def random_press(i: int) -> tuple[str, tuple[float, float], float]:
    """Indenter, place and depth of a random press of a smooth indenter, the i-th of the seed."""
    import numpy as np

    rng = np.random.default_rng([SEED, i])
    if rng.random() < 0.75:
        size = round(float(rng.uniform(6.0, 22.0)), 1)
        name, half = f"sphere:{size:g}", size / 2
    else:
        size = round(float(rng.uniform(7.0, 14.0)), 1)
        name, half = f"ellipsoid:{size:g}", size / 2
    x, y = (round(float(rng.uniform(-1, 1)) * max(0.0, s - half), 1) for s in (18.0, 17.0))
    return name, (x, y), round(float(rng.uniform(0.3, 6.0)), 2)


def _press(i: int) -> dict[str, Any]:
    """The estimate of `gel press` against the next mesh and Richardson's extrapolation."""
    from dataclasses import replace

    import numpy as np

    from ..gel.choose import pick
    from ..gel.level import Reach, contact_of
    from ..gel.material import GelMaterial
    from ..gel.press import press
    from ..shapes import SkinDimensions
    from ..shapes.indenter import parse
    from .engines.gel import rms_mm

    name, (x, y), depth = random_press(i)
    skin, material, indenter = SkinDimensions(), GelMaterial(), parse(name)
    found = press(skin, material, indenter, (x, y), depth)
    out: dict[str, Any] = {"indenter": name, "at_mm": [x, y], "depth_mm": depth}
    result = found.result
    if result["force_n"] is None:
        return {**out, "refused": result["reason"]}
    tip = (x, y, depth)
    level = result["model"]
    # A linear level is judged by finite strain, on the mesh that this would be given.
    asked = result["picked"]["spacing_mm"] if level == "hyperelastic" else None
    choice = pick(skin, material, indenter, Reach.around([tip]), level="hyperelastic",
                  spacing_mm=asked)  # fmt: skip
    choice = replace(choice, step_mm=result["picked"]["step_mm"])
    answers = []
    # The mesh's part from the next mesh, friction's from half the steps, both at the finer one.
    for spacing, step in ((1.0, 1.0), (1.0, 0.5), (1 / 1.5, 0.5)):
        contact = contact_of(skin, material, indenter, choice.times(spacing, step))
        *_, last = contact.path(contact.rest((x, y, 0.0)), tip)
        answers.append((np.array(last.force_n), last.displacement_mm[..., :2]))
    weight = 1 / (1.5**2 - 1)
    force, u = (c + weight * (c - b) + (b - a) for a, b, c in zip(*answers, strict=True))
    true_force = float(np.linalg.norm(np.array(result["force_n"]) - force) / np.linalg.norm(force))
    true_mm = rms_mm(found.displacement_mm[..., :2] - u)
    estimate = result["error_estimate"]
    return {
        **out, "model": level, "spacing_mm": result["picked"]["spacing_mm"],
        "seconds": result["seconds"], "within_tolerance": result["within_tolerance"],
        "force": {"estimate": estimate["force_rel"], "true": true_force},
        "in_plane_mm": {"estimate": estimate["displacement_mm"], "true": true_mm},
    }  # fmt: skip


# -- running ---------------------------------------------------------------------------------------


def key_of(row: Row) -> dict[str, Any]:
    """What a row's file must have been made from to be skipped."""
    from .engines.gel import source_hash

    return {"row": row.name, "source": source_hash()}


def run_row(name: str, threads: int, limit_s: float) -> dict[str, Any]:
    """One row in a fresh process; a failure is a result too."""
    environment = {**os.environ, **dict.fromkeys(THREAD_VARIABLES, str(threads))}
    command = [sys.executable, "-m", "deltact_fab.numerics.evidence", "--row", name]
    try:
        ended = subprocess.run(
            command, capture_output=True, text=True, env=environment, timeout=limit_s, check=False
        )
    except subprocess.TimeoutExpired:
        return {"failed": f"no answer within {limit_s:g} s"}
    if ended.returncode:
        words = ended.stderr.strip().splitlines()
        return {"failed": words[-1] if words else f"exit {ended.returncode}"}
    answer: dict[str, Any] = json.loads(ended.stdout.splitlines()[-1])
    return answer


def fill(
    folder: Path, only: str = "", threads: int = 1, limit_s: float = LIMIT_S, keep: bool = False
) -> int:
    """Run what is missing; returns the number of rows that were run.

    only: a prefix of their names. keep: rows of other sources count as there, too.
    """
    from ..record import write_whole
    from .scenes import machine

    held = folder / "rows"
    held.mkdir(parents=True, exist_ok=True)
    wanted = [r for r in rows() if r.name.startswith(only)]
    ran = 0
    for i, row in enumerate(wanted, 1):
        path, key = held / row.file, key_of(row)
        if path.is_file():
            known = json.loads(path.read_text(encoding="utf-8"))["key"]
            if known == key or (keep and known["row"] == row.name):
                continue
        started = time.monotonic()
        result = run_row(row.name, threads, limit_s)
        seconds = time.monotonic() - started
        print(f"{i}/{len(wanted)} {row.name}: {seconds:.0f} s", file=sys.stderr, flush=True)
        entry = {
            "key": key, "result": result, "seconds": round(seconds, 1), "threads": threads,
            "load": [round(v, 1) for v in os.getloadavg()] if hasattr(os, "getloadavg") else None,
            "machine": machine(), "versions": _versions(),
        }  # fmt: skip
        write_whole(path, (json.dumps(entry, indent=1) + "\n").encode())
        ran += 1
    return ran


def _versions() -> dict[str, str]:
    from importlib.metadata import PackageNotFoundError, version

    from ..bench import versions

    found = {k: versions()[k] for k in ("deltact-fab", "python", "numpy", "scipy")}
    for name in ("numba", "pypardiso", "mkl"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


# -- writing up ------------------------------------------------------------------------------------


def write_up(folder: Path) -> Path:
    """README.md of the folder from the rows that are there. Returns its path."""
    from ..record import write_whole

    entries = [
        json.loads(p.read_text(encoding="utf-8")) for p in sorted((folder / "rows").glob("*.json"))
    ]
    order = {r.name: i for i, r in enumerate(rows())}
    entries = [e for e in entries if e["key"]["row"] in order]
    entries.sort(key=lambda e: order[e["key"]["row"]])
    tables: dict[str, list[dict[str, Any]]] = {}
    for e in entries:
        tables.setdefault(e["key"]["row"].partition(":")[0], []).append(e)
    lines = [
        "# Evidence", "",
        f"Written by `{COMMAND}` from `rows/`, a file a row; rerun, it goes on where it stopped. "
        "Do not edit.", "",
        *_made_on(entries), "",
        f"{len(entries)} of {len(order)} rows are there.", "",
    ]  # fmt: skip
    writers: dict[str, Callable[[Sequence[dict[str, Any]]], list[str]]] = {
        "stability": partial(_stability, "Stiff and extreme cases"), "reference": _references,
        "curve": _curves, "press": _presses,
        "drag": partial(_stability, "Sharp indenters to 10 mm, sheared +-10 mm"),
    }  # fmt: skip
    for name, write in writers.items():
        if name in tables:
            lines += [*write(tables[name]), ""]
    path = folder / "README.md"
    write_whole(path, ("\n".join(lines).rstrip() + "\n").encode())
    return path


def _made_on(entries: Sequence[dict[str, Any]]) -> list[str]:
    machines = sorted({f"{m['processor']}, {m['cores']} cores" for m in _each(entries, "machine")})
    sources = sorted({e["key"]["source"] for e in entries})
    threads = sorted({str(e["threads"]) for e in entries})
    loads = [e["load"][0] for e in entries if e["load"]]
    names = sorted({f"{k} {v}" for v in _each(entries, "versions") for k, v in v.items()})
    out = [
        f"Machine: {'; '.join(machines)}. Threads: {', '.join(threads)}.",
        f"Versions: {', '.join(names)}.",
        f"Source (hash of the gel's modules): {', '.join(sources)}.",
    ]
    if loads:
        out.append(
            f"Load of the machine when a row ended: {min(loads):g} to {max(loads):g}; over its "
            "cores, wall times are long and CPU times are the ones to read."
        )
    return out


def _each(entries: Sequence[dict[str, Any]], key: str) -> list[dict[str, Any]]:
    return [e[key] for e in entries]


def _table(head: Sequence[str], body: Sequence[Sequence[Any]]) -> list[str]:
    def cell(value: Any) -> str:
        if value is None:
            return ""
        if isinstance(value, float):
            return f"{value:.4g}"
        return str(value).replace("|", "/").replace("\n", " ")

    return [
        "| " + " | ".join(head) + " |",
        "|" + "---|" * len(head),
        *("| " + " | ".join(cell(v) for v in row) + " |" for row in body),
    ]


def _stability(title: str, entries: Sequence[dict[str, Any]]) -> list[str]:
    body: list[Sequence[Any]] = []
    counts: dict[str, int] = {}
    for e in entries:
        r = e["result"]
        outcome = r.get("outcome", "wrong")
        counts[outcome] = counts.get(outcome, 0) + 1
        body.append((
            r.get("case", e["key"]["row"].partition(": ")[2]), r.get("expectation"),
            r.get("bound"), r.get("figure"), r.get("unit"), outcome,
            r.get("note") or r.get("failed"), r.get("seconds"),
        ))  # fmt: skip
    told = ", ".join(f"{n} {k}" for k, n in sorted(counts.items()))
    head = ("case", "expected", "bound", "figure", "unit", "outcome", "note", "s")
    return [f"## {title}", "", f"{told}.", "", *_table(head, body)]


def _references(entries: Sequence[dict[str, Any]]) -> list[str]:
    head = ("depth, mm", "friction", "meshes, mm", "step, mm", "force, N", "own error, %",
            "own error in plane, mm")  # fmt: skip
    keys = ("depth_mm", "friction", "meshes_mm", "step_mm", "normal_n", "own_force_percent",
            "own_in_plane_mm")  # fmt: skip
    body = [
        [e["result"].get(k) for k in keys] if "failed" not in e["result"]
        else [e["key"]["row"], e["result"]["failed"]] for e in entries
    ]  # fmt: skip
    return ["## References of the curves", "", *_table(head, body)]


def _curves(entries: Sequence[dict[str, Any]]) -> list[str]:
    out = ["## Error against run time", "",
           "One run each after a warm-up. Times as fast: CPU time (felupe: wall time) of "
           "`hyperelastic, whole, cells of one size` at the same spacing over the row's; felupe "
           "has the same mesh and contact."]  # fmt: skip
    by_case: dict[str, list[dict[str, Any]]] = {}
    for e in entries:
        case = e["result"].get("case") or e["key"]["row"].split(": ")[1]
        by_case.setdefault(case, []).append(e["result"] | {"row": e["key"]["row"]})
    head = ("series", "setting", "wall, s", "CPU, s", "times as fast", "MB", "force error, %",
            "in plane, mm rms", "note")  # fmt: skip
    for case, found in by_case.items():
        even = "hyperelastic, whole, cells of one size"
        base = {r["setting"]: (r["wall_s"], r["cpu_s"]) for r in found if r.get("series") == even}
        body: list[Sequence[Any]] = []
        for r in found:
            if "failed" in r:
                body.append((r["row"].partition(": ")[2], *[None] * 7, r["failed"]))
                continue
            wall, cpu = base.get(r["setting"], (None, None))
            times = None
            if wall and r["cpu_s"] is None:
                times = wall / r["wall_s"]
            elif cpu and r["cpu_s"]:
                times = cpu / r["cpu_s"]
            note = ", ".join(
                f"{k} {v:.3g}" if isinstance(v, float) else f"{k} {v}"
                for k, v in r["note"].items() if not isinstance(v, dict)
            )  # fmt: skip
            body.append((r["series"], r["setting"], r["wall_s"], r["cpu_s"], times, r["peak_mb"],
                         r["force_percent"], r["in_plane_mm"], note))  # fmt: skip
        out += ["", f"### {case}", "", *_table(head, body)]
    return out


def coverage(pairs: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Of (estimate, true): share with estimate >= true, and the median of estimate / true."""
    if not pairs:
        return math.nan, math.nan
    share = sum(estimate >= true for estimate, true in pairs) / len(pairs)
    return share, statistics.median(e / t if t > 0 else math.inf for e, t in pairs)


def _presses(entries: Sequence[dict[str, Any]]) -> list[str]:
    body: list[Sequence[Any]] = []
    good: list[dict[str, Any]] = []
    for e in entries:
        r = e["result"]
        if "force" not in r:
            reason = r.get("refused") or r.get("failed")
            body.append((r.get("indenter"), r.get("at_mm"), r.get("depth_mm"), reason))
            continue
        good.append(r)
        body.append((r["indenter"], r["at_mm"], r["depth_mm"], r["model"], r["spacing_mm"],
                     100 * r["force"]["estimate"], 100 * r["force"]["true"],
                     r["in_plane_mm"]["estimate"], r["in_plane_mm"]["true"],
                     r["within_tolerance"], r["seconds"]))  # fmt: skip
    told = []
    for what, name in (("force", "force"), ("in_plane_mm", "in plane")):
        share, median = coverage([(r[what]["estimate"], r[what]["true"]) for r in good])
        told.append(f"{name}: covered {share:.0%}, median estimate / true {median:.2g}")
    head = ("indenter", "at, mm", "depth, mm", "model", "cells, mm", "force: estimate, %",
            "true, %", "in plane: estimate, mm", "true, mm", "within tolerance", "s")  # fmt: skip
    return [
        "## Estimates of random presses", "",
        f"Goals: covered at least {COVERED:.0%}, median at most {MEDIAN:g}. {'; '.join(told)}; "
        f"{len(good)} of {len(entries)} were solved. True: against the next mesh (1.5 times as "
        "fine) at second order and, for friction, half the steps at first order.", "",
        *_table(head, body),
    ]  # fmt: skip


def main() -> None:
    """Run what is missing and write it up; `--row NAME` is one row's own process."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--row")
    parser.add_argument("--only", default="", help="rows whose name starts with this")
    parser.add_argument("--limit-s", type=float, default=LIMIT_S, help="longest a row may take")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--keep", action="store_true", help="keep rows of other sources")
    parser.add_argument("--out", type=Path, default=FOLDER)
    given = parser.parse_args()
    if given.row is not None:
        print(json.dumps(next(r for r in rows() if r.name == given.row).call(), allow_nan=False))
        return
    ran = fill(given.out, given.only, given.threads, given.limit_s, given.keep)
    print(f"{ran} rows run; {write_up(given.out)}")


if __name__ == "__main__":
    main()
