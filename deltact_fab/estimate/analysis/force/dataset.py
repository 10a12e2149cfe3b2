"""Training points of force models: features of settled frames, and their measured wrenches."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from deltact_fab.bench import Run, open_run
from deltact_fab.common import Array, InputError, Progress, SolverError, Store, cache_key, run_each

from ...measure.face import FaceFlow
from ...measure.force import make_features
from ...measure.force.model import Features
from ...measure.sensor_id import SensorModel
from ..flows import flow_key, settled_flows
from ..runs import PRESS_KINDS, has_rests, head_of, read_frames, settle_s, settled_rows, view_of_run

WRENCH_COLUMNS = ("fx_n", "fy_n", "fz_n", "tx_nmm", "ty_nmm", "tz_nmm")
# Half width of the mean around a settled frame; by hand: longer has less noise, and some motion.
FORCE_WINDOW_S = 0.1
_MIN_SAMPLES = 3  # in the window, for a mean; by hand: fewer is no better than the frame's own


def settled_wrenches(run: Run, press: str, rows: pd.DataFrame) -> tuple[Array, Array]:
    """Wrench (n, 6) on the sensor at settled frames, N and N mm, and which were saturated (n,).

    Means of the force samples within FORCE_WINDOW_S of each frame and the settling time of its
    step; the frame's own sample where there are too few. The mean at rest, before the press, is
    subtracted: the tare is noisy and drifts.
    """
    wrench = rows[list(WRENCH_COLUMNS)].to_numpy(float).copy()
    saturated = np.zeros(len(rows), bool)
    samples = run.force(press)
    windows_s = {kind: min(FORCE_WINDOW_S, settle_s(run, kind)) for kind in rows["kind"].unique()}
    if not has_rests(rows) or not any(windows_s.values()):
        return wrench, saturated
    by_step = samples.groupby("step_id").indices
    values = samples[list(WRENCH_COLUMNS)].to_numpy(float)
    at_s = samples["t_press_s"].to_numpy(float)
    out_of_range = samples["saturated"].to_numpy(bool)
    places = zip(rows["step_id"], rows["kind"], rows["t_press_s"], strict=True)
    for k, (step, kind, t_s) in enumerate(places):
        in_step = by_step.get(step, np.zeros(0, int))
        near = in_step[np.abs(at_s[in_step] - t_s) <= windows_s[kind]]
        if len(near) >= _MIN_SAMPLES:
            wrench[k] = values[near].mean(0)
            saturated[k] = out_of_range[near].any()
    rest = ~rows["kind"].isin(PRESS_KINDS).to_numpy()
    if rest.any():
        wrench -= wrench[rest].mean(0)
    return wrench, saturated


TIME_STRETCHES = 10  # folds of an imported run, of unknown presses; by hand: more are more alike
MIN_FORCE_COVER = 0.7  # tracked share of the view in a point; by hand: higher drops deep drags
_GEL_KEYS = ("gel_model", "modulus_mpa", "poisson", "prony")


@dataclass(frozen=True)
class ForceData:
    """Training points of one sensor.

    points: one row per point: run, indenter, position (label, the same for all mirror images),
    x_mm, y_mm of the press, press, role of the press (without it: fit), frame_id, cover, wait_s
    since the motion ended. wrench: (n, 6)
    on the sensor about the centre of the resting face, N and N mm. features: (n, k) by name of
    the feature set, sets: the sets. notes: one line per reason for skipped frames.
    """

    points: pd.DataFrame
    wrench: Array
    features: dict[str, Array]
    sets: dict[str, Features]
    notes: list[str]

    def __len__(self) -> int:
        return len(self.points)

    def has_role(self, role: str) -> Array:
        """Mask (n,) of the points of presses of a role."""
        if "role" not in self.points:
            return np.full(len(self), role == "fit")
        return (self.points["role"] == role).to_numpy()

    def of_role(self, role: str) -> ForceData:
        """Points of the presses of a role."""
        return self.select(self.has_role(role))

    def select(self, rows: Array) -> ForceData:
        """Points of a mask (n,)."""
        return replace(
            self,
            points=self.points[rows].reset_index(drop=True),
            wrench=self.wrench[rows],
            features={name: values[rows] for name, values in self.features.items()},
        )


@dataclass(frozen=True)
class PressPoints:
    """The points of one press, as in `ForceData`; refused: the reason for each skipped frame."""

    rows: pd.DataFrame
    wrench: Array
    features: dict[str, Array]
    refused: list[str]


def open_force_runs(folders: Sequence[Path]) -> tuple[list[Run], list[pd.DataFrame]]:
    """Open runs of one sensor for a force calibration, with their tables of frames.

    Raises InputError for an unfinished run, one without images or force, runs of several sensors
    or simulated gels, and a folder given twice.
    """
    runs = [open_run(folder) for folder in folders]
    places = Counter(run.folder.resolve() for run in runs)
    if twice := [str(place) for place, n in places.items() if n > 1]:
        raise InputError(f"{twice[0]}: given twice; give each run once")
    tables = [read_frames(run, "force") for run in runs]
    for run, frames in zip(runs, tables, strict=True):
        unread = frames[list(WRENCH_COLUMNS)].isna()
        # An imported run may lack components: those are not calibrated.
        if unread.all(axis=None) if run.imported else unread.any(axis=None):
            raise InputError(f"{run.folder}: no force recorded; needs the channel 'force'")
    head_of(runs, "force")
    gels = [{k: run.meta["protocol"]["specimen"].get(k) for k in _GEL_KEYS} for run in runs]
    for run, gel in zip(runs, gels, strict=True):
        unlike = [f"{k} {v!r}, not {gels[0][k]!r}" for k, v in gel.items() if v != gels[0][k]]
        if unlike and run.simulated:
            raise InputError(f"{run.folder}: gel differs from {folders[0]}: {'; '.join(unlike)}")
    return runs, tables


def presses(run: Run) -> list[str]:
    """Names of a run's presses, in order; without its table of frames, which is slow to read."""
    steps = run.frames() if run.imported else run.steps()
    return list(dict.fromkeys(steps.loc[steps["kind"] != "change", "press"]))


