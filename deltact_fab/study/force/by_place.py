"""The paper's model of the normal force by distance from the axis, under readings of its text.

The paper prints that the density is "processed" and "non-negative", not how, and no constant; nor
does it print its nine places, which decide most of the error here.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from ...aliases import Array
from ...analysis.force import PAPER, ForceData, component
from ...analysis.force.judge import held_out, root_mean_square
from ...measure.regression import least_squares

DENSITIES = {"clipped": PAPER, "signed": f"{PAPER}-signed"}
SPLITS = {"at_random_n": "point", "by_press_n": "press", "by_place_n": "position"}


def by_place(data: ForceData, seed: int) -> pd.DataFrame:
    """A row a reading and distance: RMSE of the normal force there, N.

    alone_n: fitted to points of that distance only, a fifth of them left out at random. The others:
    fitted to all, by what was left out.
    """
    measured = component(data.wrench, "normal")
    away = np.round(np.hypot(*data.points[["x_mm", "y_mm"]].to_numpy(float).T), 2)
    rows = []
    for density, name in DENSITIES.items():
        use = [data.sets[name].names.index(one) for one in data.sets[name].explains["fz"]]
        for constant in (False, True):
            X = data.features[name][:, use]
            X = np.column_stack((X, np.ones(len(X)))) if constant else X

            def off(split: str, mine: Array, X: Array = X) -> Array:
                """Errors (repeats, m) of the points of a mask, by models of points of it."""
                X, y = X[mine], measured[mine]

                def predict(fitted: Array, judged: Array) -> Array:
                    labels = [str(k) for k in range(X.shape[1])]
                    return X[judged] @ least_squares(X[fitted], y[fitted], labels).coefficients

                points = data.points[mine].reset_index(drop=True)
                return held_out(points, y, split, seed, predict) - y

            every = np.full(len(X), True)
            held = {words: off(split, every) for words, split in SPLITS.items()}
            for distance in np.unique(away):
                mine = away == distance
                row = {
                    "density": density, "constant": constant, "distance_mm": distance,
                    "points": int(mine.sum()), "alone_n": root_mean_square(off("point", mine)),
                }  # fmt: skip
                rows.append(row | {w: root_mean_square(e[:, mine]) for w, e in held.items()})
    return pd.DataFrame(rows)
