"""Stiff and extreme cases: each is right within its bound, or refused; anything else is wrong."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from ..errors import DeltactFabError
from .engine import Case, Engine
from .process import SILENCE_S, WorkerDied, answers


@dataclass(frozen=True)
class StabilityRow:
    """One case: figure within bound is `right`; `wrong` stays in the table and fails the command.

    note: what the engine said, or what the figure does not show.
    """

    engine: str
    case: str
    expectation: str
    bound: float | None
    figure: float | None
    unit: str
    outcome: Literal["right", "refused", "wrong"]
    note: str
    seconds: float

    def as_dict(self) -> dict[str, Any]:
        """Plain data, in the order of the CSV."""
        return asdict(self)


def run(
    engine: Engine,
    module: str,
    cases: list[Case],
    scratch: Path,
    quick: bool,
    silence_s: float = SILENCE_S,
) -> Iterator[StabilityRow]:
    """Judge the cases in one worker; one that takes the worker down is wrong, the rest go on."""
    done = 0
    while done < len(cases):
        job = {
            "kind": "cases",
            "module": module,
            "first": done,
            "threads": 1,
            "scratch": str(scratch),
            "quick": quick,
        }
        try:
            for found in answers(job, silence_s):
                done += 1
                yield StabilityRow(engine=engine.name, **found)
            if done < len(cases):
                raise WorkerDied("the worker ended early")
        except WorkerDied as why:
            if done < len(cases):
                case = cases[done]
                done += 1
                yield StabilityRow(
                    engine=engine.name,
                    case=case.name,
                    expectation=case.expectation,
                    bound=case.bound,
                    figure=None,
                    unit=case.unit,
                    outcome="wrong",
                    note=f"the process died: {why}",
                    seconds=0.0,
                )


def judge(case: Case, scratch: Path) -> dict[str, Any]:
    """One row of the stability table: what was expected, what came, and the verdict."""
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
    wanted = case.expectation.split(" or ")
    return {
        "case": case.name,
        "expectation": case.expectation,
        "bound": case.bound,
        "unit": case.unit,
        "figure": plain(figure),
        "outcome": came if came in wanted else "wrong",
        "note": note,
        "seconds": time.perf_counter() - start_s,
    }


def plain(value: Any) -> Any:
    """JSON knows no NaN: a figure that is none is null."""
    if hasattr(value, "item"):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
