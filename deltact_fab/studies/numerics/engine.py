"""Interface of a benchmarked engine: settings to time, their reference, and hard cases."""

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
TruthKind = Literal["exact", "independent solver", "finer self", "real recording"]


class Flagged(DeltactFabError):
    """The engine returned a result that it marks as untrusted; allowed where a refusal is."""


@dataclass(frozen=True)
class Work:
    """A prepared setting: `run` is timed, `error` evaluates its result and is not timed."""

    run: Callable[[], Any]
    error: Callable[[Any], float]


@dataclass(frozen=True)
class CurveSetting:
    """One point of a curve.

    case: problem solved; one panel per case. series, name: parameters; a line joins a series.
    unit: of the error. reference, reference_error: reference solution and its error, in `unit`.
    build: called in a fresh process with a scratch folder that all settings of a command share.
    kind: of the reference. "exact": a closed form, or the field that an image was drawn from. A
    "finer self" shows convergence, not accuracy, and is never on the front.
    recommended: whether it is the default of the engine's users.
    A case's first setting is its baseline.
    """

    case: str
    series: str
    name: str
    unit: str
    reference: str
    reference_error: float
    build: Callable[[Path], Work]
    kind: TruthKind = "exact"
    recommended: bool = False

    @property
    def key(self) -> str:
        """Key, unique among the settings of an engine."""
        return f"{self.case} | {self.series} | {self.name}"


@dataclass(frozen=True)
class Case:
    """One row of the stability table.

    expectation: `right`: a figure with magnitude within bound; `refused`: a DeltactFabError (or
    a result flagged as untrusted) with one of the words in `says`, separated by "|", in its text.
    check: called with the scratch folder; returns the figure, or figure and note.
    cell: chart, row and column of the map of extremes. outside: whether the figure is an error
    against an answer from outside; else it is what the engine states.
    """

    name: str
    expectation: Expectation
    check: Callable[[Path], float | tuple[float, str]]
    bound: float | None = None
    unit: str = ""
    says: str = ""
    cell: tuple[str, str, str] | None = None
    outside: bool = True

    def __post_init__(self) -> None:
        if self.expectation != "refused" and self.bound is None:
            raise ValueError(f"case {self.name!r}: expectation {self.expectation!r} needs a bound")


@dataclass(frozen=True)
class Engine:
    """title, about: for the page. cases: called with `quick`: a few seconds only.

    extremes: cases of the map, each with its cell; their stored outcomes are in `extremes`. slow:
    its curves take too long for a quick page.
    """

    title: str
    about: str
    cases: Callable[[bool], Sequence[Case]]
    curves: Callable[[], Sequence[CurveSetting]]
    extremes: Callable[[], Sequence[Case]] = tuple
    slow: bool = False


def judge(case: Case, scratch: Path) -> dict[str, Any]:
    """Run a case; return its row: expectation, figure, outcome, note.

    Outcome: right, flagged, refused or wrong. Seconds: wall clock.
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
        verdict = "flagged" if isinstance(error, Flagged) else "refused"
    except Exception as error:  # a crash is a verdict of its own
        note = f"{type(error).__name__}: {' '.join(str(error).split())}"[:300]
        verdict = "crashed"
    else:
        within = case.bound is not None and math.isfinite(figure) and abs(figure) <= case.bound
        verdict = "right" if within else "off"
    expected = "refused" if verdict == "flagged" else verdict
    if expected == "refused" and not any(words in note for words in case.says.split("|")):
        expected, note = "off", f"refused for another reason: {note}"
    outcome = verdict if expected in case.expectation.split(" or ") else "wrong"
    return stability_row(case, outcome, finite_or_none(figure), note, time.perf_counter() - start_s)


def stability_row(
    case: Case, outcome: str, figure: float | None, note: str, seconds: float = 0.0
) -> dict[str, Any]:
    row = {
        "case": case.name, "expectation": case.expectation, "bound": case.bound, "figure": figure,
        "unit": case.unit, "outcome": outcome, "note": note, "seconds": seconds,
    }  # fmt: skip
    if case.cell:
        row |= dict(zip(("chart", "row", "column"), case.cell, strict=True))
        row["outside"] = case.outside
    return row


def finite_or_none(figure: float | None) -> float | None:
    """Return the figure, or None if it is not finite (JSON has no NaN)."""
    return None if figure is None or not math.isfinite(figure) else float(figure)


def reset_peak_mb() -> float:
    """Reset the peak-memory counter if the system can; return the current memory, MB."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")
        return _status_mb("VmRSS:")
    return peak_resident_mb()


def peak_resident_mb() -> float:
    """Peak resident memory since `reset_peak_mb`, or since the start if it cannot be reset."""
    with contextlib.suppress(OSError):
        return _status_mb("VmHWM:")
    import resource

    unit = 1024 * 1024 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


def _status_mb(key: str) -> float:
    words = Path("/proc/self/status").read_text().split()
    return int(words[words.index(key) + 1]) / 1024