def run_labels(runs: Sequence[Run]) -> list[str]:
    """Unique labels of runs: their folders' names, full paths where two have one name."""
    places = [run.folder.resolve() for run in runs]
    short = len({place.name for place in places}) == len(places)
    return [place.name if short else str(place) for place in places]


def gather_data(
    runs: Sequence[Run],
    names: Sequence[str],
    executor: Executor | None = None,
    progress: Progress | None = None,
    view: SensorModel | None = None,
) -> ForceData:
    """Gather the points of runs for named feature sets, without those of reference presses.

    Raises InputError without a usable frame.

    view: sensor model, None: as the runs describe it.
    """
    view = view or view_of_run(runs[0])
    jobs = [
        (str(run.folder), label, press)
        for run, label in zip(runs, run_labels(runs), strict=True)
        for roles in (run.press_roles(),)
        for press in presses(run)
        if roles.get(press) != "reference"
    ]
    titles = [press for _, _, press in jobs]
    work = partial(_measure_job, names=tuple(names), view=view)
    parts = run_each(work, jobs, titles, executor, progress)
    return gather_points(parts, names, view, str(runs[0].folder))


def point_flows(runs: Sequence[Run], data: ForceData) -> Iterator[FaceFlow]:
    """Yield the flow of each point that `gather_data` took from these runs, press by press."""
    of_run = dict(zip(run_labels(runs), runs, strict=True))
    for (label, press), part in data.points.groupby(["run", "press"], sort=False):
        run, name = of_run[str(label)], str(press).removeprefix(f"{label}/")
        frames = settled_rows(run.frames(name))["frame_id"].tolist()
        flows = settled_flows(run, name, FaceFlow.SPACING_PX)
        for frame_id in part["frame_id"]:
            yield flows[frames.index(frame_id)]


def gather_points(
    parts: Sequence[PressPoints], names: Sequence[str], view: SensorModel, source: str
) -> ForceData:
    """Gather presses of one sensor into one set of points; source: prefix of an error's message.

    Raises InputError without a usable frame.
    """
    sets = {name: make_features(name, view) for name in names}
    points = pd.concat([part.rows for part in parts], ignore_index=True)
    refused = Counter(reason for part in parts for reason in part.refused)
    total = len(points) + refused.total()
    notes = [f"{n} of {total} frames: {reason}" for reason, n in refused.items()]
    if points.empty:
        raise InputError(f"{source}: no usable frame: {'; '.join(notes) or 'no frames'}")
    features = {n: np.concatenate([part.features[n] for part in parts]) for n in names}
    wrench = np.concatenate([part.wrench for part in parts])
    return ForceData(points, wrench, features, sets, notes)


