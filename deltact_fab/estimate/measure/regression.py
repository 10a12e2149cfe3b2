"""Linear least squares with intervals and diagnostics: y = X b, by QR with scaled columns.

Columns are first scaled to length 1, so that a sum of cubes and a sum weigh the same; a column
that depends linearly on those before it is dropped and named.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy import linalg, special

from deltact_fab.common import Array, InputError

DEPENDENT_SHARE = 1e-8  # least unexplained part of a column; by hand: well above rounding
MIN_PRESSES = 10  # for intervals; by hand: the spread of fewer is itself uncertain


@dataclass(frozen=True)
class RegressionFit:
    """Result of a regression. Undefined figures are None, such as R2 of a constant.

    names, coefficients (k,): of all columns, in order; a dropped column has 0. prior: weight of a
    ridge on a coefficient, by column: weight times coefficient is one more residual, in the unit
    of y; only the conditions below include it. intervals (k, 2): confidence intervals at `level`,
    clustered by press (CR1, Student's t of presses - 1); None with fewer than MIN_PRESSES presses.
    dropped: columns without effect on the fit. notes: reasons and remarks. samples, free: number
    of rows, and rows less independent columns. rmse: over the rows fitted, in the unit of y.
    r2, adjusted_r2: relative to predicting the mean; r2_about_zero, adjusted_r2_about_zero:
    relative to predicting 0, as `statsmodels` prints without a constant. condition_raw,
    condition_scaled: of the independent columns, unscaled and with length 1.
    """

    names: tuple[str, ...]
    coefficients: tuple[float, ...]
    prior: Mapping[str, float]
    intervals: tuple[tuple[float, float], ...] | None
    level: float
    presses: int
    dropped: tuple[str, ...]
    notes: tuple[str, ...]
    samples: int
    free: int
    rmse: float
    r2: float | None
    adjusted_r2: float | None
    r2_about_zero: float | None
    adjusted_r2_about_zero: float | None
    condition_raw: float
    condition_scaled: float


def least_squares(
    columns: Array,
    y: Array,
    names: Sequence[str],
    presses: Sequence[str] = (),
    prior: Mapping[str, float] = MappingProxyType({}),
    level: float = 0.95,
) -> RegressionFit:
    """Fit y (n,) by columns (n, k), named; no constant is added.

    presses (n,): cluster of each row; without it there are no intervals. prior: see
    `RegressionFit`. A column of zeros, or one that depends on those before it, is dropped and
    noted. Raises InputError for values that are not finite, with the column, and for fewer rows
    than independent columns plus one.
    """
    columns, y = np.asarray(columns, float), np.asarray(y, float)
    n, k = columns.shape
    if y.shape != (n,) or len(names) != k or len(presses) not in (0, n):
        shapes = f"{columns.shape}, {y.shape}, {len(names)}, {len(presses)}"
        raise ValueError(f"(n, k), (n,), k names, n presses: {shapes}")
    _check_finite(columns, y, names)
    prior_rows = [np.where(np.array(names) == name, firm, 0.0) for name, firm in prior.items()]
    rows = np.vstack((columns, *prior_rows))
    length = np.linalg.norm(rows, axis=0)
    scaled = rows / np.where(length > 0, length, 1)
    basis, notes = _select_independent(scaled, names)
    free = n - len(basis)
    if free < 1:
        raise InputError(
            f"regression: {n} rows for {len(basis)} columns; at least {len(basis) + 1} are needed"
        )
    q, r = np.linalg.qr(scaled[:, basis])
    b = np.zeros(k)
    b[basis] = linalg.solve_triangular(r, q[:n].T @ y) / length[basis]
    residual = y - columns @ b
    rss = float(residual @ residual)
    groups, press = np.unique(np.asarray(presses), return_inverse=True)
    half = None
    if len(groups) < MIN_PRESSES:
        notes.append(f"no intervals: {MIN_PRESSES} presses are needed (got {len(groups)})")
    else:
        # Influence of each press on the coefficients; the squares sum to the sandwich estimate.
        influence = np.zeros((len(groups), len(basis)))
        np.add.at(influence, press, residual[:, None] * linalg.solve_triangular(r, q[:n].T).T)
        small_sample = len(groups) / (len(groups) - 1) * (n - 1) / free
        half = np.zeros(k)
        half[basis] = np.sqrt(small_sample * (influence**2).sum(axis=0)) / length[basis]
        half *= float(special.stdtrit(len(groups) - 1, (1 + level) / 2))
    notes += [
        f"{names[i]} is constant: its coefficient is an offset"
        for i in basis
        if n > 1 and np.ptp(columns[:, i]) <= 1e-12 * abs(columns[0, i])
    ]
    if not y.any():
        notes.append("y is zero everywhere: the coefficients are meaningless")
    about_mean = y - y.mean()
    tss = float(about_mean @ about_mean)
    varies = tss > 1e-24 * float(y @ y)  # or the sum about the mean is but rounding
    return RegressionFit(
        tuple(names), tuple(map(float, b)), dict(prior),
        None if half is None else tuple(zip((b - half).tolist(), (b + half).tolist(), strict=True)),
        level, len(groups), tuple(name for i, name in enumerate(names) if i not in basis),
        tuple(notes), n, free, float(np.sqrt(np.mean(np.square(residual)))),
        *_r2(rss, tss if varies else 0.0, free, n - 1), *_r2(rss, float(y @ y), free, n),
        _condition(rows[:, basis]), _condition(scaled[:, basis])
    )  # fmt: skip


def relative_leverage(columns: Array, fit: RegressionFit) -> Array:
    """Return the matrix (k, k) that maps a row to its relative leverage in a fit.

    The squares of row @ matrix sum to the row's leverage over the largest among columns (n, k):
    1 for the most unusual row fitted, 0 for a row of zeros. Dropped columns are ignored.
    """
    columns = np.asarray(columns, float)
    basis = [i for i, name in enumerate(fit.names) if name not in fit.dropped]
    out = np.zeros((len(fit.names), len(fit.names)))
    if basis:
        length = np.linalg.norm(columns[:, basis], axis=0)
        q, r = np.linalg.qr(columns[:, basis] / length)
        root = linalg.solve_triangular(r, np.eye(len(basis))) / length[:, None]
        out[np.ix_(basis, range(len(basis)))] = root / np.sqrt((q**2).sum(axis=1).max())
    return out


def _check_finite(columns: Array, y: Array, names: Sequence[str]) -> None:
    for name, values in (*zip(names, columns.T, strict=True), ("y", y)):
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise InputError(
                f"regression: {name}: row {bad[0]}: {values[bad[0]]} is not a finite number"
                + (f", nor are {bad.size - 1} more" if bad.size > 1 else "")
            )


def _select_independent(scaled: Array, names: Sequence[str]) -> tuple[list[int], list[str]]:
    """Return indices of linearly independent columns, and a note for each dropped one."""
    chosen: list[int] = []
    notes: list[str] = []
    basis = np.zeros((len(scaled), 0))
    for i, column in enumerate(scaled.T):
        rest = column - basis @ (basis.T @ column)
        rest = rest - basis @ (basis.T @ rest)  # twice is enough (Kahan)
        size = float(np.linalg.norm(rest))
        if size > DEPENDENT_SHARE:
            chosen.append(i)
            basis = np.column_stack((basis, rest / size))
        elif not column.any():
            notes.append(f"{names[i]} is zero and was dropped")
        else:
            share = np.linalg.lstsq(scaled[:, chosen], column, rcond=None)[0]
            sources = [names[j] for j, s in zip(chosen, share, strict=True) if abs(s) > 1e-6]
            notes.append(f"{names[i]} depends on {', '.join(sources)} and was dropped")
    return chosen, notes


def _r2(rss: float, tss: float, free: int, total_free: int) -> tuple[float | None, float | None]:
    if tss == 0:
        return None, None
    return 1 - rss / tss, 1 - (rss / free) / (tss / total_free)


def _condition(columns: Array) -> float:
    """Ratio of largest to smallest singular value; 1 without columns."""
    return float(np.linalg.cond(columns)) if columns.shape[1] else 1.0
