"""How well a figure orders patterns by their error: rank correlation, its interval, a fair test.

Spearman's rank correlation; its 95 % interval by bootstrap over the patterns (percentiles; Efron
and Tibshirani 1993), which are no random sample of all patterns: it says how much the order hangs
on single ones of them.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Field = NDArray[np.float64]

RESAMPLES = 2000
LEVEL = 0.95


@dataclass(frozen=True)
class Rank:
    """rho in -1..1 with its 95 % interval, over n patterns."""

    rho: float
    low: float
    high: float
    n: int


@dataclass(frozen=True)
class Pair:
    """Two predictors whose mean rank orders patterns, and how it did on families it never saw.

    left_out: family -> (the two that the other families picked, rho within the family).
    held_out: of all patterns, each ordered by what the other families picked.
    """

    names: tuple[str, str]
    rho: float
    held_out: Rank
    left_out: dict[str, tuple[tuple[str, str], float]]


def ranks(values: Field) -> Field:
    """Ranks from 1 of values (n,), ties share their mean."""
    from scipy.stats import rankdata

    return np.asarray(rankdata(values), np.float64)


def spearman(a: Field, b: Field) -> float:
    """Rank correlation of values (n,); nan where one has no order."""
    x, y = ranks(a), ranks(b)
    x, y = x - x.mean(), y - y.mean()
    norm = float(np.sqrt((x @ x) * (y @ y)))
    return float(x @ y) / norm if norm > 0 else float("nan")


def with_interval(a: Field, b: Field, seed: int = 0) -> Rank:
    """Rank correlation of values (n,) with its interval. Raises ValueError for fewer than 4."""
    n = len(a)
    if n < 4:
        raise ValueError(f"{n} patterns; a rank correlation needs 4")
    rng = np.random.default_rng([seed, 4])
    drawn = (rng.integers(0, n, n) for _ in range(RESAMPLES))
    found = np.array([spearman(a[some], b[some]) for some in drawn])
    tail = (1 - LEVEL) / 2
    low, high = np.nanquantile(found, (tail, 1 - tail))
    return Rank(spearman(a, b), float(low), float(high), n)


def best_pair(
    predictors: Mapping[str, Field], error: Field, families: Sequence[str], seed: int = 0
) -> Pair:
    """The two predictors whose mean rank orders the patterns best, judged by leaving a family out.

    predictors: (n,) each; larger is worse. error: (n,). families: (n,) of the patterns. What is
    picked for a family is picked without it, so the held-out correlation is not flattered by the
    choice; that of the whole, `rho`, is.
    """
    family = np.array(families)
    left_out = {}
    expected = np.empty(len(error))
    for name in sorted(set(families)):
        out = family == name
        picked = _pick(predictors, error, ~out)
        # Among all patterns, so that one family's figures can be set beside another's.
        expected[out] = _mean_rank(predictors, picked)[out]
        left_out[name] = (picked, spearman(expected[out], error[out]))
    names = _pick(predictors, error, np.ones(len(error), bool))
    rho = spearman(_mean_rank(predictors, names), error)
    return Pair(names, rho, with_interval(expected, error, seed), left_out)


def _mean_rank(predictors: Mapping[str, Field], names: tuple[str, str]) -> Field:
    return np.asarray((ranks(predictors[names[0]]) + ranks(predictors[names[1]])) / 2)


def _pick(
    predictors: Mapping[str, Field], error: Field, some: NDArray[np.bool_]
) -> tuple[str, str]:
    part = {name: values[some] for name, values in predictors.items()}
    pairs = itertools.combinations(sorted(part), 2)
    return max(pairs, key=lambda names: spearman(_mean_rank(part, names), error[some]))
