"""Stiff and extreme cases: each is right within its bound, or refused; anything else is wrong."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ..errors import DeltactFabError, RunFailed
from .engine import Case
from .engines import alone, load, on_one_core

# A reference takes a minute on a quiet core and several on a busy one; this ends what hangs.
SILENCE_S = 600.0


def measure(
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
                try:
                    yield {"engine": name} | process.submit(
                        judged, module, scratch, quick, k
                    ).result(silence_s)
                except (RunFailed, TimeoutError) as why:
                    said = str(why) or f"no answer for {silence_s:g} s"
                    row = _row(cases[k], "wrong", None, f"the process died: {said}")
                    yield {"engine": name} | row
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
