"""How many presses a calibration needs."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ...errors import InputError
from .dataset import ForceData
from .judge import FORCES, fit, force_error_n, rmse

SIZES = (1, 2, 3, 5, 8, 12, 20, 30, 40)
DRAWS = 12
MAX_SHARE = 0.8
"""Of the presses, the most that are used: what is left must judge."""
ENOUGH = 1.1
"""The error that counts as no worse, over that from the most presses."""


@dataclass(frozen=True)
class LearningPoint:
    """Errors on the presses that were left out, when so many were used; root mean squares of draws.

    force_error_n: of the force's length; low, high: 10th and 90th percentile over draws. None where
    no draw could be fitted: the points are fewer than the parameters.
    """

    presses: int
    draws: int
    force_error_n: float | None
    low_n: float | None
    high_n: float | None
    normal_n: float | None
    shear_x_n: float | None
    shear_y_n: float | None


def learning_curve(data: ForceData, name: str, seed: int) -> list[LearningPoint]:
    """Fit to a few presses drawn at random and judge by all others, for growing numbers of them."""
    of = data.points["press"].to_numpy()
    presses = np.array(list(dict.fromkeys(of)))
    rng = np.random.default_rng(seed)
    curve = []
    most = min(max(1, round(MAX_SHARE * len(presses))), len(presses) - 1)
    for size in sorted({s for s in (*SIZES, most) if 0 < s <= most}):
        rows = []
        for _ in range(DRAWS):
            used = np.isin(of, rng.permutation(presses)[:size])
            try:
                model = fit(data, name, used)
            except InputError:
                continue
            seen, truth = model.predict(data.features[name][~used]), data.wrench[~used]
            rows.append([force_error_n(seen, truth), *(rmse(seen, truth, c) for c in FORCES)])
        if not rows:
            curve.append(LearningPoint(size, 0, *[None] * 6))
            continue
        errors = np.array(rows, float)
        force, *each = np.sqrt(np.mean(errors**2, axis=0)).tolist()
        low, high = np.percentile(errors[:, 0], (10, 90)).tolist()
        curve.append(LearningPoint(size, len(rows), force, low, high, *each))
    return curve


def enough(curve: list[LearningPoint]) -> int | None:
    """The fewest presses whose error is within a tenth of the last one's; None where none is."""
    known = [point for point in curve if point.force_error_n is not None]
    for point in known:
        if point.force_error_n <= ENOUGH * known[-1].force_error_n:  # type: ignore[operator]
            return point.presses
    return None


def as_rows(curve: list[LearningPoint]) -> list[dict[str, Any]]:
    """Plain data."""
    return [asdict(point) for point in curve]
