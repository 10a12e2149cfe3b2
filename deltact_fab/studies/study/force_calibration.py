"""`study run force-calibration`: the paper's complete Contact Force Distribution experiment.

Five balls at nine places, 46 settled points each (Linear Regression Analysis): the paper's model
and better ones on the same points, cross-validated; simulated, or recorded on any bench.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from deltact_fab.bench import Protocol, RunEstimate, expand_protocol, load_protocol, open_run
from deltact_fab.common import InputError, Note
from deltact_fab.estimate import ForceResult, calibrate_force, fit_best_model, gather_points
from deltact_fab.present import Headline, ReportTable, StudyResult, plot_predicted_force

from .press_jobs import ForcePointsJob, force_points_job
from .registry import StudyRequest, modulus_remark, parse_scale
from .scene import PressScene, collect_left_out

CALIBRATION_PROTOCOL = "force-calibration"
MIN_KEPT = 2
"""Places and depths kept at least. By definition: cross-validation leaves one out."""
FORCE_MODULUS_NOTE = (
    " Only the force sensor's noise and range do not scale: in a gel of half the modulus noise "
    "counts twice."
)

NORMAL_GOAL_N, SHEAR_GOAL_SHARE = 0.2, 0.02
"""Decision 0038: RMSE of the normal force, and of shear over its range, on unseen points."""
COMPONENT_WORDS = {"normal": "normal force", "shear_x": "shear along x", "shear_y": "shear along y"}
LAB_NOTE = (
    "Errors in a lab will be larger: these assume that the gel's thickness and Poisson's ratio are "
    "exact and the flow unbiased; with a gel 1 mm off, 0.32 N (docs/evidence/force.md, "
    "docs/evidence/strangers.md). All simulated."
)

PlaceMm = tuple[float, float]


def run(request: StudyRequest) -> StudyResult:
    """Run the study, simulated or on recorded runs. Raises InputError, RunFailed."""
    return _recorded(request) if request.runs else _simulated(request)


def _simulated(request: StudyRequest) -> StudyResult:
    """Simulate and evaluate every point of the requested scene; one job per press."""
    scene = load_scene(request)
    scene.solve_gels(request)
    ((name, protocol),) = scene.protocols.items()
    names = ForceResult.FEATURES
    jobs = [
        scene.job(p, name, p, force_points_job, ForcePointsJob, features=names)
        for p in scene.presses(name)
    ]
    results = list(request.solve(jobs).results.values())
    data = gather_points([r["points"] for r in results], names, scene.view(name), name)
    result = fit_best_model(
        data, request.seed, lambda model, error: scene.calibration(name, model, error), source=name
    )
    plan = RunEstimate.from_protocol(protocol, 0, scene.rig.stage)
    deepest, shear = protocol.stops_mm[-1], protocol.shear
    stops = (plan.settled // plan.presses - 1) // len(protocol.stops_mm) if plan.presses else 0
    return build_result(
        result,
        scale=parse_scale(request.scale),
        settings={
            "protocol": f"{protocol.name}: {len(protocol.tips)} indenters at "
            f"{len(protocol.places_mm)} positions, {stops} settled points at each of "
            f"{len(protocol.stops_mm)} depths and one at rest: {plan.settled} points",
            "depths": ", ".join(f"{d:g}" for d in protocol.stops_mm) + " mm",
            "shear": f"to +-{shear.at_depth_mm(deepest) if shear else 0:g} mm along x and y at the "
            "deepest",
            "frames": f"{plan.frames}, the tip moves at most {plan.between_frames_mm:.2g} mm per "
            f"frame; {protocol.capture.wait_s('press') or 0:g} s of rest before a settled one",
            **scene.settings(results),
        },
        notes=(modulus_remark(protocol.specimen.modulus_mpa, FORCE_MODULUS_NOTE),),
        left_out=(*collect_left_out(results), *_not_taken(result)),
    )


def _recorded(request: StudyRequest) -> StudyResult:
    options = {"scale": request.scale, "rig": request.rig, **request.options}
    for name, value in options.items():
        if value is not None:
            raise InputError(f"--{name}: not valid with --from, whose runs give the points")
    runs = [open_run(folder) for folder in request.runs]
    for run in runs:
        level = run.meta["protocol"]["specimen"]["gel_model"]
        if run.simulated and level != "hyperelastic":
            raise InputError(
                f"{run.folder}: simulated with gel_model = {level!r}; a calibration needs "
                "'hyperelastic'"
            )
    result = calibrate_force(request.runs, None, request.seed, request.executor, request.progress)
    return build_result(
        result,
        settings={
            "runs": ", ".join(str(folder) for folder in request.runs),
            "rig": ", ".join(dict.fromkeys(str(run.meta["rig_name"]) for run in runs)),
            "pattern": str(runs[0].meta["protocol"]["specimen"]["pattern"]),
        },
        left_out=_not_taken(result),
    )


def _not_taken(result: ForceResult) -> tuple[Note, ...]:
    """Notes on excluded points, and models with too few points."""
    return tuple(Note("points or models", line) for line in result.notes)


def load_scene(request: StudyRequest) -> PressScene:
    """Load the requested scene. Raises InputError, one line, for an unusable one."""
    protocol, source = load_protocol(request.options.get("protocol") or CALIBRATION_PROTOCOL)
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
    protocol = scale_protocol(protocol, parse_scale(request.scale))
    return PressScene.load(request, {protocol.name: (protocol, source)})


def count_points(protocol: Protocol) -> int:
    """Number of settled points of a protocol."""
    return sum(step.settled for step in expand_protocol(protocol))


def scale_protocol(protocol: Protocol, scale: float) -> Protocol:
    """Reduce a protocol to about scale x its points, scale in (0, 1].

    Keeps all indenters and shear stops, at least two places and two depths, the first and last
    depth, and one place per set of mirror images before a second, so that a place left out in
    cross-validation is unseen. Raises InputError for another scale.
    """
    target = parse_scale(scale) * count_points(protocol)
    places, depths_mm = protocol.places_mm, protocol.stops_mm
    of_depth = count_points(protocol.narrowed(protocol.tips[:1], places[:1], depths_mm[:1])) - 1
    candidates = [
        (len(protocol.tips) * p * (1 + d * of_depth), p, d)
        for p in range(min(MIN_KEPT, len(places)), len(places) + 1)
        for d in range(min(MIN_KEPT, len(depths_mm)), len(depths_mm) + 1)
    ]
    _, p, d = min(candidates, key=lambda c: (abs(math.log(c[0] / target)), -c[1]))
    last, steps = len(depths_mm) - 1, max(d - 1, 1)
    return protocol.narrowed(
        places_mm=[places[n] for n in order_places(places)[:p]],
        stops_mm=[depths_mm[last - round(last * k / steps)] for k in range(d)],
    )


def order_places(places: Sequence[PlaceMm]) -> list[int]:
    """Indices of places in the order of preference: far apart, mirror images last.

    The first is nearest to the centre, where the largest indenter fits; then always the farthest
    from the earlier ones, of the places that are no mirror image of one of them.
    """
    folded = [(abs(x), abs(y)) for x, y in places]
    order: list[int] = []
    uses: dict[PlaceMm, int] = {}
    while len(order) < len(places):
        remaining = [n for n in range(len(places)) if n not in order]
        fewest = min(uses.get(folded[n], 0) for n in remaining)
        remaining = [n for n in remaining if uses.get(folded[n], 0) == fewest]
        if not order:
            best = min(remaining, key=lambda n: math.hypot(*folded[n]))
        else:
            best = max(remaining, key=lambda n: min(math.dist(places[n], places[k]) for k in order))
        order.append(best)
        uses[folded[best]] = uses.get(folded[best], 0) + 1
    return order


def build_result(result: ForceResult, scale: float | None = None, **scene: Any) -> StudyResult:
    """Build the result of the points. scene: further fields (settings, notes, left_out ...)."""
    simulated = result.calibration.head.made.simulated
    notes = [*([LAB_NOTE] if simulated else []), *result.findings]
    return StudyResult(
        study="force-calibration",
        title="Force calibration",
        simulated=simulated,
        seed=result.seed,
        scale=scale,
        answer=(f"Use the model {result.best.name}; {result.curve.clause}.",),
        headlines=(*_best_heads(result), *_paper_heads(result)),
        tables=(
            ReportTable(
                "force-models",
                "Every model. RMSE by cross-validation split, refitted without the unseen points "
                "(unseen: position and indenter together; models are ranked by it). The last rows "
                "are the paper's table, of a real sensor; it does not state whether its R2 is "
                "about the mean or about 0.",
                pd.DataFrame(result.rows()),
            ),
        ),
        figures=(plot_predicted_force(result),),
        files={"points.csv": result.points().to_csv(index=False)},
        extra={
            "best": result.best.name,
            "n_points": len(result.data),
            "learning_n": {name: curve.errors_n for name, curve in result.curves.items()},
            "runs": list(result.calibration.head.made.runs),
        },
        **{**scene, "notes": (*notes, *scene.get("notes", ()))},
    )  # fmt: skip


def _best_heads(result: ForceResult) -> list[Headline]:
    """Headlines of the best model on unseen points."""
    best, split = result.best, result.best.ranked_by
    chosen = f"best of {len(result.models)} by this figure"
    if result.gel or result.unrelaxed:
        chosen += ", with the gel fitted to all presses, not refitted in each fold"
    heads = []
    for name, words in COMPONENT_WORDS.items():
        span = float(np.ptp(result.wrench_component(name)))
        interval = result.error_interval(best, name, split)
        if not span or interval is None:
            continue
        remark = f"of {span:.2f} N; {chosen}"
        if name == "normal" and result.calibration.head.made.simulated:
            remark += "; assumes exact gel and flow: 0.05 to 0.32 N otherwise, see the notes"
        heads.append(
            Headline.from_interval(
                f"{words}, {result.SPLITS[split]}: RMSE", "N", interval,
                goal=NORMAL_GOAL_N if name == "normal" else SHEAR_GOAL_SHARE * span,
                remark=remark, told=name == "normal",
            )
        )  # fmt: skip
    return heads


def _paper_heads(result: ForceResult) -> list[Headline]:
    """Headlines of the paper's model on the paper's split, with the printed values."""
    return [
        Headline.from_interval(
            f"the paper's model, {COMPONENT_WORDS[name]}, {result.SPLITS['point']}: RMSE", "N",
            interval, paper=printed_n, told=name == "normal",
            remark="the paper gives no positions",
        )
        for name, (_, printed_n) in result.PAPER_TABLE.items()
        if (interval := result.error_interval(result.paper, name, "point")) is not None
    ]  # fmt: skip
