"""What an engine states about itself: what to time, against which truth, and its hard cases."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from ..errors import DeltactFabError

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
