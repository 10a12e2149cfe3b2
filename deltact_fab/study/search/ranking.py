"""How well a figure orders patterns by their error: rank correlation, its interval, a fair test.

Spearman's rank correlation. Its interval is drawn over kinds of pattern (one law and one patch
size), since those that differ in colour or in a scale alone err together; and the candidates are no
random sample of all patterns, so it says how much the order hangs on single kinds of them.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...aliases import Field
from ..intervals import Interval, estimate


@dataclass(frozen=True)
class Pair:
    """Two predictors whose mean rank orders patterns, and how it did on families it never saw.

    rho: of all patterns, by the pair that they picked themselves. held_out: of all patterns, each
    ordered by what the other families picked. left_out: family -> (their pick, rho within it).
    """

    names: tuple[str, str]
    rho: float
    held_out: Interval
    left_out: dict[str, tuple[tuple[str, str], float]]


def ranks(values: Field) -> Field:
    """Ranks from 1 of values (n,), ties share their mean."""
    from scipy.stats import rankdata

    return np.asarray(rankdata(values), np.float64)


def spearman(a: Field, b: Field) -> float:
    """Rank correlation of values (n,); nan where one has no order."""
    x, y = (ranks(v) - (len(v) + 1) / 2 for v in (a, b))
    norm = float(np.sqrt((x @ x) * (y @ y)))
    return min(1.0, max(-1.0, float(x @ y) / norm)) if norm > 0 else float("nan")


def rank_correlation(a: Field, b: Field, kinds: Sequence[str]) -> Interval:
    """Rank correlation of values (n,) with its 95 % interval over kinds of pattern (n,).

    Raises InputError where one has no order.
    """

    def statistic(rows: Field) -> float:
        return spearman(rows[:, 0], rows[:, 1])

    return estimate(np.column_stack((a, b)), kinds, statistic, "kind", "correlation")


def best_pair(
    predictors: Mapping[str, Field],
    error: Field,
    families: Sequence[str],
    kinds: Sequence[str],
) -> Pair:
    """The two predictors whose mean rank orders the patterns best, judged by leaving a family out.

    predictors: (n,) each, larger is worse. error: (n,). What is picked for a family is picked
    without it, so the held-out correlation is not flattered by the choice; `rho` is.
    """
    family = np.array(families)
    left_out = {}
    expected = np.empty(len(error))
    for name in sorted(set(families)):
        out = family == name
        picked = _pick(predictors, error, ~out)
        # Ranked among all patterns, so that one family's figures can be set beside another's.
        expected[out] = mean_rank(predictors, picked)[out]
        left_out[name] = (picked, spearman(expected[out], error[out]))
    names = _pick(predictors, error, np.ones(len(error), bool))
    rho = spearman(mean_rank(predictors, names), error)
    return Pair(names, rho, rank_correlation(expected, error, kinds), left_out)


def mean_rank(predictors: Mapping[str, Field], names: Sequence[str]) -> Field:
    """Mean of the ranks (n,) of some predictors."""
    return np.asarray(np.mean([ranks(predictors[name]) for name in names], axis=0))


def _pick(
    predictors: Mapping[str, Field], error: Field, some: NDArray[np.bool_]
) -> tuple[str, str]:
    part = {name: values[some] for name, values in predictors.items()}
    pairs = itertools.combinations(sorted(part), 2)
    return max(pairs, key=lambda names: spearman(mean_rank(part, names), error[some]))