def _measure_job(job: tuple[str, str, str], names: Sequence[str], view: SensorModel) -> PressPoints:
    """Measure the points of a press; job: the run's folder, its label, and the press."""
    folder, label, press = job
    return measure_force_points(open_run(folder), label, press, names, view)


def measure_force_points(
    run: Run, label: str, press: str, names: Sequence[str], view: SensorModel | None = None
) -> PressPoints:
    """Measure the force points of one press of a run that has images and force.

    label: the run's name in the points. view: sensor model, None: as the run describes it.
    Raises as `settled_flows` does.
    """
    view = view or view_of_run(run)
    rows = settled_rows(run.frames(press))
    wrench, saturated = settled_wrenches(run, press, rows)
    no_force = np.zeros(len(rows), bool)
    if run.imported:  # components that were not measured stay 0, which calibrates nothing
        no_force = rows["force_skew_s"].to_numpy(float) > FORCE_WINDOW_S
        # The flow counts from the first image, and so must the force.
        wrench -= wrench[(rows["t_press_s"] <= FORCE_WINDOW_S).to_numpy()].mean(0)
        wrench[:, np.isnan(wrench).all(axis=0)] = 0.0
    sets = [make_features(name, view) for name in names]
    flows, key = settled_flows(run, press, FaceFlow.SPACING_PX), flow_key(run, press)
    refused = ["" for _ in range(len(rows))]
    for k, flow in enumerate(flows):
        if saturated[k]:
            refused[k] = "force sensor saturated"
        elif no_force[k]:
            refused[k] = f"no force sample within {FORCE_WINDOW_S:g} s"
        elif not flow.trusted:
            refused[k] = "flow not trusted"
        elif flow.cover < MIN_FORCE_COVER:
            refused[k] = f"less than {MIN_FORCE_COVER:.0%} of the view tracked"
    values: dict[str, Array] = {}
    for features in sets:
        values[features.name] = _compute_features(features, view, flows, key)
        for k in np.flatnonzero(np.isnan(values[features.name][:, 0])).tolist():
            refused[k] = refused[k] or f"{features.name} found no solution"
    accepted = np.array([not reason for reason in refused])
    steps = run.steps()
    press_label: Any = f"{label}/{press}"
    if run.imported:
        x_mm = y_mm = np.nan
        stretch = TIME_STRETCHES * np.arange(len(rows)) // len(rows)
        press_label = [f"{press_label}/{k}" for k in stretch]
    else:
        first = steps[steps["press"] == press].iloc[0]  # its target: where the press goes down
        x_mm, y_mm = (round(float(first[name]), 3) + 0.0 for name in ("x_mm", "y_mm"))
    table = rows[["frame_id", "indenter"]].assign(
        run=label,
        press=press_label,
        role=run.press_roles().get(press, "fit"),
        # Mirror images are one position: a mirror-symmetric model has seen all in any of them.
        position=Run.UNKNOWN if run.imported else f"({abs(x_mm):g}, {abs(y_mm):g})",
        x_mm=x_mm,
        y_mm=y_mm,
        cover=[flow.cover for flow in flows],
        # Time since the motion ended: the label depends on it through the gel's relaxation.
        wait_s=rows["t_step_s"] - rows["step_id"].map(steps.set_index("step_id")["planned_s"]),
    )
    return PressPoints(
        table[accepted].reset_index(drop=True),
        wrench[accepted],
        {name: array[accepted] for name, array in values.items()},
        [reason for reason in refused if reason],
    )


def _compute_features(
    features: Features, view: SensorModel, flows: Sequence[FaceFlow], key_of_flows: str
) -> Array:
    """Features (n, k) of the flows of a press (see `flow_key`), cached; nan: no solution."""
    gel = (view.skin, view.poisson) if features.rests_on_gel else ()
    key = cache_key(
        type(features).__module__.partition(".")[2],
        of=key_of_flows,
        every_px=FaceFlow.SPACING_PX,
        by=features.name,
        view=repr((view.camera.as_dict(), gel)),
    )
    store = Store("features")
    values: Array | None = store.read(key)
    if values is None:
        values = np.full((len(flows), len(features.names)), np.nan)
        for k, flow in enumerate(flows):
            with suppress(SolverError):
                if flow.trusted:
                    values[k] = features.compute(flow)
        store.write(key, values)
    return values
