"""What the two grids of a pattern search gave, and what follows from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...catalog import as_toml
from ...errors import RunFailed
from ...protocols.plan import Protocol
from ..intervals import Interval, estimate, mean
from .candidates import Candidate, Size
from .imager import PatternImager
from .search import Pair, order

if TYPE_CHECKING:
    import pandas as pd


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


def best_of(found: Sequence[ConfirmedPattern], finalists: Sequence[str]) -> ConfirmedPattern:
    """The finalist with the least mean error. Raises RunFailed where none was confirmed."""
    for one in found:
        if one.pattern in finalists:
            return one
    raise RunFailed("pattern-search: no finalist could be tracked on the gel")


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
    rows = np.column_stack((chosen_by_others(candidates), by_name[paper]))
    return estimate(rows, range(len(rows)), _ratio, "seed", "positive")


def ratio(a: ConfirmedPattern, b: ConfirmedPattern) -> Interval:
    """Mean error of one pattern over that of another, seed by seed, with its interval."""
    rows = np.column_stack((a.errors_mm, b.errors_mm))
    return estimate(rows, range(len(rows)), _ratio, "seed", "positive")


def chosen_by_others(errors: NDArray[np.float64]) -> NDArray[np.float64]:
    """For each seed the error of the pattern that the other seeds call best.

    errors: (patterns, seeds). With one seed, the best one.
    """
    n = errors.shape[1]
    if n == 1:
        return np.asarray(errors.min(axis=0))
    rest = errors.sum(axis=1, keepdims=True) - errors
    return np.asarray(errors[rest.argmin(axis=0), np.arange(n)])


def _ratio(rows: NDArray[np.float64]) -> float:
    return float(rows[:, 0].mean() / rows[:, 1].mean())


UM = 1000.0
RECIPE_SEED = 7
MIN_ORDERED = 6


@dataclass(frozen=True)
class Findings:
    """All that the two grids gave.

    frame: of candidates. order, sure_order, lost_order: of predictors, by the drag's error, by that
    of the pixels that the tracker is sure of, and by the share that it is not sure of. presses: by
    name. confirmations: by held-out seed, what `confirm` gave of each press.
    """

    bench: PatternImager
    rig: str
    seed: int
    scale: float | None
    size: Size
    protocol: Protocol
    among: tuple[Candidate, ...]
    frame: pd.DataFrame
    order: pd.DataFrame
    sure_order: pd.DataFrame
    lost_order: pd.DataFrame
    pair: Pair | None
    finalists: tuple[str, ...]
    paper: str
    shipped: str | None
    confirmed_names: tuple[str, ...]
    presses: tuple[str, ...]
    confirmations: tuple[Sequence[Mapping[str, Any]], ...]
    missing: tuple[str, ...]

    @cached_property
    def ours(self) -> list[ConfirmedPattern]:
        """With the default tracker, best first."""
        return confirmed(self.confirmations, self.confirmed_names, DEFAULT)[0]

    @cached_property
    def refused(self) -> dict[str, str]:
        """Patterns that could not be tracked on the gel, and why."""
        return confirmed(self.confirmations, self.confirmed_names, DEFAULT)[1]

    @cached_property
    def farneback(self) -> list[ConfirmedPattern]:
        """With the paper's own tracker."""
        return confirmed(self.confirmations, self.confirmed_names, FARNEBACK)[0]

    @cached_property
    def best(self) -> ConfirmedPattern:
        """The pattern to print. Raises RunFailed where no finalist was tracked."""
        return best_of(self.ours, self.finalists)

    @cached_property
    def gain(self) -> Interval | None:
        """Its error over that of the paper's pattern."""
        return gain(self.ours, self.finalists, self.paper)

    @cached_property
    def confirmed_order(self) -> pd.DataFrame | None:
        """Of predictors, by the error on the gel; None where too few patterns were confirmed."""
        errors = {one.pattern: one.error.value for one in self.ours}
        part = self.frame.assign(confirmed_mm=self.frame["pattern"].map(errors))
        return order(part, "confirmed_mm") if len(errors) >= MIN_ORDERED else None

    def of(self, found: list[ConfirmedPattern], name: str | None) -> ConfirmedPattern | None:
        """A confirmed pattern by its name."""
        return next((one for one in found if one.pattern == name), None)

    def row(self, name: str) -> dict[str, Any]:
        """A candidate's row of the table of the search."""
        row = self.frame[self.frame["pattern"] == name].iloc[0]
        return {str(column): value for column, value in row.items()}


def recipe_text(found: Findings) -> str:
    """The winner as a recipe file, with the figures that speak for it."""
    candidate = next(c for c in found.among if c.name == found.best.pattern)
    recipe = candidate.recipe(RECIPE_SEED).model_dump(mode="json", exclude_none=True)
    words = found.bench.words()
    about = [
        f"The best of {len(found.among)} patterns for this printer and camera, simulated:",
        f"{words['printer']};",
        f"{words['camera']}.",
        f"Mean error of the moving pixels {UM * found.best.error.value:.2g} µm"
        + (f", {found.gain.value:.2f} of that of the paper's d 0.075, r 0.6" if found.gain else "")
        + f" ({found.best.error.over}).",
        "Its seed may be any.",
    ]
    return as_toml({k: v for k, v in recipe.items() if (k, v) != ("channels", 3)}, about)
