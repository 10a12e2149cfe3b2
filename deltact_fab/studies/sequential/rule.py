"""Rule of repeated looks: a goal for an rms error is shown, with one error rate for all looks.

At a look the model fitted so far is tested on n places to validate, each with its mean square error
m (errors at one place are correlated, so a place counts once). With s the rms of that model over
such places, n mean(m) / s^2 has a lower quantile of at least that of chi-square / share with
share * n degrees of freedom, share = 2 / (k - 1), for errors of kurtosis k (Satterthwaite,
Biometrics Bulletin 2, 1946, 110); normal errors of equal variance have 3. So the upper bound of s
at a level holds in all but this share of looks. A look's level is its share of the overall level by
the places that it adds to those of the list (linear spending: Lan and DeMets, Biometrika 70, 1983,
659), and levels are added (Bonferroni), so that it does not matter how the looks depend on each
other or that the model is fitted anew: of all runs whose error is not below the goal at any look,
at most OVERALL_LEVEL end as "reached". Assumed: places to validate are drawn like those of the
later use, independent of the model, and the looks are planned before the run.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

OVERALL_LEVEL = 0.05  # by hand: one run in twenty that ends too early at most
FREEDOM_SHARE = 2 / 3
"""Of kurtosis 4: more than 3, as errors grow with depth; error rates: decision 0089."""
MIN_LOOK_PLACES = 4  # decision 0038: fewer groups have no interval


def upper_rms(squares: Sequence[float], level: float) -> float:
    """Upper bound of an rms error at a one-sided level, from mean squares of places."""
    from scipy.special import gammaincinv

    freedom = FREEDOM_SHARE * len(squares)
    quantile = 2 * float(gammaincinv(freedom / 2, level))
    return math.sqrt(sum(squares) / len(squares) * freedom / quantile)


def look_level(places: int, spent: int, planned: int) -> float:
    """Level of a look at places, after looks at `spent` of them; planned: those of the list."""
    return OVERALL_LEVEL * (places - spent) / planned
