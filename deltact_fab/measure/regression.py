"""Linear least squares that says how far to believe it: y = X b, by QR with scaled columns.

Columns are first brought to length 1, so that a sum of cubes and a sum weigh the same; a column
that the ones before it already give is left out by name, never silently.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy import linalg, special

from ..aliases import Array
from ..errors import InputError

DEPENDENT = 1e-8  # share of a column's length that the columns before it must leave unexplained


@dataclass(frozen=True)
class RegressionFit:
    """One regression. Figures that do not exist are None: R2 of what never varies.

    names, coefficients (k,), intervals (k, 2): of all columns, in order; a column that was left
    out has coefficient 0 and no width. level: of the intervals: Student's t, as if rows erred
    independently; those of one press do not, so a press left out says more. dropped: the columns
    left out. notes: why, and what else a reader must know. samples, free: number of rows, and rows
    less columns kept. rmse: of the rows fitted, in the unit of y. r2, adjusted_r2: against a model
    that says 0, as there is no constant in this one (`statsmodels` says the same); against a model
    that says the mean, centred_r2 and adjusted_centred_r2, the sterner ones. condition_raw,
    condition_scaled: of the columns kept, as they came and with length 1.
    """

    names: tuple[str, ...]
    coefficients: tuple[float, ...]
    intervals: tuple[tuple[float, float], ...]
    level: float
    dropped: tuple[str, ...]
    notes: tuple[str, ...]
    samples: int
    free: int
    rmse: float
    r2: float | None
    adjusted_r2: float | None
    centred_r2: float | None
    adjusted_centred_r2: float | None
    condition_raw: float
    condition_scaled: float

    def predict(self, columns: Array) -> Array:
        """y of rows (n, k): (n,)."""
        return np.asarray(columns, float) @ np.asarray(self.coefficients)

    def as_dict(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        return asdict(self)


def least_squares(
    columns: Array, y: Array, names: Sequence[str], level: float = 0.95
) -> RegressionFit:
    """Fit y (n,) by columns (n, k), named; no constant is added.

    A column that is 0 throughout, or that the columns before it give, is left out and noted.
    Raises InputError for values that are not finite, with the column, and for no more rows than
    columns that count.
    """
    columns, y = np.asarray(columns, float), np.asarray(y, float)
    n, k = columns.shape
    if y.shape != (n,) or len(names) != k:
        raise ValueError(f"(n, k), (n,), k names: {columns.shape}, {y.shape}, {len(names)}")
    _check_finite(columns, y, names)
    length = np.linalg.norm(columns, axis=0)
    scaled = columns / np.where(length > 0, length, 1)
    kept, why = _independent(scaled, names)
    free = n - len(kept)
    if free < 1:
        raise InputError(
            f"regression: {n} rows for {len(kept)} columns; at least {len(kept) + 1} are needed"
        )
    q, r = np.linalg.qr(scaled[:, kept])
    b = np.zeros(k)
    b[kept] = linalg.solve_triangular(r, q.T @ y) / length[kept]
    left = y - columns @ b
    rss = float(left @ left)
    spread = np.zeros(k)
    inverse = linalg.solve_triangular(r, np.eye(len(kept)))
    spread[kept] = np.sqrt((inverse**2).sum(axis=1) * rss / free) / length[kept]
    half = spread * float(special.stdtrit(free, (1 + level) / 2))
    why += [
        f"{names[i]} is the same throughout: its coefficient is an offset"
        for i in kept
        if n > 1 and np.ptp(columns[:, i]) <= 1e-12 * abs(columns[0, i])
    ]
    if not y.any():
        why.append("y is 0 throughout: the coefficients say nothing")
    r2, adjusted = _r2(rss, float(y @ y), free, n)
    about_mean = y - y.mean()
    tss = float(about_mean @ about_mean)
    varies = tss > 1e-24 * float(y @ y)  # or the sum about the mean is but rounding
    centred, adjusted_centred = _r2(rss, tss if varies else 0.0, free, n - 1)
    return RegressionFit(
        tuple(names), tuple(map(float, b)),
        tuple((float(low), float(high)) for low, high in zip(b - half, b + half, strict=True)),
        level, tuple(name for i, name in enumerate(names) if i not in kept), tuple(why),
        n, free, float(np.sqrt(np.mean(np.square(left)))), r2, adjusted, centred, adjusted_centred,
        _condition(columns[:, kept]), _condition(scaled[:, kept]),
    )  # fmt: skip


def relative_leverage(columns: Array, fit: RegressionFit) -> Array:
    """How unlike the rows of a fit a row is: (k, k) that it is to be multiplied by.

    The squares of the product add up to the row's leverage over the largest among columns (n, k):
    1 for the most unusual row fitted, 0 for a row of zeros. A column that was left out has no say.
    """
    columns = np.asarray(columns, float)
    kept = [i for i, name in enumerate(fit.names) if name not in fit.dropped]
    out = np.zeros((len(fit.names), len(fit.names)))
    if kept:
        length = np.linalg.norm(columns[:, kept], axis=0)
        q, r = np.linalg.qr(columns[:, kept] / length)
        root = linalg.solve_triangular(r, np.eye(len(kept))) / length[:, None]
        out[np.ix_(kept, range(len(kept)))] = root / np.sqrt((q**2).sum(axis=1).max())
    return out


def _check_finite(columns: Array, y: Array, names: Sequence[str]) -> None:
    for name, values in (*zip(names, columns.T, strict=True), ("y", y)):
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise InputError(
                f"regression: {name}: row {bad[0]}: {values[bad[0]]} is not a finite number"
                + (f", nor are {bad.size - 1} more" if bad.size > 1 else "")
            )


def _independent(scaled: Array, names: Sequence[str]) -> tuple[list[int], list[str]]:
    """The columns that add something to those before them, and a line for each other one."""
    kept: list[int] = []
    why: list[str] = []
    basis = np.zeros((len(scaled), 0))
    for i, column in enumerate(scaled.T):
        rest = column - basis @ (basis.T @ column)
        rest = rest - basis @ (basis.T @ rest)  # twice is enough (Kahan)
        size = float(np.linalg.norm(rest))
        if size > DEPENDENT:
            kept.append(i)
            basis = np.column_stack((basis, rest / size))
        elif not column.any():
            why.append(f"{names[i]} is 0 throughout and left out")
        else:
            share = np.linalg.lstsq(scaled[:, kept], column, rcond=None)[0]
            of = [names[j] for j, s in zip(kept, share, strict=True) if abs(s) > 1e-6]
            why.append(f"{names[i]} is given by {', '.join(of)} and left out")
    return kept, why


def _r2(rss: float, tss: float, free: int, total_free: int) -> tuple[float | None, float | None]:
    if tss == 0:
        return None, None
    return 1 - rss / tss, 1 - (rss / free) / (tss / total_free)


def _condition(columns: Array) -> float:
    """Largest over smallest singular value; 1 without columns."""
    return float(np.linalg.cond(columns)) if columns.shape[1] else 1.0
