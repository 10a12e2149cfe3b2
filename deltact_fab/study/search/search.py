"""The grid over candidates as tables: predictors and errors, and which predict which.

Spearman's rank correlation. Its interval is drawn over kinds of pattern (one law and one patch
size), since those that differ in colour or in a scale alone err together; and the candidates are no
random sample of all patterns, so it says how much the order hangs on single kinds of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ...aliases import Field
from ...errors import RunFailed
from ..intervals import Interval, estimate
from .candidates import Candidate


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


@dataclass(frozen=True)
class Predictor:
    """A column of the table of candidates. worse: 1 where more of it is worse, else -1."""

    column: str
    words: str
    worse: int
    by_tracker: bool


PREDICTORS = (
    Predictor("mean_gradient", "mean intensity gradient", -1, False),
    Predictor("sssig", "SSSIG", -1, False),
    Predictor("contrast_0", "contrast", -1, False),
    Predictor("contrast_3", "contrast at pyramid level 3", -1, False),
    Predictor("contrast_4", "contrast at pyramid level 4", -1, False),
    Predictor("peak", "secondary peak", 1, False),
    Predictor("bias_px", "bias, mean", 1, True),
    Predictor("local_bias_px", "bias, at a place", 1, True),
    Predictor("noise_px", "noise", 1, True),
    Predictor("resolution_px", "spatial resolution", 1, True),
)
ERROR, LEAP = "error_mm", "leap_error_mm"
ERRORS = (ERROR, "coverage", "bridged_mm", LEAP, "leap_coverage")
MIN_COVERAGE = 0.9
"""Share of the moving pixels that a pattern's tracker must be sure of, to be recommended."""
MIN_BRIDGED_MM = 0.39
"""Twice the step between frames that the protocols have: a press may be quicker than planned."""


def table(
    found: Mapping[str, Sequence[dict[str, Any]]], among: Sequence[Candidate]
) -> pd.DataFrame:
    """A row a candidate, means over seeds, of `bridged_mm` the least; `refused`: why it has none.

    found: what `probe` returned by candidate's name, a value a seed. Raises RunFailed where nothing
    is left to compare with the paper's pattern.
    """
    rows = []
    for c in among:
        values = found.get(c.name, ())
        keys = dict(c.keys)
        row: dict[str, Any] = {
            "pattern": c.name,
            "family": c.family,
            "patch_mm": keys["patch_mm"],
            "kind": f"{c.family} {keys['patch_mm']:g}",
            "seeds": len(values),
            "refused": next((v["refused"] for v in values if "refused" in v), ""),
        }
        whole = [v for v in values if "refused" not in v]
        if whole and not row["refused"]:
            for column in (*(p.column for p in PREDICTORS), *ERRORS):
                row[column] = float(np.mean([v[column] for v in whole]))
            row["bridged_mm"] = min(v["bridged_mm"] for v in whole)
            sure = [v["confident_error_mm"] for v in whole if v["confident_error_mm"] is not None]
            row["confident_error_mm"] = float(np.mean(sure)) if sure else None
        elif not values:
            row["refused"] = "no result"
        rows.append(row)
    frame = pd.DataFrame(rows)
    if ERROR not in frame or frame[ERROR].notna().sum() < 4:
        raise RunFailed("pattern-search: fewer than 4 candidates could be tracked: nothing to rank")
    return frame.sort_values(ERROR, na_position="last", ignore_index=True)


def order(frame: pd.DataFrame, error: str = ERROR) -> pd.DataFrame:
    """A row a predictor: its rank correlation with an error, over the rows that have both.

    Signed so that 1 says: what it calls better is better.
    """
    known = frame[frame[error].notna()]
    rows = []
    for p in PREDICTORS:
        values = p.worse * known[p.column].to_numpy(float)
        if np.ptp(values) == 0:  # there is no order in it
            continue
        rho = rank_correlation(values, known[error].to_numpy(float), list(known["kind"]))
        rows.append({"predictor": p.words, "column": p.column, "rho": rho.value, "low": rho.low,
                     "high": rho.high, "over": rho.over, "patterns": len(known),
                     "needs_tracker": p.by_tracker})  # fmt: skip
    return pd.DataFrame(rows).sort_values("rho", ascending=False, ignore_index=True)


def finalists(frame: pd.DataFrame, count: int) -> list[str]:
    """The best of different kinds that can be recommended; fewer where there are no more."""
    sure = (frame["coverage"] >= MIN_COVERAGE) & (frame["bridged_mm"] >= MIN_BRIDGED_MM)
    return list(frame[frame[ERROR].notna() & sure].drop_duplicates("kind")["pattern"])[:count]


def spread(frame: pd.DataFrame, taken: Sequence[str], count: int) -> list[str]:
    """Others, evenly over the order of the search, so that the order itself is confirmed."""
    others = [name for name in frame[frame[ERROR].notna()]["pattern"] if name not in taken]
    if count <= 0 or not others:
        return []
    at = np.linspace(0, len(others) - 1, min(count, len(others)) + 2)[1:-1]
    return [others[i] for i in dict.fromkeys(np.rint(at).astype(int).tolist())]
