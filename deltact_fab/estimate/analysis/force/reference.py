"""Change of the force over a run, by reference presses: the same press again and again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from deltact_fab.bench import Run
from deltact_fab.common import Array

from ..intervals import Interval
from ..runs import PRESS_KINDS, settled_rows
from .dataset import settled_wrenches


def reference_change(runs: Sequence[Run]) -> Interval | None:
    """Change of the normal force in % from a run's start to its end; as `common_change`.

    Least-squares slope over the time of the stage's steps, which has no gap in a resumed run. A
    group is presses of one tip, place and depth.
    """
    rows = []
    for run in runs:
        steps, shares = run.steps(), press_shares(run)
        for press in (name for name, role in run.press_roles().items() if role == "reference"):
            frames, press_steps = settled_rows(run.frames(press)), steps[steps["press"] == press]
            normal_n = -settled_wrenches(run, press, frames)[0][:, 2]
            place = press_steps[["indenter", "x_mm", "y_mm"]].iloc[0]
            force_n = float(normal_n[frames["kind"].isin(PRESS_KINDS)].mean())
            tip = (run.folder, *place, press_steps["z_mm"].min())
            rows.append((tip, shares[press], force_n))
    return common_change(rows)


def press_shares(run: Run) -> dict[str, float]:
    """Beginning of each press, by name, as a share of the time of the stage's steps."""
    steps = run.steps()
    elapsed_s = (steps["t_end_s"] - steps["t_start_s"]).cumsum()
    begins = steps[steps["kind"] != "change"].groupby("press", sort=False).head(1)
    return {
        str(press): float(elapsed) / float(elapsed_s.iloc[-1])
        for press, elapsed in zip(begins["press"], elapsed_s[begins.index], strict=True)
    }


def common_change(rows: Sequence[tuple[tuple[Any, ...], float, float]]) -> Interval | None:
    """Change in % over a run of figures of reference presses; None below two presses a group.

    rows: group, share of the run, figure. Figures of a group share a mean; the slope is common.
    """
    table = pd.DataFrame(rows, columns=["tip", "share", "figure"])
    groups = table.groupby("tip", sort=False)
    table["figure"] *= 100 / groups["figure"].transform("mean")
    table = table.assign(tip=groups.ngroup())[groups["tip"].transform("size") > 1]
    count = len(table)
    return Interval.jackknife(table, range(count), _common_slope, "press") if count else None


def _common_slope(rows: Array) -> float:
    """Slope of the third column on the second, with an offset per value of the first."""
    tip, share, percent = rows.T
    columns = np.column_stack((share, tip[:, None] == np.unique(tip)))
    return float(np.linalg.lstsq(columns, percent, rcond=None)[0][0])
