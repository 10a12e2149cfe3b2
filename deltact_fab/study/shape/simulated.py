"""The presses of the study of shapes on the virtual rig: which jobs, and what their scene was.

First the calibrations, of depth by a press of a ball, of force by that ball at three places; then
the objects, none of which is that ball, and the ball of the twist.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...analysis.force import errors_kept, figures, fit, joined, judge
from ...analysis.shape import PressShape
from ...protocols import limits, plan
from ...protocols.plan import Protocol, expand
from ..force import press as force_press
from ..request import StudyRequest, share_of
from ..scene import PressScene
from . import press

OBJECTS = ("shapes", "shapes-hat")
"""Protocols of the four objects."""
BALL, FORCE, TWIST = "ball-press", "force-calibration-small", "twist"
FORCE_INDENTER = "sphere:10"
"""Of the calibration of force: the one that calibrates the depth, and no object is."""
FORCE_MODEL = "inverse-placed"
"""Which `calibrate force` takes on every run so far (docs/decisions/0026), and which says where."""


@dataclass(frozen=True)
class SimulatedShapes:
    """The results of a scene. objects, twist: by press. gel: what every job reports of its gel.

    depth_line: of the calibration of depth. force_error_n: of that of force, by component, on a
    place left out; None with one place.
    """

    scene: PressScene
    objects: dict[str, PressShape]
    twist: PressShape | None
    depth_line: str
    force_error_n: dict[str, float | None]
    gel: list[dict[str, Any]]


def scene(asked: StudyRequest) -> PressScene:
    """The scene that was asked for. Raises InputError, one line, for one that cannot be used."""
    scale = share_of(asked.scale)
    loaded = {name: plan.load(name) for name in (*OBJECTS, BALL, FORCE, TWIST)}
    changed: dict[str, dict[str, Any]] = {FORCE: {"indenters": [FORCE_INDENTER]}}
    for name in (*OBJECTS, TWIST):
        places = loaded[name][0].positions_mm
        kept = 1 if name == TWIST else max(1, round(scale * len(places)))
        changed[name] = {"positions_mm": places[:kept]}
    thinned = {
        name: (_with(protocol, changed.get(name, {})), source)
        for name, (protocol, source) in loaded.items()
    }
    return PressScene.of(asked, thinned)


def presses_of(of: PressScene, name: str) -> list[str]:
    """The presses of a protocol, in its order."""
    steps = expand(of.protocols[name])
    return list(dict.fromkeys(step.press for step in steps if step.kind != "change"))


def simulate(asked: StudyRequest) -> SimulatedShapes:
    """Everything, calibrations first. Raises InputError, RunFailed."""
    of = scene(asked)
    of.solve_gels(asked)
    depth_job = of.job("depth", BALL, presses_of(of, BALL)[:1], press.ball)
    force_jobs = [
        of.job(f"force {name}", FORCE, [name], force_press.points, features=[FORCE_MODEL])
        for name in presses_of(of, FORCE)
    ]
    first = asked.solve([depth_job, *force_jobs])
    depth, points = first[depth_job.name], [first[job.name] for job in force_jobs]
    parts = [force_press.unpacked(value) for value in points]
    data = joined(parts, [FORCE_MODEL], of.view(FORCE), FORCE)
    errors = errors_kept(figures(judge(data, FORCE_MODEL, of.seed), data))
    force = of.calibration(FORCE, fit(data, FORCE_MODEL), errors)
    texts = {"depth": depth["toml"], "force": force.toml("")}
    second = asked.solve(
        [
            of.job(f"{name} {one}", name, [one], press.look, **texts)
            for name in (*OBJECTS, TWIST)
            for one in presses_of(of, name)
        ]
    )
    found = second.found
    seen = {name: press.unpacked(value) for name, value in found.items()}
    twists = [one for name, one in seen.items() if name.startswith(f"{TWIST} ")]
    return SimulatedShapes(
        of,
        {name: one for name, one in seen.items() if not name.startswith(f"{TWIST} ")},
        twists[0] if twists else None,
        depth["line"],
        {name: error.get("rmse_left_out_position_n") for name, error in errors.items()},
        [depth, *points, *found.values()],
    )


def _with(protocol: Protocol, changed: dict[str, Any]) -> Protocol:
    return Protocol.model_validate(protocol.model_dump(mode="json") | changed)


def settings(made: SimulatedShapes) -> dict[str, str]:
    """What the presses were made with, as a reader is shown it."""
    of, box = made.scene, made.scene.rig.stage
    first, hat, ball, force, twist = (of.protocols[name] for name in (*OBJECTS, BALL, FORCE, TWIST))
    at = ", ".join(f"({x:g}, {y:g})" for x, y in twist.positions_mm)
    return {
        "objects": "; ".join(f"{', '.join(p.indenters)} to {_depths(p)} mm" for p in (first, hat)),
        "places": f"{'; '.join(f'({x:g}, {y:g})' for x, y in first.positions_mm)} mm",
        "depth calibrated on": f"{ball.indenters[0]} at {_depths(ball)} mm (protocol {BALL})",
        "force calibrated on": f"{', '.join(force.indenters)} at {len(force.positions_mm)} places, "
        f"{limits.estimate(force, 0, box).settled} settled points (of {FORCE}); model "
        f"{FORCE_MODEL}",
        "twist": f"{twist.indenters[0]} at {at} mm, sheared around a grid",
        "frames": f"the tip at most {limits.estimate(first, 0, box).between_frames_mm:.2g} mm "
        "further in each",
        **of.settings(made.gel),
    }


def _depths(protocol: Protocol) -> str:
    return ", ".join(f"{depth:g}" for depth in protocol.depths_mm)
