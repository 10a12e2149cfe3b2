"""Where a model's error comes from, of the points themselves: what is left out, and refits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...analysis.force import FORCES, ForceData, ForceResult, component, fit
from ...analysis.force.judge import Judged
from ...errors import InputError

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[Any]
BIASED = 0.5
"""Of the square of an error, from which on its mean over a group is most of it."""


def error(judged: Judged, data: ForceData, left_out: str, name: str) -> Array:
    """Predicted less measured (n,) of a component of `FORCES`, N; left_out: a key of predicted."""
    return component(judged.predicted[left_out], name) - component(data.wrench, name)


def by_group(result: ForceResult, models: dict[str, Judged]) -> pd.DataFrame:
    """Error on each position and indenter when it was left out, a row a model, group and force."""
    import pandas as pd

    rows = []
    for label, judged in models.items():
        for group in ("position", "indenter"):
            if group not in judged.predicted:
                continue
            of = result.data.points[group].to_numpy()
            for value in dict.fromkeys(of):
                for name in FORCES:
                    off = error(judged, result.data, group, name)[of == value]
                    measured = component(result.data.wrench, name)[of == value]
                    rows.append(
                        {
                            "model": label, "left_out": group, "which": value, "force": name,
                            "points": len(off), "rmse_n": float(np.sqrt(np.mean(off**2))),
                            "mean_error_n": float(off.mean()),
                            "gain": _gain(off, measured),
                        }
                    )  # fmt: skip
    return pd.DataFrame(rows)


def _gain(off: Array, measured: Array) -> float | None:
    """Slope of predicted on measured through 0."""
    size = float(measured @ measured)
    return None if size == 0 else 1 + float(off @ measured) / size


def parts(result: ForceResult, name: str) -> pd.DataFrame:
    """A feature set fitted to all points, and to one place or one indenter alone; RMSE in N.

    What a part alone is fitted to better than the whole is what the model cannot say of all.
    """
    import pandas as pd

    data = result.data
    x, y = data.points["x_mm"], data.points["y_mm"]
    place = "(" + x.map("{:g}".format) + ", " + y.map("{:g}".format) + ")"
    groups = {"all points": place.map(lambda _: ""), "one place": place,
              "one indenter": data.points["indenter"]}  # fmt: skip
    rows = []
    for words, of in groups.items():
        off = np.full((len(data), 3), np.nan)
        for value in dict.fromkeys(of):
            mine = (of == value).to_numpy()
            try:
                model = fit(data, name, mine)
            except InputError:
                continue
            off[mine] = (model.predict(data.features[name][mine]) - data.wrench[mine])[:, :3]
        if np.isnan(off).any():
            continue
        fx, fy, fz = np.sqrt(np.mean(off**2, axis=0)).tolist()
        rows.append({"fitted_to": words, "fits": len(set(of)), "normal_n": fz, "shear_x_n": fx,
                     "shear_y_n": fy})  # fmt: skip
    return pd.DataFrame(rows)


def why_missed(table: pd.DataFrame, model: str, left_out: str, name: str) -> str:
    """Of a goal that a model misses: which group is worst, and whether it is a wrong factor."""
    rows = table[
        (table["model"] == model) & (table["left_out"] == left_out) & (table["force"] == name)
    ]
    worst = max(rows.to_dict(orient="records"), key=lambda row: float(row["rmse_n"]))
    rmse_n, mean_n, gain = worst["rmse_n"], worst["mean_error_n"], worst["gain"]
    text = f"worst at {worst['which']}: {rmse_n:.2f} N"
    if gain is not None and mean_n**2 > BIASED * rmse_n**2:
        text += f", {mean_n:+.2f} N of it the same for all (gain {gain:.2f})"
    return text
