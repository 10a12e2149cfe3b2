"""The long tables: every row in a process of its own, kept in a file, written up as markdown.

`python -m deltact_fab.numerics.evidence [--only PREFIX] [--limit-s N] [--keep]`; `make evidence`
runs it. A row is run once for the sources that it depends on; what is there already is skipped, so
an interrupted run goes on where it stopped. A row that fails or dies is kept with its reason.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from .evidence_held import every_held, held_row
from .evidence_presses import press_row
from .evidence_rows import case_row, curve_row, reference_row
from .evidence_tables import write_up
from .worker import THREAD_VARIABLES

FOLDER = Path("docs") / "evidence"
LIMIT_S = 3600.0
RANDOM_PRESSES = 30
DRAG_MM = 1.6


@dataclass(frozen=True)
class Row:
    """name: unique, starts with its table. call: made in the row's own process.

    sources: of the package's files, as globs, those that the result depends on. asked: what else
    it depends on, in words. With both unchanged a row is not run again.
    """

    name: str
    call: Callable[[], dict[str, Any]]
    sources: tuple[str, ...]
    asked: str = ""

    @property
    def file(self) -> str:
        """Under `rows`."""
        return re.sub(r"[^a-z0-9.+-]+", "-", self.name.lower()).strip("-") + ".json"


# -- rows ------------------------------------------------------------------------------------------


def rows() -> Iterator[Row]:
    """All rows, the cheap tables first."""
    from .engines import gel, gel_cases
    from .engines.gel_sources import FINITE, LEVELS, RUNS, SOLVED

    own = "numerics/evidence_rows.py"
    yield from (_case_row("stability", case) for case in gel_cases.every_case())
    for depth in (2.0, 5.0):
        for mu in (0.0, 0.5):
            name = f"reference: {depth:g} mm, friction {mu:g}"
            yield Row(name, partial(reference_row, depth, mu), (*FINITE, *RUNS, own))
    for run in gel.every_run():
        levels = {"auto": LEVELS, "layer": SOLVED, "block": SOLVED}.get(run.level, FINITE)
        name = f"curve: {run.case}: {run.series}: {run.name}"
        yield Row(name, partial(curve_row, run), (*levels, *RUNS, own), repr(run))
    for i in range(RANDOM_PRESSES):
        sources = (*LEVELS, "numerics/evidence_presses.py")
        yield Row(f"press: {i + 1}", partial(press_row, i), sources)
    for held in every_held():
        sources = (*SOLVED, "numerics/evidence_held.py")
        yield Row(f"held: {held.name}", partial(held_row, held), sources, repr(held))
    yield from (_case_row("straight", case) for case in straight_cases())
    yield from (_case_row("drag", case) for case in long_cases())


def _case_row(table: str, case: Any) -> Row:
    from .engines.gel_sources import CASES, ENERGY, FINITE, LEVELS, PRISM, STRAIGHT

    words, modules = _spelled(case.check)
    asked = f"{case.expectation}, {case.bound}, {case.says!r}: {words}"
    checks = (*CASES, ENERGY, STRAIGHT)
    files = {f"deltact_fab.{path[:-3].replace('/', '.')}": path for path in checks}
    if modules <= files.keys():
        sources = {*FINITE, *CASES, *(files[m] for m in modules)}
    else:
        sources = {*LEVELS, "numerics/engines/*.py"}
    if "hexprism" in words or "star" in words:
        sources.add(PRISM)
    return Row(f"{table}: {case.name}", partial(case_row, case), tuple(sorted(sources)), asked)


def _spelled(call: Any) -> tuple[str, set[str]]:
    """A call and its arguments in words, and the modules of the functions in it."""
    if not isinstance(call, partial):
        return (call.__qualname__, {call.__module__}) if callable(call) else (repr(call), set())
    words, modules = zip(*map(_spelled, (call.func, *call.args)), strict=True)
    keywords = "".join(f", {k}={v!r}" for k, v in call.keywords.items())
    return f"{words[0]}({', '.join(words[1:])}{keywords})", set().union(*modules)


def long_cases() -> Sequence[Any]:
    """Sharp indenters to 10 mm with +-10 mm of shear, on cells of the pattern selection's size."""
    from .engine import Case
    from .engines import gel_cases, gel_checks
    from .engines.gel_scene import Scene

    out = []
    for name in gel_cases.SHARP:
        for axis, letter in ((0, "x"), (1, "y")):
            # A mirror where indenter and path have it: the star's only one is y = 0.
            mirrors = (axis == 1 and name != "star", axis == 0)
            wide, narrow = (-17.0, 17.0), (-6.0, 6.0)
            box = (*wide, *narrow) if axis == 0 else (*narrow, *wide)
            scene = Scene(name, DRAG_MM, 0.5, focus=box, mirrors=mirrors)
            call = partial(gel_checks.long_drag, scene, axis)
            out.append(Case(f"{name} to 10 mm, sheared +-10 mm in {letter}", "right or refused",
                            call, 0.05, "of the force", "t"))  # fmt: skip
    return out


def straight_cases() -> Sequence[Any]:
    """Sharp indenters straight to 10 mm: the star on what the default tolerance picks.

    The others have two mirrors and are pressed into a whole block, so that none is assumed. The
    star has one; across it only the mesh can tell its points apart, so half a block shows it.
    """
    from ..gel.choose import TOLERANCE, pick
    from ..gel.level import Reach
    from ..gel.material import GelMaterial
    from ..shapes import SkinDimensions
    from ..shapes.indenter import parse
    from .engine import Case
    from .engines import gel_cases, gel_straight
    from .engines.gel_scene import Scene

    friction, depth_mm, box = 0.5, 10.0, (-6.0, 6.0, -6.0, 6.0)
    picked = pick(
        SkinDimensions(), GelMaterial(friction=friction), parse("star"), Reach(deepest_mm=depth_mm)
    )
    tried = [
        (Scene(name, 1.2, friction, focus=box, mirrors=(False, False)), 0.5, 1e-6)
        for name in gel_cases.SHARP
        if name != "star"
    ]
    star = Scene("star", picked.spacing_mm, friction, focus=picked.focus, mirrors=picked.mirrors)
    return [
        Case(f"{scene.indenter}, cells of {scene.spacing_mm:g} mm: no side force",
             "right or refused",
             partial(gel_straight.worst_side_force, scene, step_mm, depth_mm, bound), bound,
             "of the force", "press:")
        for scene, step_mm, bound in (*tried, (star, picked.step_mm, TOLERANCE))
    ]  # fmt: skip


# -- running ---------------------------------------------------------------------------------------


def key_of(row: Row) -> dict[str, Any]:
    """What a row's file must have been made from to be skipped."""
    from .engines.gel_sources import source_hash

    return {"row": row.name, "asked": row.asked, "source": source_hash(*row.sources)}


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

    from ..experiment import versions

    found = {k: versions()[k] for k in ("deltact-fab", "python", "numpy", "scipy")}
    for name in ("numba", "pypardiso", "mkl"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


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
    print(f"{ran} rows run; {write_up(given.out, [key_of(r) for r in rows()])}")


if __name__ == "__main__":
    main()
