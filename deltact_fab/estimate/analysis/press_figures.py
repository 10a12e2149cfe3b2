"""Measures of a press that runs are compared by, and their figures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from deltact_fab.bench import Run, open_run
from deltact_fab.common import InputError, Progress, Store, cache_key, run_each

from ..measure.face import fit_rigid_motion
from ..measure.flow.renewed import FUSED_METHOD
from ..measure.force.inverse import Inverse
from .flows import flow_key, open_follower
from .force.dataset import ForceData, gather_data, open_force_runs
from .force.judge import FORCE_SPLITS, fit_force, predict_left_out
from .force.reference import common_change, press_shares, reference_change
from .intervals import Interval
from .runs import read_frames
from .shape.press import measure_press
from .shape.run import UNCALIBRATED_DEPTH
from .tracking_error.follow import TrackingPlan, analyse_press

MIN_CHANGE = 0.1  # by hand: factor that a change leaves of a figure, at least
PressFigures = dict[str, float]
"""Figure of each press, by its name."""


@dataclass(frozen=True)
class Measure:
    """Figure of a press that sides are compared by, small if good.

    analyse: figures of a run's presses, by a tracking method. power: of the mean over presses, 2
    for a root mean square.
    """

    meaning: str
    unit: str
    analyse: Callable[[Run, Sequence[str], str], PressFigures]
    power: int = 1

    def over_presses(self, figures: Iterable[float]) -> float:
        """Mean of the figures, or their root mean square."""
        return float(np.mean(np.power([*figures], self.power)) ** (1 / self.power))

    @staticmethod
    def require(name: str, size: tuple[float, str], option: str) -> Measure:
        """Return the measure of a name. Raises InputError for a size neither in % nor its unit."""
        measure = COMPARED_MEASURES[name]
        if size[1] not in ("%", measure.unit):
            text = f"{name} is in {measure.unit}; or use %"
            raise InputError(f"{option} {size[0]:g}{size[1]}: {text}")
        return measure


_FIGURE_STORE = Store("compared")


def stored_figures(folder: Path, measure: str, method: str) -> PressFigures | None:
    """Result of `press_figures` in the cache; None if it is not there."""
    figures: PressFigures | None = _FIGURE_STORE.read(_key(open_run(folder), measure, method))
    return figures


def press_figures(folder: Path, measure: str, method: str) -> PressFigures:
    """Figures of a run's presses, without reference presses and the change that they show.

    Raises InputError, naming the run, without the images, truth or force that the measure needs.
    """
    run = open_run(folder)
    figures = COMPARED_MEASURES[measure].analyse(run, _presses(run), method)
    if not figures:
        raise InputError(f"{folder}: no press to compare by {measure}")
    _FIGURE_STORE.write(_key(run, measure, method), figures)
    return figures


def run_figures(
    folders: Sequence[Path], measure: str, method: str | None = None,
    executor: Executor | None = None, progress: Progress | None = None,
) -> dict[Path, PressFigures]:  # fmt: skip
    """Figures of runs, from the cache or by `press_figures`. method: None for the fused tracker."""
    method = method or FUSED_METHOD
    stored = {folder: stored_figures(folder, measure, method) for folder in folders}
    new = [folder for folder, figures in stored.items() if figures is None]
    analyse = partial(press_figures, measure=measure, method=method)
    parts = run_each(analyse, new, [str(folder) for folder in new], executor, progress)
    figures = dict(zip(new, parts, strict=True))
    return {folder: figures.get(folder) or stored[folder] or {} for folder in folders}


def mean_interval(run: Run, measure: str, relative: bool) -> Interval:
    """Mean of a run's figures with its interval over places; that of their logarithms if relative.

    Raises InputError as `press_figures` does.
    """
    figures = run_figures([run.folder], measure)[run.folder]
    places = {row["name"]: (row["x_mm"], row["y_mm"]) for row in run.meta["presses"]}
    values = np.array([*figures.values()])
    values = np.log(values) if relative else values
    return Interval.mean(values, [places[press] for press in figures], "place")


def _presses(run: Run) -> list[str]:
    return [str(press) for press in read_frames(run, "comparison")["press"].unique()]


def _key(run: Run, measure: str, method: str) -> dict[str, Any]:
    return cache_key(
        __name__.partition(".")[2], run=run.id, measure=measure, method=method,
        truth=run.truth() is not None, flows=[flow_key(run, press) for press in _presses(run)],
    )  # fmt: skip


def _tracking(run: Run, presses: Sequence[str], method: str, figure: str = "") -> PressFigures:
    plan = TrackingPlan.for_run(run, [method])
    figure = figure or ("mean_off_dots_mm" if run.truth() else "mean_at_dots_mm")
    parts = {press: analyse_press(str(run.folder), press, plan) for press in presses}
    figures = {press: part.tallies[method].figures()[figure] for press, part in parts.items()}
    if all(value is None for value in figures.values()):
        raise InputError(f"{run.folder}: no tracking error: neither truth nor dots in the record")
    return _without_change(run, {k: v for k, v in figures.items() if v is not None})


def _depth(run: Run, presses: Sequence[str], method: str) -> PressFigures:
    if run.truth() is None:
        raise InputError(f"{run.folder}: no truth of the depth; compare tracking or force")
    figures = {}
    for press in presses:
        rows = measure_press(run.folder, press, UNCALIBRATED_DEPTH).rows
        errors = [row["depth_error_contact_mm"] for row in rows if row["tip_depth_mm"] > 0]
        if errors:
            figures[press] = float(np.mean(errors))
    return _without_change(run, figures)


def _noise(run: Run, presses: Sequence[str], method: str) -> PressFigures:
    """Flow from the rest before a press to the rest before the next, over sqrt(2)."""
    images = [run.image(str(run.frames(press)["file"].iloc[0])) for press in presses]
    figures = {}
    for press, first, second in zip(presses[1:], images, images[1:], strict=False):
        follow = open_follower(run)
        follow(first)
        residual_mm = fit_rigid_motion(follow(second))[2]
        figures[press] = float(np.sqrt((residual_mm**2).sum(axis=1).mean() / 2))
    return _without_change(run, figures)


def force_data(run: Run, correct: bool = True) -> ForceData:
    """Gather the points of a run, without the change of the force that its references show."""
    open_force_runs([run.folder])
    with ThreadPoolExecutor(1) as executor:  # runs are shared among processes already
        data = gather_data([run], (Inverse.name,), executor)
    if correct:
        gains = _changes(run, reference_change([run]))
        factors = data.points["press"].str.partition("/")[2].map(gains).to_numpy(float)
        data = replace(data, wrench=data.wrench / factors[:, None])
    return data


def _force(run: Run, presses: Sequence[str], method: str) -> PressFigures:
    """Errors of presses that were not fitted: to validate, else left out of the fit."""
    name, data = Inverse.name, force_data(run)
    fitted, tested = data.of_role("fit"), data.of_role("validate")
    if len(tested):
        model = fit_force(fitted, name)
        errors = model.predict(tested.features[name]) - tested.wrench
    else:
        tested = fitted
        left_out = (predict_left_out(fitted, name, split) for split in FORCE_SPLITS)
        predicted = next((p for p in left_out if len(p) and not np.isnan(p).any()), None)
        if predicted is None:
            raise InputError(f"{run.folder}: too few presses to leave one out of a force model")
        errors = np.sqrt(((predicted - tested.wrench) ** 2).mean(axis=0))
    rows = pd.Series(errors[:, 2] ** 2).groupby(tested.points["press"].to_numpy()).mean()
    return {str(press).partition("/")[2]: float(np.sqrt(row)) for press, row in rows.items()}


def _without_change(run: Run, figures: PressFigures) -> PressFigures:
    """Drop the reference presses, and the change that they show, to the middle of the run."""
    roles, shares = run.press_roles(), press_shares(run)
    tips = {p: (p.partition("/")[0],) for p in figures if roles.get(p) == "reference"}
    gains = _changes(run, common_change([(tips[p], shares[p], figures[p]) for p in tips]))
    return {press: value / gains[press] for press, value in figures.items() if press not in tips}


def _changes(run: Run, change: Interval | None) -> dict[str, float]:
    """Factors of presses, by name, that a change over the run makes; 1 unless it is certain."""
    low, high = (change.low or 0.0, change.high or 0.0) if change else (0.0, 0.0)
    if change is None or low <= 0 <= high:
        return dict.fromkeys(press_shares(run), 1.0)
    return {
        press: max(1 + change.value / 100 * (share - 0.5), MIN_CHANGE)
        for press, share in press_shares(run).items()
    }


COMPARED_MEASURES = {  # definition: of what is compared, by name
    "tracking": Measure("endpoint error of the flow by truth, else at the dots", "mm", _tracking),
    "time": Measure(
        "CPU time of the tracker for a frame", "ms", partial(_tracking, figure="ms_per_frame")
    ),
    "depth": Measure("error of the depth over the contact", "mm", _depth),
    "noise": Measure("flow between two rests, without rigid motion", "mm", _noise, power=2),
    "force": Measure("error of the normal force by a fit to the same run", "N", _force, power=2),
}
