"""The presses of the study of shapes on the virtual rig: which jobs, and what their scene was.

First the calibrations, of depth by a press of a ball, of force by that ball at three places; then
the objects, none of which is that ball, and the ball of the twist.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ... import __version__
from ...analysis.force import fit, joined, judge
from ...analysis.force.judge import figures
from ...analysis.force.result import errors_kept
from ...analysis.shape import PressShape
from ...cad.design import load_design
from ...errors import InputError
from ...gel.level_selection import SHARE
from ...measure.force.calibration import ForceCalibration
from ...measure.sensor_id import CalibrationSource, Head, SensorId
from ...measure.view import SensorView
from ...patterns.recipe import PatternRecipe, load_recipe
from ...protocols import limits, plan
from ...protocols.plan import Protocol, expand
from ...rig import config as rig_config
from ...rig.config import VirtualConfig
from ...shapes import SensorDimensions
from ...virtual.paths import poses
from ...virtual.presses import Presses
from ...virtual.rig import VirtualKind
from .. import press_jobs
from ..force import press as force_press
from ..gel_remarks import interpolation
from ..grid import GridJob
from ..request import StudyRequest
from . import press

OBJECTS = ("shapes", "shapes-hat")
"""Protocols of the four objects."""
BALL, FORCE, TWIST = "ball-press", "force-calibration-small", "twist"
FORCE_INDENTER = "sphere:10"
"""Of the calibration of force: the one that calibrates the depth, and no object is."""
FORCE_MODEL = "inverse-placed"
"""Which `analyze force` takes on every run so far (docs/decisions/0026), and which says where."""
RIG = "virtual"
KNOT_S, FRAME_S = 1.5, 0.25
"""What a knot of the gel takes on the rig `virtual`, and a frame: drawn, stored, tracked."""


@dataclass(frozen=True)
class ShapeScene:
    """One sensor, pattern and gel on a virtual rig, checked; nothing has run yet.

    protocols: by name, thinned to what was asked for. source: of the rig file.
    """

    protocols: dict[str, Protocol]
    rig: VirtualConfig
    rig_name: str
    source: Path
    sensor: SensorDimensions
    recipe: PatternRecipe
    seed: int

    def presses(self, name: str) -> list[str]:
        """The presses of a protocol, in its order."""
        steps = expand(self.protocols[name])
        return list(dict.fromkeys(step.press for step in steps if step.kind != "change"))

    def given(self, name: str, presses: Sequence[str]) -> dict[str, Any]:
        """Arguments of a job for presses of a protocol."""
        return press_jobs.given(
            self.protocols[name], self.sensor, self.recipe, self.rig, self.source, presses,
            self.seed,
        )  # fmt: skip

    def seconds(self, name: str, presses: Sequence[str]) -> float:
        """What they take on one core; an indenter's first gel is solved half-way between too."""
        protocol = self.protocols[name]
        gel = Presses(protocol, self.sensor.skin, self.rig.virtual.gel)
        told = 0.0
        for path in gel.paths:
            if path.press in presses:
                first = next(p for p in gel.paths if p.indenter == path.indenter)
                knots = len(poses(path, gel.increments, gel.relaxing_s))
                told += KNOT_S * knots * (2 if path == first else 1)
        return told + FRAME_S * sum(s.frames for s in expand(protocol) if s.press in presses)


@dataclass(frozen=True)
class SimulatedShapes:
    """The results of a scene. objects, twist: by press. gel: what every job reports of its gel.

    depth_line: of the calibration of depth. force_error_n: of that of force, by component, on a
    place left out; None with one place. missing: the jobs without a result.
    """

    scene: ShapeScene
    objects: dict[str, PressShape]
    twist: PressShape | None
    depth_line: str
    force_error_n: dict[str, float | None]
    gel: list[dict[str, Any]]
    missing: tuple[str, ...]


def scene(asked: StudyRequest) -> ShapeScene:
    """The scene that was asked for. Raises InputError, one line, for one that cannot be used."""
    rig, source = rig_config.load(asked.rig or RIG)
    if not isinstance(rig, VirtualConfig):
        raise InputError(
            f"{source}: kind: {rig.kind!r}; a study simulates on a 'virtual' rig, and takes what "
            "a bench recorded with --from RUN"
        )
    scale = 1.0 if asked.scale is None else asked.scale
    if not 0 < scale <= 1:
        raise InputError(f"--scale: {scale:g}; expected above 0 and at most 1")
    loaded = {name: plan.load(name)[0] for name in (*OBJECTS, BALL, FORCE, TWIST)}
    for name in OBJECTS:
        places = loaded[name].positions_mm
        loaded[name] = _with(
            loaded[name], positions_mm=places[: max(1, round(scale * len(places)))]
        )
    loaded[FORCE] = _with(loaded[FORCE], indenters=[FORCE_INDENTER])
    loaded[TWIST] = _with(loaded[TWIST], positions_mm=loaded[TWIST].positions_mm[:1])
    specimen = loaded[OBJECTS[0]].specimen
    for name, protocol in loaded.items():
        if protocol.specimen != specimen:
            raise InputError(
                f"{name}: another specimen than {OBJECTS[0]} has; a calibration is of one sensor"
            )
    sensor = load_design(specimen.design)
    kind = VirtualKind(rig, source)
    for name, protocol in loaded.items():
        limits.require(limits.check(protocol, sensor, rig.stage.box), name)
        if refused := kind.refusals(protocol, sensor, name):
            raise InputError(refused[0])
    recipe = load_recipe(specimen.pattern)
    return ShapeScene(loaded, rig, asked.rig or RIG, source, sensor, recipe, asked.seed)


