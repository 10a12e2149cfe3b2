"""What the two grids of a pattern search gave, and what follows from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from ...errors import RunFailed
from ...protocols.plan import Protocol
from ..intervals import Interval, estimate, mean
from ..request import StudyRequest
from .candidates import Candidate, Size
from .imager import PatternImager
from .search import ERROR, order

DEFAULT, FARNEBACK = "fused", "paper"
"""Trackers: ours, and the paper's own, as `measure.flow.named_tracker` calls them."""
GOAL = 1 / 3
"""Of the paper's pattern's mean error, at most."""


@dataclass(frozen=True)
class ConfirmedPattern:
    """A pattern on the finite-strain gel: means over seeds and presses.

    errors_mm: by seed; by_press_mm: of each press, over the seeds; in their order.
    """

    pattern: str
    method: str
    errors_mm: tuple[float, ...]
    by_press_mm: tuple[float, ...]
    error: Interval
    confident_mm: float | None
    p95_mm: float | None
    coverage: float

    def as_row(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "pattern": self.pattern,
            "tracker": self.method,
            "mean_error_mm": self.error.value,
            "low_mm": self.error.low,
            "high_mm": self.error.high,
            "over": self.error.over,
            "confident_error_mm": self.confident_mm,
            "p95_error_mm": self.p95_mm,
            "coverage": self.coverage,
        }


def confirmed(
    results: Sequence[Sequence[Mapping[str, Any]]], names: Sequence[str], method: str
) -> tuple[list[ConfirmedPattern], dict[str, str]]:
    """Patterns that a method tracked with every seed, best first; why not, of the others.

    results: by seed, what `confirm` returned of each press. A press counts as much as another.
    """
    found, refused = [], {}
    for name in names:
        each = [[press["figures"].get(name, {}) for press in presses] for presses in results]
        flat = [figures for presses in each for figures in presses]
        if why := next((f["why"] for f in flat if "why" in f), ""):
            refused[name] = why
        elif flat and all(method in f for f in flat):
            found.append(_one(name, method, [[f[method] for f in presses] for presses in each]))
    return sorted(found, key=lambda c: c.error.value), refused


def _one(name: str, method: str, figures: list[list[dict[str, Any]]]) -> ConfirmedPattern:
    """figures: by seed, of each press."""
    by_press = np.array([[f["mean_off_dots_mm"] for f in presses] for presses in figures])
    flat = [f for presses in figures for f in presses]
    errors = tuple(float(v) for v in by_press.mean(axis=1))
    return ConfirmedPattern(
        name,
        method,
        errors,
        tuple(float(v) for v in by_press.mean(axis=0)),
        mean(errors, range(len(errors)), "seed"),
        _mean(f["mean_confident_mm"] for f in flat),
        _mean(f["p95_off_dots_mm"] for f in flat),
        float(np.mean([f["coverage"] or 0.0 for f in flat])),
    )


def _mean(values: Any) -> float | None:
    known = [v for v in values if v is not None]
    return float(np.mean(known)) if known else None


def gain(
    found: Sequence[ConfirmedPattern], finalists: Sequence[str], paper: str
) -> Interval | None:
    """Error of the finalist to print over the paper's pattern's, by the seeds, with its interval.

    For each seed the finalist is the best of the *other* seeds, so that having chosen it among
    several flatters nothing. None where the paper's pattern was not tracked.
    """
    by_name = {one.pattern: np.array(one.errors_mm) for one in found}
    if paper not in by_name:
        return None
    candidates = np.array([by_name[name] for name in finalists if name in by_name])
    return ratio(chosen_by_others(candidates), by_name[paper])


def ratio(errors_mm: ArrayLike, other_mm: ArrayLike) -> Interval:
    """Mean of errors (seeds,) over that of others, seed by seed, with its interval."""
    rows = np.column_stack((errors_mm, other_mm))
    return estimate(
        rows, range(len(rows)), lambda r: float(r[:, 0].mean() / r[:, 1].mean()), "seed", "positive"
    )


def chosen_by_others(errors: NDArray[np.float64]) -> NDArray[np.float64]:
    """For each seed the error of the pattern that the other seeds call best.

    errors: (patterns, seeds). With one seed, the best one.
    """
    n = errors.shape[1]
    if n == 1:
        return np.asarray(errors.min(axis=0))
    rest = errors.sum(axis=1, keepdims=True) - errors
    return np.asarray(errors[rest.argmin(axis=0), np.arange(n)])


RECIPE_SEED = 7
MIN_ORDERED = 6


@dataclass(frozen=True)
class Findings:
    """All that the two grids gave.

    frame: of candidates. presses: of a held-out seed, by name. ours, farneback: what was confirmed
    by the default and by the paper's own tracker, best first; refused: why not, of the others.
    seen: what `confirm` gave of a first press.
    """

    asked: StudyRequest
    rig: str
    bench: PatternImager
    size: Size
    protocol: Protocol
    presses: list[str]
    among: list[Candidate]
    frame: pd.DataFrame
    finalists: list[str]
    paper: str
    shipped: str | None
    ours: list[ConfirmedPattern]
    farneback: list[ConfirmedPattern]
    refused: dict[str, str]
    seen: Mapping[str, Any]
    missing: tuple[str, ...]

    @cached_property
    def best(self) -> ConfirmedPattern:
        """The pattern to print: the finalist with the least error.

        Raises RunFailed where none was tracked on the gel.
        """
        for one in self.ours:
            if one.pattern in self.finalists:
                return one
        raise RunFailed("pattern-search: no finalist could be tracked on the gel")

    @cached_property
    def recipe(self) -> dict[str, Any]:
        """Of the pattern to print."""
        return next(c for c in self.among if c.name == self.best.pattern).plain(RECIPE_SEED)

    @cached_property
    def gain(self) -> Interval | None:
        """Its error over that of the paper's pattern."""
        return gain(self.ours, self.finalists, self.paper)

    @cached_property
    def orders(self) -> dict[str, pd.DataFrame]:
        """Of predictors: by the drag's error, by that of the pixels that the tracker is sure of
        (`sure`), by the share that it is not sure of (`lost`), and by the error on the gel (`gel`)
        where enough patterns were confirmed.
        """
        errors = {one.pattern: one.error.value for one in self.ours}
        frame = self.frame.assign(
            lost=1 - self.frame["coverage"], gel=self.frame["pattern"].map(errors)
        )
        columns = {"": ERROR, "sure": "confident_error_mm", "lost": "lost"}
        if len(errors) >= MIN_ORDERED:
            columns["gel"] = "gel"
        return {name: order(frame, column) for name, column in columns.items()}

    def of(self, found: list[ConfirmedPattern], name: str | None) -> ConfirmedPattern | None:
        """A confirmed pattern by its name."""
        return next((one for one in found if one.pattern == name), None)

    def row(self, name: str) -> dict[str, Any]:
        """A candidate's row of the table of the search."""
        row = self.frame[self.frame["pattern"] == name].iloc[0]
        return {str(column): value for column, value in row.items()}
