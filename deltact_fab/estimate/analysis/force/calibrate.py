"""Force calibration from runs: fit and rank all feature sets, or transfer a calibration."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import count
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from deltact_fab.bench import Run, encode_png
from deltact_fab.common import Array, InputError, Progress

from ...measure.force import FORCE_FEATURES, FORCE_READINGS, load_features, make_features
from ...measure.force.calibration import ForceCalibration, load_force
from ...measure.force.inverse import Inverse
from ...measure.force.model import WRENCH_AXES, Features, ForceModel
from ...measure.sensor_id import SensorModel
from ..runs import fitted_rows, has_rests, head_of, in_pixels, settled_rows, view_of_run
from .dataset import (
    TIME_STRETCHES,
    ForceData,
    gather_data,
    gather_points,
    measure_force_points,
    open_force_runs,
    presses,
)
from .gel import fit_unrelaxed, identify_gel
from .judge import (
    CV_FOLDS,
    calibrated_errors,
    cross_validate,
    evaluate_features,
    fit_force,
    force_error_n,
    learning_curve,
    predict_left_out,
    ranking_error_n,
    validate,
    validation_squares,
)
from .reference import reference_change
from .result import PAPER_CONDITIONS, ForceResult, unfitted_lines

NO_CAMERA = "camera unknown: the flow is in pixels instead of mm, no calibration is written"


def calibrate(
    folders: Sequence[Path],
    names: Sequence[str] | None = None,
    seed: int = 0,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> ForceResult:
    """Fit and cross-validate feature sets on runs of one sensor.

    names: None for all; those requested and the paper's must have enough points, others are
    skipped with a note. seed: for the folds and the learning curve's draws. Raises InputError as
    `open_force_runs` and `gather_data` do, and for too few points, with the number needed.
    """
    requested = tuple(dict.fromkeys([*(names or FORCE_FEATURES), PAPER_CONDITIONS]))
    runs, tables = open_force_runs(folders)
    if uncalibrated := [str(run.folder) for run in runs if in_pixels(run)]:
        if names and Inverse.name in names:
            raise InputError(f"{uncalibrated[0]}: {Inverse.name} needs the gel in mm; {NO_CAMERA}")
        requested = tuple(name for name in requested if name != Inverse.name)
    required = requested if names else (PAPER_CONDITIONS,)
    gathered = requested if names else (*requested, *FORCE_READINGS)
    source, view = str(runs[0].folder), view_of_run(runs[0])
    # Upper bound of the number of points: too few are refused before anything is tracked.
    max_points = sum(
        len(settled_rows(frames))
        for run, table in zip(runs, tables, strict=True)
        for _, frames in fitted_rows(run, table).groupby("press")
    )
    for name in required:
        _require_enough(make_features(name, view), max_points, source)
    data = gather_data(runs, gathered, executor, progress)
    gel = unrelaxed = None
    if Inverse.name in requested:
        fitted = data.of_role("fit")
        unrelaxed = fit_unrelaxed(fitted)
        relaxed = unrelaxed.relaxed_wrenches(fitted) if unrelaxed else fitted
        gel = identify_gel(runs, relaxed, view, progress)
    if gel is not None:
        view = view.with_gel(gel.poisson, gel.thickness_mm)
        data = gather_data(runs, gathered, executor, progress, view)
    data = unrelaxed.relaxed_wrenches(data) if unrelaxed else data
    result = fit_best_model(
        data, seed, lambda model, error: _assemble(runs, model, view, error=error), required, source
    )
    notes = [*result.notes, *_run_notes(runs, tables)]
    reference = reference_change(runs)
    return replace(result, gel=gel, unrelaxed=unrelaxed, notes=notes, reference=reference)


def validate_partly(run: Run, complete: Sequence[str]) -> dict[str, list[float]]:
    """Fit a model to presses of a run that goes on, and test it on those to validate.

    complete: names of its complete presses. The feature set is the inverse of the face,
    with the gel of the design: errors choose nothing. Returns mean square errors as
    `validation_squares` does. Raises InputError for too few points.
    """
    view, roles, source = view_of_run(run), run.press_roles(), "points"
    presses = [press for press in complete if roles[press] != "reference"]
    parts = [
        measure_force_points(run, run.folder.name, press, (Inverse.name,), view)
        for press in presses
    ]
    data = gather_points(parts, (Inverse.name,), view, source)
    fitted = data.of_role("fit")
    _require_enough(data.sets[Inverse.name], len(fitted), source)
    if unrelaxed := fit_unrelaxed(fitted):
        data = unrelaxed.relaxed_wrenches(data)
    return validation_squares(fit_force(data.of_role("fit"), Inverse.name), data)


def fit_best_model(
    data: ForceData,
    seed: int,
    calibration: Callable[[ForceModel, dict[str, dict[str, Any]]], ForceCalibration],
    required: Sequence[str] = (PAPER_CONDITIONS,),
    source: str = "points",
) -> ForceResult:
    """Fit and cross-validate every feature set of the points; the best becomes the calibration.

    Points of presses to validate only test the best one, others that are not fitted are dropped.
    calibration: builds one from a model and its errors. required: sets for which too few points
    raise InputError; source: prefix of its message.
    """
    all_data, data = data, data.of_role("fit")
    models, notes = [], list(data.notes)
    for name in (name for name in data.sets if name in FORCE_FEATURES):
        try:
            _require_enough(data.sets[name], len(data), source)
        except InputError as error:
            if name in required:
                raise
            notes.append(str(error))
        else:
            models.append(evaluate_features(data, name, seed))
    models.sort(key=lambda model: ranking_error_n(model, data))
    curves = {
        name: learning_curve(data, name, seed)
        for name in dict.fromkeys((models[0].name, PAPER_CONDITIONS))
    }
    best = calibration(models[0].model, calibrated_errors(models[0], data))
    validation = validate(models[0].model, all_data)
    return ForceResult(data, models, best, seed, notes, curves, validation=validation)


def transfer_calibration(
    folders: Sequence[Path], source: Path, progress: Progress | None = None
) -> tuple[TransferredCalibration, ForceCalibration, list[str]]:
    """Transfer another sensor's calibration by the few presses of runs; with notes on skipped data.

    source: file. Raises InputError as `open_force_runs`, `gather_data` and `load_force` do.
    """
    calibration = load_force(source)
    name = calibration.model.features
    runs, tables = open_force_runs(folders)
    # Refused before anything is tracked.
    view = calibration.view(SensorModel(runs[0].camera))
    load_features(calibration.model, view, f"{source}: model")
    data = gather_data(runs, (name,), None, progress)
    transferred = transfer(calibration.model, data.of_role("fit"))
    lines = unfitted_lines(validate(transferred.model, data), reference_change(runs))
    table = {"of": list(calibration.head.made.runs), **transferred.as_dict()}
    result = _assemble(runs, transferred.model, view_of_run(runs[0]), transfer=table)
    return transferred, result, [*lines, *data.notes, *_run_notes(runs, tables)]


def _require_enough(features: Features, points: int, source: str) -> None:
    """Raise InputError unless each fold fits more points than a component has coefficients."""
    coefficients = max(len(features.explains[component]) for component in WRENCH_AXES)
    needed = next(n for n in count(coefficients + 1) if n - ceil(n / CV_FOLDS) > coefficients)
    if points < needed:
        raise InputError(
            f"{source}: {features.name} needs at least {needed} points, got {points}; "
            "press at more positions, or in more steps"
        )


def _assemble(
    runs: Sequence[Run], model: ForceModel, view: SensorModel, **tables: Any
) -> ForceCalibration:
    """Assemble a calibration: the model, the sensor it was fitted to and its face at rest."""
    run, head = runs[0], head_of(runs, "force")
    rest = encode_png(run.image(str(run.frames(presses(run)[0])["file"].iloc[0])))
    return ForceCalibration(head, model, view.skin, view.poisson, rest=rest, **tables)


def _run_notes(runs: Sequence[Run], tables: Sequence[pd.DataFrame]) -> list[str]:
    """Return remarks on runs whose points are worse than they could be."""
    notes = []
    for run, frames in zip(runs, tables, strict=True):
        if run.imported:
            notes.append(
                f"{run.folder}: imported: rest frames unknown, so every frame is a point; "
                f"a 'press' is one of {TIME_STRETCHES} time segments"
            )
            if in_pixels(run):
                notes.append(f"{run.folder}: {NO_CAMERA}")
        elif not has_rests(frames):
            notes.append(f"{run.folder}: no settled frames; using the last frame of each motion")
        if (weights := run.weights) is not None:
            normal_n, shear_n = weights.error_n()
            notes.append(
                f"{run.folder}: weights placed by hand: force known to {normal_n:.3f} N normal, "
                f"{shear_n:.3f} N shear; not included in the errors above"
            )
        if run.simulated and run.meta["protocol"]["specimen"]["gel_model"] == "linear":
            notes.append(
                f"{run.folder}: simulated with a linear gel, whose forces are unrealistic; "
                'evaluate on "hyperelastic"'
            )
    return notes


_SHEAR_AXES = np.isin(WRENCH_AXES, ("fx", "fy", "tz"))
MAX_FACTOR_ERROR = 0.1  # standard error; by hand: a larger one lets an unsheared press set shear
FRESH_FIT_SHARE = 0.8  # of the transfer's error: then a fresh fit is better; by hand, against noise


@dataclass(frozen=True)
class TransferredCalibration:
    """A calibration transferred to another sensor by two factors, of pressure and of shear.

    Another modulus scales all forces of a displacement field alike; another thickness or Poisson's
    ratio scales pressure and shear differently. So there is one factor for the components from
    pressure (fz, tx, ty) and one for those from shear (fx, fy, tz); one sheared press determines
    both.

    shear_known: False if the presses were not sheared enough and shear takes pressure's factor.
    Errors of the force, None where unknown: error_n on an unseen position, fresh_error_n the same
    for a new fit of the same features, as_is_error_n for the calibration before the transfer.
    """

    model: ForceModel
    pressure: float
    shear: float
    shear_known: bool
    presses: int
    error_n: float | None
    fresh_error_n: float | None
    as_is_error_n: float | None

    @property
    def line(self) -> str:
        """One sentence: the two factors, and the error beside that of a fresh fit."""
        text = (
            f"transferred by {self.presses} presses: pressure x {self.pressure:.3f}, "
            f"shear x {self.shear:.3f}"
        )
        if not self.shear_known:
            text += " (same as pressure: not determined by these presses)"
        if self.error_n is None:
            return f"{text}; press at a second position to estimate the error"
        fresh = "not possible" if self.fresh_error_n is None else f"{self.fresh_error_n:.2f} N"
        text += (
            f"; force error {self.error_n:.2f} N on an unseen position (untransferred "
            f"{self.as_is_error_n:.2f} N; fresh fit {fresh})"
        )
        if self.fresh_error_n is not None and self.fresh_error_n < FRESH_FIT_SHARE * self.error_n:
            text += ": the fresh fit is better, run without --transfer"
        return text

    def as_dict(self) -> dict[str, Any]:
        """Plain data, without the model."""
        return {key: value for key, value in vars(self).items() if key != "model"}


def transfer(model: ForceModel, data: ForceData) -> TransferredCalibration:
    """Fit the two factors, and cross-validate them over positions.

    Raises InputError for presses that do not determine the factor of pressure.
    """
    wrench, as_is = data.wrench, model.predict(data.features[model.features])
    pressure, shear, shear_known = _fit_factors(as_is, wrench)

    def predict_transferred(train: Array, test: Array) -> Array:
        pressure, shear, _ = _fit_factors(as_is[train], wrench[train])
        return as_is[test] * np.where(_SHEAR_AXES, shear, pressure)

    unseen = cross_validate(data.points, wrench, "position", 0, predict_transferred)
    fresh = predict_left_out(data, model.features, "position")
    scaled = model.coefficients * np.where(_SHEAR_AXES, shear, pressure)[:, None]
    return TransferredCalibration(
        replace(model, coefficients=scaled), pressure, shear, shear_known,
        data.points["press"].nunique(), force_error_n(unseen - wrench),
        force_error_n(fresh - wrench), force_error_n(as_is - wrench),
    )  # fmt: skip


def _fit_factors(predicted: Array, wrench: Array) -> tuple[float, float, bool]:
    """Return the factors of pressure and shear; True if the presses determined the second."""
    pressure, error = _fit_factor(predicted[:, 2], wrench[:, 2])
    if error > MAX_FACTOR_ERROR:
        raise InputError(
            "transfer: the presses do not determine the factor of the normal force "
            f"({pressure:.2f} +- {error:.2f}); press deeper, or at more positions"
        )
    shear, error = _fit_factor(predicted[:, :2].ravel(), wrench[:, :2].ravel())
    return (pressure, shear, True) if error <= MAX_FACTOR_ERROR else (pressure, pressure, False)


def _fit_factor(p: Array, y: Array) -> tuple[float, float]:
    """Least-squares slope of measured y on predicted p through 0, and its standard error."""
    energy = float(p @ p)
    if energy == 0 or len(p) < 2:
        return 1.0, np.inf
    factor = float(p @ y) / energy
    return factor, float(np.sqrt(np.sum((y - factor * p) ** 2) / (len(p) - 1) / energy))
