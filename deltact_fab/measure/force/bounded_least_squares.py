"""Least squares with unknowns that may not be positive: a gel is pressed and never pulled."""

from __future__ import annotations

import numpy as np
from scipy import linalg

from ...aliases import Array

MAX_STEPS = 200
PATIENCE = 3


def least_squares_signed(matrix: Array, right: Array, signed: Array) -> Array:
    """The t (n,) that makes t' matrix t / 2 - right' t least, with t <= 0 where signed (n,) bool.

    matrix (n, n): symmetric, positive definite. Raises ArithmeticError where rounding keeps it from
    an end, which has not been seen.
    """
    # Those without a sign go first and once; the search is then among the others only.
    a, b = np.flatnonzero(~signed), np.flatnonzero(signed)
    lower = linalg.cholesky(matrix[np.ix_(a, a)], lower=True, overwrite_a=True, check_finite=False)
    both = np.column_stack((matrix[np.ix_(a, b)], right[a]))
    both = linalg.solve_triangular(lower, both, lower=True, overwrite_b=True, check_finite=False)
    across, known = both[:, :-1], both[:, -1]
    t = np.empty(len(right))
    t[b] = _not_positive(matrix[np.ix_(b, b)] - across.T @ across, right[b] - across.T @ known)
    t[a] = linalg.solve_triangular(
        lower, known - across @ t[b], lower=True, trans="T", check_finite=False
    )
    return t


def _not_positive(matrix: Array, right: Array) -> Array:
    """The same for unknowns that all have the sign, by block principal pivoting.

    All that break a condition change sides at once, and one alone where that does not help
    (Portugal, Judice and Vicente 1994).
    """
    free = np.ones(len(right), bool)
    least, patience = len(right) + 1, PATIENCE
    slack = 1e-9 * float(np.abs(right).max(initial=0.0))
    for _ in range(MAX_STEPS):
        t = np.zeros(len(right))
        at = np.flatnonzero(free)
        t[at] = linalg.solve(
            matrix[np.ix_(at, at)], right[at], assume_a="pos", overwrite_a=True, check_finite=False
        )
        pull = matrix @ t - right
        wrong = np.flatnonzero((free & (t > 0)) | (~free & (pull > slack)))
        if not wrong.size:
            return t
        if wrong.size < least:
            least, patience = wrong.size, PATIENCE
        elif patience:
            patience -= 1
        else:
            wrong = wrong[-1:]
        free[wrong] = ~free[wrong]
    raise ArithmeticError(f"signed least squares: {wrong.size} of {len(right)} undecided")
