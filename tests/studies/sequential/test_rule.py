"""Rule of repeated looks: how often a goal counts as reached, by errors drawn on purpose."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import binom, chi2

from deltact_fab.studies.sequential.rule import FREEDOM_SHARE, OVERALL_LEVEL, look_level, upper_rms

SEQUENCES, PLACES = 200, (4, 6, 9, 12, 16, 20)
Draw = Callable[[np.random.Generator, int], np.ndarray]
# Errors of rms 1: alike, growing with a depth of 0.2 to 1, with long tails, and a constant one.
ERRORS: dict[str, Draw] = {
    "normal": lambda rng, n: rng.standard_normal(n),
    "by depth": lambda rng, n: rng.standard_normal(n) * rng.uniform(0.2, 1, n) / math.sqrt(0.4133),
    "student": lambda rng, n: rng.standard_t(6, n) / math.sqrt(1.5),
    "biased": lambda rng, n: 0.7 + math.sqrt(0.51) * rng.standard_normal(n),
}


def reached_after(errors: np.ndarray, goal: float) -> int | None:
    """Number of places at which a sequence ends as reached."""
    spent = 0
    for places in PLACES:
        level = look_level(places, spent, PLACES[-1])
        spent = places
        if upper_rms((errors[:places] ** 2).tolist(), level) < goal:
            return places
    return None


def ends(kind: str, rms: float, seed: int) -> list[int | None]:
    """Ends of SEQUENCES runs of a true rms, for a goal of 1."""
    rng = np.random.default_rng(seed)
    return [reached_after(rms * ERRORS[kind](rng, PLACES[-1]), 1.0) for _ in range(SEQUENCES)]


@pytest.mark.parametrize("kind", ERRORS)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_just_above_goal_rarely_ends(kind: str, seed: int) -> None:
    reached = [end for end in ends(kind, 1.001, seed) if end is not None]
    assert len(reached) <= 16
    assert len(reached) <= binom.ppf(0.999, SEQUENCES, OVERALL_LEVEL)


@pytest.mark.parametrize("kind", ERRORS)
def test_far_below_goal_ends_early(kind: str) -> None:
    found = ends(kind, 0.3, 1)
    reached = [end for end in found if end is not None]
    assert len(reached) >= 0.95 * SEQUENCES
    assert np.mean(reached) < 0.7 * PLACES[-1]


def test_uncorrected_looks_end_too_often() -> None:
    """The test above can fail: without spending, and for normal errors of unequal variance."""
    rng = np.random.default_rng(1)
    wrong = 0
    for _ in range(SEQUENCES):
        squares = (1.001 * ERRORS["by depth"](rng, PLACES[-1])) ** 2
        looks = [squares[:n].sum() / chi2.ppf(OVERALL_LEVEL, n) < 1 for n in PLACES]
        wrong += any(looks)
    assert wrong > 16


def test_levels_add_up_to_overall() -> None:
    spent = (0, *PLACES[:-1])
    levels = [look_level(n, m, PLACES[-1]) for n, m in zip(PLACES, spent, strict=True)]
    assert sum(levels) == pytest.approx(OVERALL_LEVEL)
    assert min(levels) > 0


def test_bound_is_a_quantile() -> None:
    squares, level = [0.04, 0.01, 0.09, 0.02, 0.0], 0.02
    freedom = FREEDOM_SHARE * 5
    wanted = math.sqrt(0.032 * freedom / chi2.ppf(level, freedom))
    assert upper_rms(squares, level) == pytest.approx(wanted, rel=1e-9)
    assert upper_rms(squares, 0.2) < wanted
    assert upper_rms([4 * s for s in squares], level) == pytest.approx(2 * wanted)
