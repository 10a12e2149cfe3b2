"""`study run force-calibration`: the paper's Contact Force Distribution, whole.

Five balls at nine places, 46 settled points at each (Linear Regression Analysis): the paper's model
and better ones on the same points, judged on what they never saw; simulated, or recorded on any
bench.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..errors import InputError
from ..report.result import LeftOut, StudyResult
from .request import StudyRequest, share_of

if TYPE_CHECKING:
    from ..analysis.force import ForceResult


def run(asked: StudyRequest) -> StudyResult:
    """The study, simulated or of recorded runs. Raises InputError, RunFailed."""
    return _recorded(asked) if asked.runs else _simulated(asked)


def _simulated(asked: StudyRequest) -> StudyResult:
    from .force.simulated import settings, simulate
    from .force.summary import found
    from .gel_remarks import remark
    from .scene import left_out

    made = simulate(asked)
    return found(
        made.result,
        scale=share_of(asked.scale),
        settings=settings(made),
        notes=(remark("force-calibration", made.protocol.specimen.modulus_mpa),),
        left_out=(*left_out(made.gel), *_not_taken(made.result)),
    )


def _recorded(asked: StudyRequest) -> StudyResult:
    from .. import record
    from ..analysis.force import calibrate
    from .force.summary import found

    given = {"scale": asked.scale, "rig": asked.rig, "protocol": asked.more.get("protocol")}
    for name, value in given.items():
        if value is not None:
            raise InputError(f"--{name}: does not go with --from: the points are those of its runs")
    runs = [record.open(folder) for folder in asked.runs]
    for run in runs:
        level = run.meta["protocol"]["specimen"]["gel_model"]
        if run.simulated and level != "hyperelastic":
            raise InputError(
                f"{run.folder}: simulated with gel_model = {level!r}; a calibration is judged on "
                "'hyperelastic'"
            )
    result = calibrate(asked.runs, None, asked.seed, asked.executor, asked.progress)
    return found(
        result,
        settings={
            "runs": ", ".join(str(folder) for folder in asked.runs),
            "rig": ", ".join(dict.fromkeys(str(run.meta["rig_name"]) for run in runs)),
            "pattern": str(runs[0].meta["protocol"]["specimen"]["pattern"]),
        },
        left_out=_not_taken(result),
    )


def _not_taken(result: ForceResult) -> tuple[LeftOut, ...]:
    """Points that were not taken, and models without points enough."""
    return tuple(LeftOut("points or models", line) for line in result.left_out)
