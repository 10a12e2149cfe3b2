"""Pilot runs of a plan: error components, modulus, settling and specimen of a sensor."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
import pandas as pd

from deltact_fab.bench import Run, open_run
from deltact_fab.common import InputError, Progress, SolverError
from deltact_fab.estimate import Comparison, ForceRest, RelaxationFit, calibrate_force

from .components import FORCE_MODEL, ErrorComponents, ForcePoints

SETTLED_SHARE = 0.02  # by hand: of the steady force, that may still decay in a settled frame
SHORTEST_SETTLE_S, LONGEST_SETTLE_S = 1.0, 600.0
"""By hand: as in the shipped protocols; by definition: the limit of `capture.settle_s`."""
SECONDS_PER_HOUR = 3600.0  # definition

PronyPairs = Sequence[tuple[float, float]]


@dataclass(frozen=True)
class Pilot:
    """Knowledge of a sensor before a plan.

    specimen, tips: of the runs. prony: relaxation; None: not measured. modulus_mpa: factor of the
    linear gel's forces; None: the specimen's. figure: mean of the measure over presses; None: not
    measured. lines: findings to report.
    """

    components: ErrorComponents
    specimen: dict[str, Any]
    tips: tuple[str, ...] = ()
    presses: int = 0
    prony: PronyPairs | None = None
    modulus_mpa: float | None = None
    figure: float | None = None
    lines: tuple[str, ...] = ()

    @classmethod
    def load(cls, folders: Sequence[Path], seed: int, progress: Progress | None = None) -> Self:
        """Read pilot runs of one sensor; none: everything is assumed.

        Raises InputError as `calibrate_force`, and for too few points in contact.
        """
        if not folders:
            return cls(ErrorComponents.assume(seed), {})
        runs = [open_run(folder) for folder in folders]
        result = calibrate_force(folders, (FORCE_MODEL,), seed, progress=progress)
        hours = sum(
            float((run.steps()["t_end_s"] - run.steps()["t_start_s"]).sum()) for run in runs
        ) / SECONDS_PER_HOUR  # fmt: skip
        drift, reference = None, result.reference
        if reference is not None and reference.low is not None and reference.high is not None:
            error = (reference.high - reference.low) / 4  # two standard errors to each side
            drift = reference.value / 100 / hours, error / 100 / hours
        points = ForcePoints.from_result(result)
        components = ErrorComponents.estimate(points, seed, drift)
        model = next(model.model for model in result.models if model.name == FORCE_MODEL)
        factor = float(model.coefficients[2, model.names.index("Fz/E mm2")])
        presses = int(result.data.points["press"].nunique())
        about = _read_sensor(runs)
        return cls(components, *about, presses, _fit_prony(runs), factor, lines=tuple(result.notes))

    @classmethod
    def load_figures(
        cls, folders: Sequence[Path], measure: str, assumed: Mapping[str, float], seed: int, *,
        relative: bool, progress: Progress | None = None,
    ) -> Self:  # fmt: skip
        """Read the figures of presses in pilot runs; none: the components are as assumed.

        measure: as of `analyze compare`. assumed: priors by component, with "sensor" for the same
        presses on several. relative: components of the logarithm. Raises InputError as
        `Comparison.run_figures` does, and for too few presses.
        """
        if not folders:
            return cls(ErrorComponents.assume(seed, assumed), {})
        runs = [open_run(folder) for folder in folders]
        parts = Comparison.run_figures([run.folder for run in runs], measure, progress=progress)
        several, rows = "sensor" in assumed, []
        for run in runs:
            about = {"sensor": Comparison.unit_name(run, "sensor") if several else "",
                     "pattern": run.meta["protocol"]["specimen"].get("pattern")}  # fmt: skip
            entries = {entry["name"]: entry | {"name": ""} for entry in run.meta["presses"]}
            for name, figure in parts[run.folder].items():
                entry = entries[name]
                place, press = str((entry["x_mm"], entry["y_mm"])), str(entry)  # of all repeats
                rows.append(about | {"figure": figure, "place": place, "press": press,
                                     "tip": entry["indenter"]})  # fmt: skip
        table = pd.DataFrame(rows)
        y = table["figure"].to_numpy()
        if not (y > 0).all():
            raise InputError(f"--pilot: {measure} of {y.min():g}; figures above 0 have a spread")
        X = np.ones((len(y), 1))
        if several:
            fixed = pd.get_dummies(table[["press", "pattern"]], drop_first=True)
            X = np.column_stack((X, fixed.to_numpy(float)))
        shares = 1 + np.log(y) - np.log(y).mean() if relative else y / y.mean()
        points = ForcePoints(
            X, shares, {name: pd.factorize(table[name])[0] for name in [*assumed][1:]}
        )
        components = ErrorComponents.estimate(points, seed, assumed=assumed)
        specimen, tips = _read_sensor(runs)
        if several:
            specimen = {key: v for key, v in specimen.items() if key not in ("pattern", "serial")}
        return cls(components, specimen, tips, len(y), _fit_prony(runs), figure=float(y.mean()))


def _read_sensor(runs: Sequence[Run]) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return the specimen of the first run, and the tips of all."""
    entries = [entry for run in runs for entry in run.meta["presses"]]
    tips = tuple(dict.fromkeys(entry["indenter"] for entry in entries))
    return runs[0].meta["protocol"]["specimen"], tips


def _fit_prony(runs: Sequence[Run]) -> PronyPairs | None:
    """Fit the relaxation to the rests of runs; None where they tell none."""
    with suppress(InputError, SolverError):
        rests = [rest for run in runs for rest in ForceRest.find_all(run)]
        return RelaxationFit.from_rests(rests).series.pairs
    return None


def settle_time_s(prony: PronyPairs, ramp_s: float) -> float:
    """Time after a ramp until SETTLED_SHARE of the force is still to decay.

    A branch g, tau leaves g (1 - exp(-s / tau)) tau / s after a ramp of s seconds, and decays with
    tau (see `analysis.relaxation`).
    """

    def excess(wait_s: float) -> float:
        return math.fsum(
            g * -math.expm1(-ramp_s / tau) * tau / ramp_s * math.exp(-wait_s / tau)
            for g, tau in prony
        )  # fmt: skip

    if excess(SHORTEST_SETTLE_S) <= SETTLED_SHARE:
        return SHORTEST_SETTLE_S
    if excess(LONGEST_SETTLE_S) >= SETTLED_SHARE:
        return LONGEST_SETTLE_S
    from scipy.optimize import brentq

    root_s = brentq(lambda t: excess(t) - SETTLED_SHARE, SHORTEST_SETTLE_S, LONGEST_SETTLE_S)
    return float(math.ceil(root_s * 10) / 10)
