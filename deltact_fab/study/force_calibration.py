"""`study run force-calibration`: the paper's Contact Force Distribution, whole.

Five balls at nine places, 46 settled points at each (Linear Regression Analysis): the paper's model
and better ones on the same points, judged on what they never saw; simulated, or recorded on any
bench.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from .. import record
from ..analysis.force import ForceResult, calibrate, fit_best, joined
from ..errors import InputError
from ..measure.force import FEATURES, READINGS
from ..protocols import limits, plan
from ..protocols.plan import Protocol, expand
from ..report.result import LeftOut, StudyResult
from . import press_jobs
from .force_summary import found
from .request import StudyRequest, modulus_remark, share_of
from .scene import PressScene, left_out

PROTOCOL = "force-calibration"
FEWEST = 2
"""Places and depths that are kept where there are so many: one of each can be left out."""
ALSO = (
    " Only the force sensor's noise and range do not scale: in a gel of half the modulus noise "
    "counts twice."
)

Place = tuple[float, float]


def run(asked: StudyRequest) -> StudyResult:
    """The study, simulated or of recorded runs. Raises InputError, RunFailed."""
    return _recorded(asked) if asked.runs else _simulated(asked)


def _simulated(asked: StudyRequest) -> StudyResult:
    """Every point of the scene that was asked for, judged; a job is a press."""
    of = scene(asked)
    of.solve_gels(asked)
    ((name, protocol),) = of.protocols.items()
    names = [*FEATURES, *READINGS]
    jobs = [of.job(p, name, p, press_jobs.points, features=names) for p in of.presses(name)]
    done = list(asked.solve(jobs).found.values())
    data = joined([press_jobs.points_found(one) for one in done], names, of.view(name), name)
    result = fit_best(
        data, asked.seed, lambda model, error: of.calibration(name, model, error), source=name
    )
    told = limits.estimate(protocol, 0, of.rig.stage.box)
    deepest, shear = protocol.depths_mm[-1], protocol.shear
    stops = (told.settled // told.presses - 1) // len(protocol.depths_mm) if told.presses else 0
    return found(
        result,
        scale=share_of(asked.scale),
        settings={
            "protocol": f"{protocol.name}: {len(protocol.indenters)} indenters at "
            f"{len(protocol.positions_mm)} places, {stops} settled points at each of "
            f"{len(protocol.depths_mm)} depths and one at rest: {told.settled} points",
            "depths": ", ".join(f"{d:g}" for d in protocol.depths_mm) + " mm",
            "shear": f"to +-{shear.at_depth_mm(deepest) if shear else 0:g} mm along x and y at the "
            "deepest",
            "frames": f"{told.frames}, the tip at most {told.between_frames_mm:.2g} mm further in "
            f"each; {protocol.capture.wait_s('press') or 0:g} s of rest before a settled one",
            **of.settings(done),
        },
        notes=(modulus_remark(protocol.specimen.modulus_mpa, ALSO),),
        left_out=(*left_out(done), *_not_taken(result)),
    )


def _recorded(asked: StudyRequest) -> StudyResult:
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


def scene(asked: StudyRequest) -> PressScene:
    """The scene that was asked for. Raises InputError, one line, for one that cannot be used."""
    protocol, source = plan.load(asked.more.get("protocol") or PROTOCOL)
    level = protocol.specimen.gel_model
    if level != "hyperelastic":
        raise InputError(
            f"{source}: specimen.gel_model: {level!r}; a calibration needs the gel that meets the "
            "tolerance, 'hyperelastic'"
        )
    if lacking := {"image", "force"} - protocol.channels:
        raise InputError(
            f"{source}: channels: without {', '.join(sorted(lacking))}; both are needed"
        )
    if protocol.capture.wait_s("press") is None:
        raise InputError(f"{source}: capture.settle_s: missing key; points are frames at rest")
    return PressScene.of(asked, {protocol.name: (scaled(protocol, share_of(asked.scale)), source)})


def points_of(protocol: Protocol) -> int:
    """Settled points of a protocol."""
    return sum(step.settled for step in expand(protocol))


def scaled(protocol: Protocol, scale: float) -> Protocol:
    """The protocol with about scale x its points, scale in (0, 1].

    All indenters and stops of shear stay. Of places and of depths two are left at least, of depths
    the first and the last, and of places one of each set of mirror images before a second: what is
    left out in a cross-validation must be a place never seen. Raises InputError for another scale.
    """
    wanted = share_of(scale) * points_of(protocol)
    places, depths_mm = protocol.positions_mm, protocol.depths_mm
    one = {"indenters": protocol.indenters[:1], "positions_mm": places[:1],
           "depths_mm": depths_mm[:1]}  # fmt: skip
    of_depth = points_of(protocol.model_copy(update=one)) - 1
    could = [
        (len(protocol.indenters) * p * (1 + d * of_depth), p, d)
        for p in range(min(FEWEST, len(places)), len(places) + 1)
        for d in range(min(FEWEST, len(depths_mm)), len(depths_mm) + 1)
    ]
    _, p, d = min(could, key=lambda one: (abs(math.log(one[0] / wanted)), -one[1]))
    last, steps = len(depths_mm) - 1, max(d - 1, 1)
    return protocol.model_copy(
        update={
            "positions_mm": tuple(places[n] for n in sorted(spread(places)[:p])),
            "depths_mm": tuple(
                depths_mm[last - round(last * k / steps)] for k in reversed(range(d))
            ),
        }
    )


def spread(places: Sequence[Place]) -> list[int]:
    """Indices in the order in which places are kept: far apart, mirror images last.

    The first is nearest to the centre, for the largest indenter goes whole there; then always the
    one that is farthest from those before it, of places not seen in a mirror yet.
    """
    folded = [(abs(x), abs(y)) for x, y in places]
    order: list[int] = []
    seen: dict[Place, int] = {}
    while len(order) < len(places):
        left = [n for n in range(len(places)) if n not in order]
        fewest = min(seen.get(folded[n], 0) for n in left)
        left = [n for n in left if seen.get(folded[n], 0) == fewest]
        if not order:
            best = min(left, key=lambda n: math.hypot(*folded[n]))
        else:
            best = max(left, key=lambda n: min(math.dist(places[n], places[k]) for k in order))
        order.append(best)
        seen[folded[best]] = seen.get(folded[best], 0) + 1
    return order
