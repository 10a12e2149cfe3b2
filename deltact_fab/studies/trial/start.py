"""Start of a trial: what a plan promises decides how it is tried."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor

from deltact_fab.bench import VirtualConfig
from deltact_fab.common import InputError, Progress
from deltact_fab.physics import GelLevel
from deltact_fab.simulate import RunRequest

from .figures import FigureTrial
from .force import ForceTrial
from .report import TrialJobs, TrialReport


def try_plan(
    plan: str, rig: str, times: int = 100, gel: GelLevel = "linear",
    executor: Executor | None = None, progress: Progress | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> TrialReport:  # fmt: skip
    """Try a plan on drawn sensors 1 to `times` of a virtual rig, or so many comparisons of them.

    gel: of a force calibration. say: called with the cost, beforehand. Raises InputError for a
    protocol without a promise, and for a rig that draws no sensors.
    """
    request = RunRequest(plan, rig)
    promise = request.protocol.promise
    if promise is None:
        raise InputError(f"{request.source}: no [promise]; write a plan with `protocol plan`")
    if not isinstance(request.rig, VirtualConfig):
        raise InputError(f"{request.rig_path}: a real rig; a trial needs a virtual one")
    if request.rig.virtual.population is None:
        text = "no [virtual.population] that sensors are drawn from; copy that of virtual-sensors"
        raise InputError(f"{request.rig_path}: {text}")
    how = TrialJobs(executor, progress, say)
    if promise.measure == "normal force":
        return ForceTrial(request, request.rig, times, gel).run(how)
    if gel != "linear":
        raise InputError(f"--gel {gel}: of a force calibration only; set specimen.gel_model")
    return FigureTrial(request, request.rig, times).run(how)
