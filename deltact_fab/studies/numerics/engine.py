"""What an engine states about itself: what to time, against which truth, and its hard cases."""

from __future__ import annotations

import contextlib
import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from deltact_fab.common import DeltactFabError

Expectation = Literal["right", "refused", "right or refused"]


class Flagged(DeltactFabError):
    """The engine returned a result and marked it as not to be trusted: a refusal with an array."""


@dataclass(frozen=True)
class Work:
    """One setting made ready: `run` is timed, `error` judges its result and is not."""

    run: Callable[[], Any]
    error: Callable[[Any], float]


@dataclass(frozen=True)
class CurveSetting:
    """One point of a curve.

    case: what is computed; one panel a case. series, name: how it is set; a series is joined by a
    line. unit: of the error. reference: what the error is against; reference_error: its own error
    in the same unit. build: called in a fresh process with a scratch folder that all settings of
    one command share. kind: independent where the reference is a closed form, another method's or a
    truth whose model the estimator does not share; a self-test where they share it or it is our own
    solver, finer. A case's first setting is its baseline.
    """

    case: str
    series: str
    name: str
    unit: str
    reference: str
    reference_error: float
    build: Callable[[Path], Work]
    kind: Literal["independent", "self-test"] = "independent"

    @property
    def key(self) -> str:
        """Unique among the settings of an engine."""
        return f"{self.case} | {self.series} | {self.name}"


@dataclass(frozen=True)
class Case:
    """One row of the stability table.

    expectation: `right` is a figure whose size is within bound; `refused` is an error of ours (or
    a result flagged as not to be trusted) whose text contains `says`. check: figure, or figure and
    note; called with the scratch folder.
    """

    name: str
    expectation: Expectation
    check: Callable[[Path], float | tuple[float, str]]
    bound: float | None = None
    unit: str = ""
    says: str = ""

    def __post_init__(self) -> None:
        if self.expectation != "refused" and self.bound is None:
            raise ValueError(f"case {self.name!r}: expectation {self.expectation!r} needs a bound")


@dataclass(frozen=True)
class Engine:
    """title, about: for the page. curves, cases: called with `quick`, a few seconds' worth."""

    title: str
    about: str
    cases: Callable[[bool], Sequence[Case]]
    curves: Callable[[bool], Sequence[CurveSetting]]


def judge(case: Case, scratch: Path) -> dict[str, Any]:
    """One row of the table: what was expected, the figure, the outcome, and what was said.

    Outcome: right, refused or wrong. Seconds: wall clock.
    """
    start_s = time.perf_counter()
    figure: float | None = None
    note = ""
    try:
        answer = case.check(scratch)
        figure, note = answer if isinstance(answer, tuple) else (answer, "")
        figure = float(figure)
    except DeltactFabError as error:
        note = " ".join(str(error).split())
        verdict = "refused"
    except Exception as error:  # a crash is a verdict of its own
        note = f"{type(error).__name__}: {' '.join(str(error).split())}"[:300]
        verdict = "crashed"
    else:
        within = case.bound is not None and math.isfinite(figure) and abs(figure) <= case.bound
        verdict = "right" if within else "off"
    if verdict == "refused" and case.says not in note:
        verdict, note = "off", f"refused for another reason: {note}"
    outcome = verdict if verdict in case.expectation.split(" or ") else "wrong"
    return stability_row(case, outcome, finite_or_none(figure), note, time.perf_counter() - start_s)


def stability_row(
    case: Case, outcome: str, figure: float | None, note: str, seconds: float = 0.0
) -> dict[str, Any]:
    return {
        "case": case.name, "expectation": case.expectation, "bound": case.bound, "figure": figure,
        "unit": case.unit, "outcome": outcome, "note": note, "seconds": seconds,
    }  # fmt: skip


def finite_or_none(figure: float | None) -> float | None:
    """JSON knows no NaN: a figure that is none is null."""
    return None if figure is None or not math.isfinite(figure) else float(figure)


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
