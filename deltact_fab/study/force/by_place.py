"""The paper's model of the normal force by distance from the axis, under readings of its text.

The paper prints that the density is "processed" and "non-negative", not how, and no constant; nor
does it print its nine places, which decide most of the error here.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from ...aliases import Array
from ...analysis.force import PAPER, ForceResult, component
from ...analysis.force.judge import held_out, root_mean_square
from ...measure.regression import least_squares

DENSITIES = {"clipped": PAPER, "signed": f"{PAPER}-signed"}
SPLITS = {"at_random_n": "point", "by_press_n": "press", "by_place_n": "position"}


def by_place(result: ForceResult) -> pd.DataFrame:
    """A row a reading and distance, and of the best model: RMSE of the normal force there, N.

    alone_n: fitted to points of that distance only, a fifth of them left out at random. The others:
    fitted to all, by what was left out.
    """
    data, best = result.data, result.best
    measured = component(data.wrench, "normal")
    away = np.round(np.hypot(*data.points[["x_mm", "y_mm"]].to_numpy(float).T), 2)

    def off(X: Array, split: str, mine: Array) -> Array:
        """Errors (repeats, m) of the points of a mask, by models of points of it."""
        X, y, points = X[mine], measured[mine], data.points[mine].reset_index(drop=True)
        labels = [str(k) for k in range(X.shape[1])]

        def predict(fitted: Array, judged: Array) -> Array:
            return X[judged] @ least_squares(X[fitted], y[fitted], labels).coefficients

        return held_out(points, y, split, result.seed, predict) - y

    models: list[tuple[dict[str, str], Array | None, dict[str, Array]]] = []
    for density, name in DENSITIES.items():
        use = [data.sets[name].names.index(one) for one in data.sets[name].explains["fz"]]
        for constant in ("without", "with"):
            X = data.features[name][:, use]
            X = np.column_stack((X, np.ones(len(X)))) if constant == "with" else X
            held = {column: off(X, of, away >= 0) for column, of in SPLITS.items()}
            models.append(({"model": f"paper, {density}", "constant": constant}, X, held))
    held = {c: component(best.predicted[of], "normal") - measured for c, of in SPLITS.items()
            if of in best.predicted}  # fmt: skip
    models.append(({"model": best.name}, None, held))
    rows = []
    for words, columns, held in models:
        for distance in np.unique(away):
            mine = away == distance
            row = {**words, "distance_mm": distance, "points": int(mine.sum())}
            if columns is not None:
                row["alone_n"] = root_mean_square(off(columns, "point", mine))
            rows.append(row | {c: root_mean_square(each[:, mine]) for c, each in held.items()})
    return pd.DataFrame(rows)
