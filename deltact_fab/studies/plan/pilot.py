"""Pilot runs of a plan: error components, modulus, settling and specimen of a sensor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from deltact_fab.bench import open_run
from deltact_fab.common import InputError, Progress, SolverError
from deltact_fab.estimate import ForceRest, RelaxationFit, calibrate_force

from .components import FORCE_MODEL, ErrorComponents, ForcePoints

SETTLED_SHARE = 0.02  # by hand: of the steady force, that may still decay in a settled frame
SHORTEST_SETTLE_S, LONGEST_SETTLE_S = 1.0, 600.0
"""By hand: as in the shipped protocols; by definition: the limit of `capture.settle_s`."""
_SECONDS_PER_HOUR = 3600.0  # definition

PronyPairs = Sequence[tuple[float, float]]


@dataclass(frozen=True)
class Pilot:
    """Knowledge of a sensor before a plan.

    modulus_mpa: factor of the linear gel's forces; None: the specimen's. prony: relaxation; None:
    not measured. specimen, tips: of the runs. lines: findings to report.
    """

    components: ErrorComponents
    specimen: dict[str, Any]
    tips: tuple[str, ...] = ()
    presses: int = 0
    modulus_mpa: float | None = None
    prony: PronyPairs | None = None
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
        ) / _SECONDS_PER_HOUR  # fmt: skip
        drift, reference = None, result.reference
        if reference is not None and reference.low is not None and reference.high is not None:
            error = (reference.high - reference.low) / 4  # two standard errors to each side
            drift = reference.value / 100 / hours, error / 100 / hours
        points = ForcePoints.from_result(result)
        components = ErrorComponents.estimate(points, seed, drift)
        model = next(model.model for model in result.models if model.name == FORCE_MODEL)
        factor = float(model.coefficients[2, model.names.index("Fz/E mm2")])
        prony: PronyPairs | None = None
        with suppress(InputError, SolverError):  # without rests to tell
            rests = [rest for run in runs for rest in ForceRest.find_all(run)]
            prony = RelaxationFit.from_rests(rests).series.pairs
        tips = tuple(dict.fromkeys(result.data.points["indenter"]))
        presses = int(result.data.points["press"].nunique())
        specimen = runs[0].meta["protocol"]["specimen"]
        return cls(components, specimen, tips, presses, factor, prony, tuple(result.notes))


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
