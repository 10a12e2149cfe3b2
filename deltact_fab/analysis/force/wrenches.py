"""The wrench that was measured at each of a run's calibration points."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...aliases import Array
from ...errors import InputError
from ...record import Run
from ..frames import PRESSING, recorded, settles

if TYPE_CHECKING:
    import pandas as pd

WRENCH = ("fx_n", "fy_n", "fz_n", "tx_nmm", "ty_nmm", "tz_nmm")
WINDOW_S = 0.1
"""Force samples up to this long before and after a settled frame are averaged."""
_FEWEST = 3


def usable(run: Run) -> pd.DataFrame:
    """The frames of a run that force can be calibrated on. Raises InputError for any other."""
    frames = recorded(run, "force")
    if frames[list(WRENCH)].isna().any(axis=None):
        raise InputError(f"{run.folder}: no force was recorded; force needs the channel 'force'")
    return frames


def wrenches(run: Run, press: str, rows: pd.DataFrame) -> tuple[Array, Array]:
    """Wrench (n, 6) on the sensor at settled frames, N and N mm, and which were saturated (n,).

    Means of the force samples within WINDOW_S of each frame in its step, or as long as the protocol
    settles; the frame's own where there are not so many. What was measured at rest, before the
    press, is taken off: a tare has noise, and it drifts.
    """
    wrench = rows[list(WRENCH)].to_numpy(float).copy()
    saturated = np.zeros(len(rows), bool)
    samples = run.force(press)
    window_s = min(WINDOW_S, run.meta["protocol"]["capture"].get("settle_s") or 0.0)
    if run.format == 2 or not settles(rows) or not window_s:
        return wrench, saturated
    by_step = samples.groupby("step_id").indices
    values, at_s = samples[list(WRENCH)].to_numpy(float), samples["t_press_s"].to_numpy(float)
    over = samples["saturated"].to_numpy(bool)
    for k, (step, t_s) in enumerate(zip(rows["step_id"], rows["t_press_s"], strict=True)):
        own = by_step.get(step, np.zeros(0, int))
        near = own[np.abs(at_s[own] - t_s) <= window_s]
        if len(near) >= _FEWEST:
            wrench[k] = values[near].mean(0)
            saturated[k] = over[near].any()
    rest = ~rows["kind"].isin(PRESSING).to_numpy()
    if rest.any():
        wrench -= wrench[rest].mean(0)
    return wrench, saturated
