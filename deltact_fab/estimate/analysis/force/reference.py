"""Change of the force over a run, by reference presses: the same press again and again."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deltact_fab.bench import Run
from deltact_fab.common import Array

from ..intervals import Interval
from ..runs import PRESS_KINDS, settled_rows
from .dataset import settled_wrenches


def reference_change(runs: Sequence[Run]) -> Interval | None:
    """Change of the normal force in % from a run's start to its end; None below two presses alike.

    Least-squares slope over the time of the stage's steps, which has no gap in a resumed run.
    Presses of one tip, place and depth share a mean; the slope is common.
    """
    series: dict[object, list[tuple[float, float]]] = {}
    for run in runs:
        steps = run.steps()
        elapsed_s = (steps["t_end_s"] - steps["t_start_s"]).cumsum()
        for press in (name for name, role in run.press_roles().items() if role == "reference"):
            frames, press_steps = settled_rows(run.frames(press)), steps[steps["press"] == press]
            normal_n = -settled_wrenches(run, press, frames)[0][:, 2]
            tip = (
                run.folder,
                *press_steps[["indenter", "x_mm", "y_mm"]].iloc[0],
                press_steps["z_mm"].min(),
            )
            force_n = float(normal_n[frames["kind"].isin(PRESS_KINDS)].mean())
            series.setdefault(tip, []).append(
                (elapsed_s[press_steps.index[0]] / elapsed_s.iloc[-1], force_n)
            )
    parts = [np.array(part) for part in series.values() if len(part) > 1]
    rows = [
        (share, 100 * force_n / part[:, 1].mean(), k)
        for k, part in enumerate(parts) for share, force_n in part
    ]  # fmt: skip
    return Interval.jackknife(rows, range(len(rows)), _common_slope, "press") if rows else None


def _common_slope(rows: Array) -> float:
    """Slope of the second column on the first, with an offset per value of the third."""
    codes = rows[:, 2].astype(int)
    counts = np.maximum(np.bincount(codes), 1)
    x, y = (c - (np.bincount(codes, c) / counts)[codes] for c in rows[:, :2].T)
    return float(x @ y / (x @ x))
