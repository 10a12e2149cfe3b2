"""The rests of a recorded run: the force from the end of a motion until the next one starts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from ...aliases import Field
from ...errors import InputError
from ...record import Run
from ..frames import PRESSING, settle_s

BIN_S = 0.02  # samples are averaged over it: one of 1 kHz has seven times the noise
ARRIVED_MM = 0.01  # a stage that reports this near its end has arrived
MIN_BINS = 25  # of a rest that says anything


@dataclass(frozen=True, eq=False)
class ForceHistory:
    """All forces of one press, averaged: force_n (n, 3) at t_s (n,), BIN_S apart, from its tare."""

    press: str
    t_s: Field
    force_n: Field


@dataclass(frozen=True, eq=False)
class Rest:
    """One stop of a press. at: its bins in the way, a slice. kind: press or shear."""

    way: ForceHistory
    step_id: str
    kind: str
    depth_mm: float
    at: slice

    @property
    def wait_s(self) -> Field:
        """(n,) since the first of them, at most 0.1 s after the tip came to rest."""
        t = self.way.t_s[self.at]
        return np.asarray(t - t[0])

    @property
    def force_n(self) -> Field:
        """(n, 3) on the sensor."""
        return self.way.force_n[self.at]


def rests(run: Run) -> list[Rest]:
    """The rests of all presses and drags that settled, in order.

    Raises InputError for a run without a force stream or without a stop that rests long enough.
    """
    longest_s = max(settle_s(run, kind) for kind in PRESSING)
    if not longest_s:
        raise InputError(f"{run.folder}: its protocol has no settle_s: no stop rests")
    steps = run.steps()
    found: list[Rest] = []
    for press, own in steps[steps["kind"].isin(PRESSING)].groupby("press", sort=False):
        samples = run.force(str(press))
        if not len(samples):
            raise InputError(f"{run.folder}: press {press}: no force was recorded")
        way = _binned(str(press), samples)
        pose = run.pose(str(press))
        settled = set(run.frames(str(press)).query("settled")["step_id"])
        for step in own[own["step_id"].isin(settled)].itertuples():
            rest = _rest(way, step, samples, pose, settle_s(run, str(step.kind)))
            if rest is not None:
                found.append(rest)
    if not found:
        raise InputError(
            f"{run.folder}: no stop rests for {MIN_BINS * BIN_S:g} s or more: settle_s = "
            f"{longest_s:g}"
        )
    return found


def _binned(press: str, samples: pd.DataFrame) -> ForceHistory:
    t = samples["t_press_s"].to_numpy()
    bins = np.floor((t - t[0]) / BIN_S).astype(int)
    counts = np.bincount(bins)
    middle = t[0] + (np.arange(len(counts)) + 0.5) * BIN_S
    held = counts > 0
    forces = []
    for name in ("fx_n", "fy_n", "fz_n"):
        sums = np.bincount(bins, samples[name].to_numpy())
        forces.append(np.interp(middle, middle[held], sums[held] / counts[held]))
    return ForceHistory(press, middle, np.stack(forces, axis=1))


def _rest(
    way: ForceHistory, step: object, samples: pd.DataFrame, pose: pd.DataFrame, rests_s: float
) -> Rest | None:
    """From the first report of the stage at its end; without reports, from the plan's time."""
    row = step._asdict()  # type: ignore[attr-defined]
    origin_s = float((samples["t_s"] - samples["t_press_s"]).iloc[0])
    start_s = row["t_start_s"] + row["planned_s"] - origin_s
    reports = pose[pose["step_id"] == row["step_id"]]
    if len(reports):
        off = reports[["x_mm", "y_mm", "z_mm"]].to_numpy() - [row["x_mm"], row["y_mm"], row["z_mm"]]
        away = np.flatnonzero(np.linalg.norm(off, axis=1) > ARRIVED_MM)
        first = int(away[-1]) + 1 if len(away) else 0
        if first == len(reports):
            return None  # it was cut short
        start_s = max(start_s, float(reports["t_press_s"].iloc[first - 1 if first else 0]))
    first, last = np.searchsorted(way.t_s, [start_s + BIN_S, start_s + rests_s])
    if last - first < MIN_BINS:
        return None
    return Rest(way, row["step_id"], row["kind"], -float(row["z_mm"]), slice(int(first), int(last)))
