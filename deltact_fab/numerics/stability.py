"""Stiff and extreme cases: each is right within its bound, or refused; anything else is wrong."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

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
