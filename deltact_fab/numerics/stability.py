"""Stiff and extreme cases: each is right within its bound, or refused; anything else is wrong."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ..errors import DeltactFabError
from .engine import Case
from .engines import load
from .worker import SILENCE_S, WorkerDied, answers


def measure(
    name: str,
    module: str,
    cases: Sequence[Case],
    scratch: Path,
    quick: bool,
    silence_s: float = SILENCE_S,
) -> Iterator[dict[str, Any]]:
    """Judge the cases in one worker; one that takes the worker down is wrong, the rest go on."""
    done = 0
    while done < len(cases):
        end = "the worker ended early"
        found = answers(judged, module, str(scratch), quick, done, silence_s=silence_s)
        try:
            for row in found:
                done += 1
                yield {"engine": name, **row}
        except WorkerDied as why:
            end = str(why)
        if done < len(cases):
            row = _row(cases[done], "wrong", None, f"the process died: {end}")
            done += 1
            yield {"engine": name, **row}


def judged(module: str, scratch: str, quick: bool, first: int) -> Iterator[dict[str, Any]]:
    """The rows of a module's cases from the first on, in the worker."""
    for case in load(module).cases(quick)[first:]:
        yield judge(case, Path(scratch))


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
