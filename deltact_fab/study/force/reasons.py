"""Where a model's error comes from, shown by leaving points out and fitting again."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ...aliases import Array
from ...analysis.force import FORCES, ForceData, ForceResult, component, fit
from ...analysis.force.judge import EvaluatedModel
from ...errors import InputError
from ...measure.force import ForceModel

ALL, STRAIGHT = "all points", "stops without shear"


def error(judged: EvaluatedModel, data: ForceData, left_out: str, name: str) -> Array:
    """Predicted less measured (n,) of a component of `FORCES`, N; left_out: a key of predicted."""
    return component(judged.predicted[left_out], name) - component(data.wrench, name)


def by_group(result: ForceResult, models: dict[str, EvaluatedModel]) -> pd.DataFrame:
    """Error on each position and indenter when it was left out, a row a model, group and force.

    gain: slope of predicted on measured through 0.
    """
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
                    size = float(measured @ measured)
                    rows.append(
                        {
                            "model": label, "left_out": group, "which": value, "force": name,
                            "points": len(off), "rmse_n": float(np.sqrt(np.mean(off**2))),
                            "mean_error_n": float(off.mean()),
                            "gain": 1 + float(off @ measured) / size if size else np.nan,
                        }
                    )  # fmt: skip
    return pd.DataFrame(rows)


def parts(result: ForceResult, name: str) -> pd.DataFrame:
    """A feature set fitted to all points and to parts of them alone; RMSE and mean error in N.

    What a part alone is fitted to better than the whole is what the model cannot say of all. Rows
    are of the points fitted to, but for the last: stops with shear, by the fit to those without.
    """
    data = result.data
    x, y = data.points["x_mm"], data.points["y_mm"]
    sheared = data.points["frame_id"].str.split("/").str[-1].str.startswith("shear")
    every = pd.Series("", index=data.points.index)
    groups = {
        ALL: every,
        "one place": "(" + x.map("{:g}".format) + ", " + y.map("{:g}".format) + ")",
        "one indenter": data.points["indenter"],
        "one press": data.points["press"],
        STRAIGHT: every.mask(sheared, None),
    }
    rows = []
    for words, of in groups.items():
        off = np.full((len(data), 3), np.nan)
        kept = of.notna().to_numpy()
        for value in of[kept].unique():
            mine = (of == value).to_numpy()
            model = _fitted(data, name, mine)
            if model is not None:
                off[mine] = (model.predict(data.features[name][mine]) - data.wrench[mine])[:, :3]
        if not np.isnan(off[kept]).any():
            rows.append(_row(words, "the same", of.nunique(), off[kept]))
    straight = _fitted(data, name, ~sheared.to_numpy())
    if straight is not None and sheared.any():
        at = sheared.to_numpy()
        off = (straight.predict(data.features[name][at]) - data.wrench[at])[:, :3]
        rows.append(_row(STRAIGHT, "stops with shear", 1, off))
    return pd.DataFrame(rows)


def _fitted(data: ForceData, name: str, rows: Array) -> ForceModel | None:
    try:
        return fit(data, name, rows)
    except InputError:
        return None


def _row(fitted_to: str, judged_on: str, fits: int, off: Array) -> dict[str, Any]:
    fx, fy, fz = np.sqrt(np.mean(off**2, axis=0)).tolist()
    if fitted_to == STRAIGHT:  # they have no shear to fit to
        fx = fy = None
    mean_n = -float(off[:, 2].mean())
    return {"fitted_to": fitted_to, "judged_on": judged_on, "fits": fits, "points": len(off),
            "normal_n": fz, "shear_x_n": fx, "shear_y_n": fy, "normal_mean_n": mean_n}  # fmt: skip


def under_shear(judged: EvaluatedModel, data: ForceData) -> tuple[float, float] | None:
    """How much normal force varies at one depth of a press, where only shear changes, N.

    Measured, and as the model says it: standard deviations about the mean of the stops there. None
    where no depth has several stops.
    """
    depth = data.points["run"] + data.points["frame_id"].str.rsplit("/", n=1).str[0]
    said = component(judged.predicted["test"], "normal")
    table = pd.DataFrame(
        {"depth": depth, "measured": component(data.wrench, "normal"), "said": said}
    )
    several = table[table.groupby("depth")["depth"].transform("size") > 1]
    if several.empty:
        return None
    about = several[["measured", "said"]] - several.groupby("depth").transform("mean")
    measured_n, said_n = np.sqrt((about**2).mean()).tolist()
    return measured_n, said_n


def why_not_the_papers(result: ForceResult, refits: pd.DataFrame, name: str) -> str:
    """Of the paper's model off by more than the paper has: what it cannot tell apart."""
    wanted = ("one place", "one indenter", "one press")
    own = [row for row in refits.to_dict(orient="records") if row["fitted_to"] in wanted]
    said = [f"{row[f'{name}_n']:.2f} N fitted to {row['fitted_to']} alone" for row in own]
    text = ", ".join(said)
    varies = under_shear(result.paper, result.data) if name == "normal" else None
    if varies is not None:
        text += (
            f"; at one depth of a press, where only shear changes, the normal force varies by "
            f"{varies[0]:.2f} N and the model's by {varies[1]:.2f} N: shear changes the sums of "
            "a density that is never negative"
        )
    return text


def why_missed(table: pd.DataFrame, model: str, left_out: str, name: str) -> str:
    """Of a goal that is missed: the worst group, is it a wrong factor, what was it fitted to."""
    rows = table[
        (table["model"] == model) & (table["left_out"] == left_out) & (table["force"] == name)
    ]
    worst = rows.iloc[int(np.argmax(rows["rmse_n"]))]
    return (
        f"worst at {worst['which']}: {worst['rmse_n']:.2f} N, {worst['mean_error_n']:+.2f} N of it "
        f"the same for all (gain {worst['gain']:.2f}); fitted to the {len(rows) - 1} others"
    )
