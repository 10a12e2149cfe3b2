"""Linear least squares that says how far to believe it: y = X b, by QR with scaled columns.

Columns are first brought to length 1, so that a sum of cubes and a sum weigh the same; a column
that the ones before it already give is left out by name, never silently.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy import linalg, special

from deltact_fab.common import Array, InputError

DEPENDENT = 1e-8  # share of a column's length that the columns before it must leave unexplained
MIN_PRESSES = 10  # for intervals: the spread of fewer is itself not known


@dataclass(frozen=True)
class RegressionFit:
    """One regression. Figures that do not exist are None: R2 of what never varies.

    names, coefficients (k,): of all columns, in order; a column that was left out has 0. prior: the
    columns that were held at 0, and how firmly: this times the coefficient was one more error,
    in the unit of y; nothing below counts it but the conditions. intervals (k, 2): of a share
    `level`, clustered by press (CR1, Student's t of presses - 1); None of fewer than MIN_PRESSES
    presses. dropped: the columns left out. notes: why, and what else a reader must know. samples,
    free: number of rows, and rows less columns kept. rmse: of the rows fitted, in the unit of y.
    r2, adjusted_r2: against a model that says the mean; r2_about_zero, adjusted_r2_about_zero:
    against one that says 0, which `statsmodels` prints where there is no constant. condition_raw,
    condition_scaled: of the columns kept, as they came and with length 1.
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

    presses (n,): whose rows err together; without, there are no intervals. prior: as of
    `RegressionFit`. A column that is 0 throughout, or that the columns before it give, is left out
    and noted. Raises InputError for values that are not finite, with the column, and for no more
    rows than columns that count.
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
        notes.append(f"no intervals: {MIN_PRESSES} presses are needed, and there are {len(groups)}")
    else:
        # What each press moves the coefficients by; their squares add up to the sandwich.
        influence = np.zeros((len(groups), len(basis)))
        np.add.at(influence, press, residual[:, None] * linalg.solve_triangular(r, q[:n].T).T)
        small_sample = len(groups) / (len(groups) - 1) * (n - 1) / free
        half = np.zeros(k)
        half[basis] = np.sqrt(small_sample * (influence**2).sum(axis=0)) / length[basis]
        half *= float(special.stdtrit(len(groups) - 1, (1 + level) / 2))
    notes += [
        f"{names[i]} is the same throughout: its coefficient is an offset"
        for i in basis
        if n > 1 and np.ptp(columns[:, i]) <= 1e-12 * abs(columns[0, i])
    ]
    if not y.any():
        notes.append("y is 0 throughout: the coefficients say nothing")
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
    """How unlike the rows of a fit a row is: (k, k) that it is to be multiplied by.

    The squares of the product add up to the row's leverage over the largest among columns (n, k):
    1 for the most unusual row fitted, 0 for a row of zeros. A column that was left out has no say.
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
    """The columns that add something to those before them, and a line for each other one."""
    chosen: list[int] = []
    notes: list[str] = []
    basis = np.zeros((len(scaled), 0))
    for i, column in enumerate(scaled.T):
        rest = column - basis @ (basis.T @ column)
        rest = rest - basis @ (basis.T @ rest)  # twice is enough (Kahan)
        size = float(np.linalg.norm(rest))
        if size > DEPENDENT:
            chosen.append(i)
            basis = np.column_stack((basis, rest / size))
        elif not column.any():
            notes.append(f"{names[i]} is 0 throughout and left out")
        else:
            share = np.linalg.lstsq(scaled[:, chosen], column, rcond=None)[0]
            sources = [names[j] for j, s in zip(chosen, share, strict=True) if abs(s) > 1e-6]
            notes.append(f"{names[i]} is given by {', '.join(sources)} and left out")
    return chosen, notes


def _r2(rss: float, tss: float, free: int, total_free: int) -> tuple[float | None, float | None]:
    if tss == 0:
        return None, None
    return 1 - rss / tss, 1 - (rss / free) / (tss / total_free)


def _condition(columns: Array) -> float:
    """Largest over smallest singular value; 1 without columns."""
    return float(np.linalg.cond(columns)) if columns.shape[1] else 1.0
