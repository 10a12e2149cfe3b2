"""Change of the force over a run, by reference presses: the same press again and again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from deltact_fab.bench import Run
from deltact_fab.common import Array

from ..intervals import Interval
from ..runs import PRESS_KINDS, settled_rows
from .dataset import presses, settled_wrenches


@dataclass(frozen=True)
class ReferenceChange:
    """Change of the measured normal force from the start of a run to its end.

    presses: number of reference presses. percent: of the mean force, with its interval.
    """

    presses: int
    percent: Interval

    @property
    def line(self) -> str:
        change = f"normal force changed by {self.percent.format('%')} over the run"
        return f"reference: {change} ({self.percent.over})"

    def as_dict(self) -> dict[str, Any]:
        return {"presses": self.presses, "percent": self.percent._asdict()}


def reference_change(runs: Sequence[Run]) -> ReferenceChange | None:
    """Least-squares slope over time of the forces of reference presses; None below two alike.

    Time is that of the stage's steps, so that a resumed run has no gap. Presses of one tip, place
    and depth share a mean; the slope is common.
    """
    rows = []
    for number, run in enumerate(runs):
        steps = run.steps()
        elapsed_s = (steps["t_end_s"] - steps["t_start_s"]).cumsum()
        for press in presses(run, "reference"):
            frames, own = settled_rows(run.frames(press)), steps[steps["press"] == press]
            normal_n = -settled_wrenches(run, press, frames)[0][:, 2]
            tip = (number, own["indenter"].iloc[0], own["x_mm"].iloc[0], own["y_mm"].iloc[0])
            rows.append(
                {
                    "at": elapsed_s[own.index[0]] / elapsed_s.iloc[-1],
                    "normal_n": normal_n[frames["kind"].isin(PRESS_KINDS)].mean(),
                    "series": str((*tip, own["z_mm"].min())),
                }
            )
    table = pd.DataFrame(rows, columns=["at", "normal_n", "series"])
    table = table[table.groupby("series")["at"].transform("size") > 1]
    if table.empty:
        return None
    mean_n = table.groupby("series")["normal_n"].transform("mean")
    table["percent"] = 100 * table["normal_n"] / mean_n
    codes = np.unique(table["series"], return_inverse=True)[1]
    values = np.column_stack((table["at"], table["percent"], codes))
    return ReferenceChange(
        len(rows), Interval.jackknife(values, range(len(table)), _common_slope, "press")
    )


def _common_slope(rows: Array) -> float:
    """Slope of the second column on the first, with an offset per value of the third."""
    codes = rows[:, 2].astype(int)
    counts = np.maximum(np.bincount(codes), 1)
    x, y = (c - (np.bincount(codes, c) / counts)[codes] for c in rows[:, :2].T)
    return float(x @ y / (x @ x))
