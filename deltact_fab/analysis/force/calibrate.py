"""From runs to a calibration: gather, fit and judge every model, keep the best."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from itertools import count
from math import ceil
from pathlib import Path
from typing import Any

import pandas as pd

from ... import catalog
from ...aliases import Progress
from ...errors import InputError
from ...measure.force import (
    COMPONENTS,
    FEATURES,
    READINGS,
    Features,
    ForceModel,
    features_of,
    make_features,
)
from ...measure.force.calibration import ForceCalibration, load_force
from ...measure.force.inverse import Inverse
from ...measure.view import SensorView
from ...protocols.plan import DeadWeights
from ...record import Run, encode_png
from ..runs import head_of, in_pixels, settled, settles, view_of
from .dataset import STRETCHES, ForceData, gather, opened, presses
from .gel import early_labels, told_gel
from .judge import FOLDS, figures, judge, learning_curve, score
from .result import PAPER, ForceResult, errors_kept
from .transfer import TransferredCalibration, transfer

NO_CAMERA = "no camera is known: mm of its flow are pixels, and no calibration is written"


def calibrate(
    folders: Sequence[Path],
    names: Sequence[str] | None = None,
    seed: int = 0,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> ForceResult:
    """Fit and cross-validate feature sets on runs of one sensor.

    names: None for all; those asked for and the paper's must have points enough, the others are
    left out and named. seed: of the folds and of the learning curve's draws. Raises InputError as
    `opened` and `gather` do, and for too few points, with the number needed.
    """
    asked = tuple(dict.fromkeys([*(names or FEATURES), PAPER]))
    runs, tables = opened(folders)
    if blind := [str(run.folder) for run in runs if in_pixels(run)]:
        if names and Inverse.name in names:
            raise InputError(f"{blind[0]}: {Inverse.name} rests on the gel; {NO_CAMERA}")
        asked = tuple(name for name in asked if name != Inverse.name)
    must = asked if names else (PAPER,)
    looked = asked if names else (*asked, *READINGS)
    source, view = str(runs[0].folder), view_of(runs[0])
    # How many points there may be at most: refused before anything is tracked.
    most = sum(len(settled(part)) for frames in tables for _, part in frames.groupby("press"))
    for name in must:
        _require_enough(make_features(name, view), most, source)
    data = gather(runs, looked, executor, progress)
    gel = early = None
    if Inverse.name in asked:
        early = early_labels(data)
        gel = told_gel(runs, early.mended(data) if early else data, view, progress)
    if gel is not None:
        view = gel.view(view)
        data = gather(runs, looked, executor, progress, view)
    data = early.mended(data) if early else data
    found = fit_best(
        data, seed, lambda model, error: _calibration(runs, model, view, error=error), must, source
    )
    left_out = [*found.left_out, *_doubts(runs, tables)]
    return replace(found, gel=gel, early=early, left_out=left_out)


def fit_best(
    data: ForceData,
    seed: int,
    calibration: Callable[[ForceModel, dict[str, dict[str, Any]]], ForceCalibration],
    must: Sequence[str] = (PAPER,),
    source: str = "points",
) -> ForceResult:
    """Every feature set of the points judged, and the best one's model of all of them.

    calibration: makes one of the model and its errors. must: sets whose lack of points is an error;
    source: what it names. Raises InputError.
    """
    judged, left_out = [], list(data.left_out)
    for name in [one for one in data.sets if one in FEATURES]:
        try:
            _require_enough(data.sets[name], len(data), source)
        except InputError as why:
            if name in must:
                raise
            left_out.append(str(why))
        else:
            judged.append(judge(data, name, seed))
    judged.sort(key=lambda one: score(one, data))
    curves = {
        name: learning_curve(data, name, seed) for name in dict.fromkeys((judged[0].name, PAPER))
    }
    kept = calibration(judged[0].model, errors_kept(figures(judged[0], data)))
    return ForceResult(data, judged, kept, seed, left_out, curves)


def carry_over(
    folders: Sequence[Path], other: Path, progress: Progress | None = None
) -> tuple[TransferredCalibration, ForceCalibration, list[str]]:
    """Another sensor's calibration on this one, from the few presses of runs; what was left out.

    Raises InputError as `opened`, `gather` and `load_force` do.
    """
    calibration = load_force(other)
    name = calibration.model.features
    runs, tables = opened(folders)
    # Refused before anything is tracked.
    features_of(calibration.model, calibration.view(runs[0].camera), f"{other}: model")
    data = gather(runs, (name,), None, progress)
    moved = transfer(calibration.model, data)
    told = {"of": list(calibration.head.made.runs), **moved.as_dict()}
    kept = _calibration(runs, moved.model, view_of(runs[0]), transfer=told)
    return moved, kept, [*data.left_out, *_doubts(runs, tables)]


def _require_enough(features: Features, points: int, source: str) -> None:
    """Raises InputError unless each fold fits more points than a component has coefficients."""
    most = max(len(features.explains[component]) for component in COMPONENTS)
    needed = next(n for n in count(most + 1) if n - ceil(n / FOLDS) > most)
    if points < needed:
        raise InputError(
            f"{source}: {features.name} needs at least {needed} points, and there are {points}; "
            "press at more places, or in more steps"
        )


def _calibration(
    runs: Sequence[Run], model: ForceModel, view: SensorView, **more: Any
) -> ForceCalibration:
    """A model with the sensor that it was fitted to, and the face of runs at rest."""
    run, head = runs[0], head_of(runs, "force")
    rest = encode_png(run.image(str(run.frames(presses(run)[0])["file"].iloc[0])))
    return ForceCalibration(head, model, view.skin, view.poisson, rest=rest, **more)


def _doubts(runs: Sequence[Run], tables: Sequence[pd.DataFrame]) -> list[str]:
    """What makes the points of a run worse than they could be."""
    doubts = []
    for run, frames in zip(runs, tables, strict=True):
        if run.imported:
            doubts.append(
                f"{run.folder}: imported: which frames are at rest is not known, all are points; "
                f"a 'press' is one of {STRETCHES} stretches of time"
            )
            if in_pixels(run):
                doubts.append(f"{run.folder}: {NO_CAMERA}")
        elif not settles(frames):
            doubts.append(f"{run.folder}: nothing settles in it; the end of each motion is taken")
        weights = run.meta["protocol"].get("weights")
        if weights is not None:
            normal_n, shear_n = catalog.validate(DeadWeights, weights, str(run.folder)).error_n()
            doubts.append(
                f"{run.folder}: weights laid on by hand: the normal force is known to "
                f"{normal_n:.3f} N, shear to {shear_n:.3f} N, which no error above contains"
            )
        if run.simulated and run.meta["protocol"]["specimen"]["gel_model"] != "hyperelastic":
            doubts.append(
                f"{run.folder}: simulated with a linear gel, whose forces are no gel's: "
                'judge on "hyperelastic"'
            )
    return doubts