def simulate(asked: StudyRequest) -> SimulatedShapes:
    """Everything, calibrations first. Raises InputError, RunFailed."""
    of = scene(asked)
    depth_job = _job(of, "depth", BALL, of.presses(BALL)[:1], press.ball)
    force_jobs = [
        _job(of, f"force {name}", FORCE, [name], force_press.points, features=[FORCE_MODEL])
        for name in of.presses(FORCE)
    ]
    first = asked.solve([depth_job, *force_jobs])
    depth = first[depth_job.name]
    force = _calibrated(of, [first[job.name] for job in force_jobs])
    texts = {"depth": depth["toml"], "force": force.toml("")}
    jobs = [
        _job(of, f"{name} {one}", name, [one], press.look, **texts)
        for name in (*OBJECTS, TWIST)
        for one in of.presses(name)
    ]
    second = asked.solve(jobs)
    found = second.partial()
    seen = {name: press.unpacked(value) for name, value in found.items()}
    twists = [one for name, one in seen.items() if name.startswith(f"{TWIST} ")]
    return SimulatedShapes(
        of,
        {name: one for name, one in seen.items() if not name.startswith(f"{TWIST} ")},
        twists[0] if twists else None,
        depth["line"],
        {name: force.error[name].get("rmse_left_out_position_n") for name in force.error},
        [depth, *(first[job.name] for job in force_jobs), *found.values()],
        tuple(second.missing),
    )


def _job(
    of: ShapeScene, name: str, protocol: str, presses: Sequence[str], work: Any, **more: Any
) -> GridJob:
    return GridJob(name, work, of.given(protocol, presses) | more, of.seconds(protocol, presses))


def _calibrated(of: ShapeScene, values: Sequence[dict[str, Any]]) -> ForceCalibration:
    """The calibration of force, from the points of its presses."""
    specimen = of.protocols[FORCE].specimen
    camera = VirtualKind(of.rig, of.source).camera(of.protocols[FORCE], of.sensor)
    assert camera is not None, "images are asked for"
    view = SensorView(camera, of.sensor.skin, specimen.poisson)
    data = joined([force_press.unpacked(value) for value in values], [FORCE_MODEL], view, FORCE)
    head = Head(
        "force",
        SensorId.of(camera, of.recipe.model_dump(mode="json"), specimen.design, specimen.serial),
        CalibrationSource((FORCE,), True, __version__, of.seed),
    )
    errors = errors_kept(figures(judge(data, FORCE_MODEL, of.seed), data))
    model = fit(data, FORCE_MODEL)
    return ForceCalibration(head, model, view.skin, view.poisson, errors)


def _with(protocol: Protocol, **changed: Any) -> Protocol:
    return Protocol.model_validate(protocol.model_dump(mode="json") | changed)


def settings(of: ShapeScene, gel: Sequence[dict[str, Any]]) -> dict[str, str]:
    """What the presses were made with, as a reader is shown it."""
    first, ball = of.protocols[OBJECTS[0]], of.protocols[BALL]
    hat, force, twist = (of.protocols[name] for name in (OBJECTS[1], FORCE, TWIST))
    told = limits.estimate(first, 0, of.rig.stage.box)
    specimen = first.specimen
    tolerance = of.rig.virtual.gel.hyperelastic.tolerance
    coarse = max(one["coarse"] for one in gel)
    cells = [cell for one in gel for cell in one["cells_mm"]]
    places = "; ".join(f"({x:g}, {y:g})" for x, y in first.positions_mm)
    found = {
        "objects": f"{', '.join(first.indenters)} to {_depths(first)} mm, "
        f"{', '.join(hat.indenters)} to {_depths(hat)} mm; settled",
        "places": f"{places} mm",
        "depth calibrated on": f"{ball.indenters[0]} at {_depths(ball)} mm (protocol {BALL})",
        "force calibrated on": f"{', '.join(force.indenters)} at {len(force.positions_mm)} places, "
        f"{limits.estimate(force, 0, of.rig.stage.box).settled} settled points (of {FORCE}); "
        f"model {FORCE_MODEL}",
        "twist": f"{twist.indenters[0]} at ({twist.positions_mm[0][0]:g}, "
        f"{twist.positions_mm[0][1]:g}) mm, sheared around a grid",
        "frames": f"the tip at most {told.between_frames_mm:.2g} mm further in each",
        "rig": of.rig_name,
        "pattern": specimen.pattern,
        "friction": f"{specimen.friction:g}",
        "modulus": f"{specimen.modulus_mpa:g} MPa, known to a factor of 2; Poisson's ratio "
        f"{specimen.poisson:g}",
        "force sensor's noise": f"{of.rig.virtual.force.noise_n:g} N a sample",
        "gel": f"{specimen.gel_model}, cells below an object of {min(cells):.2g} to "
        f"{max(cells):.2g} mm, {of.rig.virtual.gel.hyperelastic.most_unknowns} unknowns at most",
        "gel's stated error": f"{tolerance:.0%} of the force on cells as the tolerance asks for; "
        f"on the coarsest here the mesh's part of it may be {coarse**2:.2g} times as large, "
        f"{coarse**2 * (1 - SHARE) * tolerance:.1%} of the force",
    }
    flags = {name: text for one in gel for name, text in one["flags"].items()}
    if flags:
        found["gel's flags"] = "; ".join(flags.values())
    return found | interpolation(gel, "frames")


def _depths(protocol: Protocol) -> str:
    return ", ".join(f"{depth:g}" for depth in protocol.depths_mm)
