"""The study's points from the virtual rig: which jobs, and what their scene was."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ... import __version__
from ...analysis.force import (
    ForceData,
    ForceResult,
    compare,
    curves_of,
    errors_kept,
    figures,
    fit,
    joined,
)
from ...cad.design import load_design
from ...errors import InputError
from ...gel.level import Choice, Reach
from ...gel.level_selection import SHARE, pick
from ...measure.force import FEATURES
from ...measure.force.calibration import ForceCalibration
from ...measure.sensor_id import CalibrationSource, Head, SensorId
from ...measure.view import SensorView
from ...patterns.recipe import load_recipe
from ...protocols import limits, plan
from ...protocols.plan import Protocol, expand
from ...rig import config as rig_config
from ...rig.config import VirtualConfig
from ...shapes import SensorDimensions
from ...shapes.indenter import parse as parse_indenter
from ...virtual.paths import PressPath, poses
from ...virtual.presses import Presses
from ...virtual.rig import VirtualKind
from ..gel_remarks import interpolation
from ..grid import GridJob
from ..request import StudyRequest
from . import press

if TYPE_CHECKING:
    import pandas as pd


FEWEST = 2
"""Places and depths that are kept where there are so many: one of each can be left out."""
ABOVE = 1.25
"""Times the points asked for, from which on the shear stops of a depth are thinned too."""
_CROSS = {"grid": False, "points_per_side": 1}

Place = tuple[float, float]


class _Thinned(NamedTuple):
    points: int
    places: int
    depths: int
    cross: bool


def points_of(protocol: Protocol) -> int:
    """Settled points of a protocol."""
    return sum(step.settled for step in expand(protocol))


def scaled(protocol: Protocol, scale: float) -> Protocol:
    """The protocol with about scale x its points, scale in (0, 1].

    All indenters stay. Of places and of depths two are left at least, of depths the first and the
    last, and of places one of each set of mirror images before a second: what is left out in a
    cross-validation must be a place never seen. The stops of shear stay, as far out as they are,
    unless two places and two depths give over ABOVE x the points asked for; then a grid becomes its
    cross. What that comes to is the fewest points there are. Raises InputError for another scale.
    """
    if not 0 < scale <= 1:
        raise InputError(f"--scale: {scale:g}; expected above 0 and at most 1")
    wanted = scale * points_of(protocol)
    kept = _closest(protocol, wanted, cross=False)
    if kept.points > ABOVE * wanted and protocol.shear is not None and protocol.shear.grid:
        kept = _closest(protocol, wanted, cross=True)
    places = sorted(spread(protocol.positions_mm)[: kept.places])
    last = len(protocol.depths_mm) - 1
    steps = max(kept.depths - 1, 1)
    changed = {
        "positions_mm": [protocol.positions_mm[n] for n in places],
        "depths_mm": [
            protocol.depths_mm[last - round(last * k / steps)] for k in reversed(range(kept.depths))
        ],
        "shear": _shear(protocol, kept.cross),
    }
    return _with(protocol, changed)


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


def _closest(protocol: Protocol, wanted: float, cross: bool) -> _Thinned:
    """Places and depths whose points are nearest to those wanted, in proportion."""
    one = {
        "indenters": protocol.indenters[:1],
        "positions_mm": protocol.positions_mm[:1],
        "depths_mm": protocol.depths_mm[:1],
        "shear": _shear(protocol, cross),
    }
    of_depth, balls = points_of(_with(protocol, one)) - 1, len(protocol.indenters)
    places, depths = len(protocol.positions_mm), len(protocol.depths_mm)
    could = [
        _Thinned(balls * p * (1 + d * of_depth), p, d, cross)
        for p in range(min(FEWEST, places), places + 1)
        for d in range(min(FEWEST, depths), depths + 1)
    ]
    return min(could, key=lambda one: (abs(math.log(one.points / wanted)), -one.places))


def _shear(protocol: Protocol, cross: bool) -> dict[str, Any] | None:
    if protocol.shear is None:
        return None
    return protocol.shear.model_dump(mode="json") | (_CROSS if cross else {})


def _with(protocol: Protocol, changed: dict[str, Any]) -> Protocol:
    return Protocol.model_validate(protocol.model_dump(mode="json") | changed)


PROTOCOL, RIG = "force-calibration", "virtual"
KNOT_S, FRAME_S = 2.0, 0.25
"""What a knot of the gel takes on the rig `virtual`, and a frame: drawn, stored, tracked."""


@dataclass(frozen=True)
class ForceScene:
    """A protocol on a virtual rig, checked; nothing has run yet. source: of the rig file."""

    protocol: Protocol
    rig: VirtualConfig
    rig_name: str
    source: Path
    sensor: SensorDimensions
    choices: tuple[Choice, ...]
    """Of each indenter's deepest reach, by the rig's tolerance alone."""

    @property
    def kind(self) -> VirtualKind:
        """What the rig file says and builds."""
        return VirtualKind(self.rig, self.source)

    def groups(self) -> dict[str, list[PressPath]]:
        """Presses of an indenter at a place and its mirror images, by a name for them."""
        found: dict[str, list[PressPath]] = {}
        for path in Presses(self.protocol, self.sensor.skin, self.rig.virtual.gel).paths:
            x_mm, y_mm = (abs(v) for v in path.at_mm)
            found.setdefault(f"{path.indenter} at ({x_mm:g}, {y_mm:g})", []).append(path)
        return found


@dataclass(frozen=True)
class SimulatedForces:
    """The results of a scene. gel: of every job, what `press.points` reports of its gel.

    missing: the jobs without a result, by name, and why.
    """

    scene: ForceScene
    result: ForceResult
    gel: list[dict[str, Any]]
    missing: dict[str, str]


def scene(asked: StudyRequest) -> ForceScene:
    """The scene that was asked for. Raises InputError, one line, for one that cannot be used."""
    protocol, source = plan.load(asked.more.get("protocol") or PROTOCOL)
    rig, rig_path = rig_config.load(asked.rig or RIG)
    if not isinstance(rig, VirtualConfig):
        raise InputError(
            f"{rig_path}: kind: {rig.kind!r}; a study simulates on a 'virtual' rig, and takes what "
            "a bench recorded with --from RUN"
        )
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
    if protocol.capture.settle_s is None:
        raise InputError(f"{source}: capture.settle_s: missing key; points are frames at rest")
    protocol = scaled(protocol, 1.0 if asked.scale is None else asked.scale)
    sensor = load_design(protocol.specimen.design)
    limits.require(limits.check(protocol, sensor, rig.stage.box), str(source))
    kind = VirtualKind(rig, rig_path)
    if refused := kind.refusals(protocol, sensor, str(source)):
        raise InputError(refused[0])
    chosen = tuple(_picked(protocol, sensor, rig, name) for name in protocol.indenters)
    return ForceScene(protocol, rig, asked.rig or RIG, rig_path, sensor, chosen)


def simulate(asked: StudyRequest) -> SimulatedForces:
    """Every point of the scene that was asked for, judged. Raises InputError, RunFailed."""
    of = scene(asked)
    recipe = load_recipe(of.protocol.specimen.pattern)
    jobs = [
        GridJob(
            name,
            press.points,
            press.given(
                of.protocol, of.sensor, recipe, of.rig, of.source,
                [path.press for path in paths], asked.seed, list(FEATURES),
            ),
            _seconds(of, paths),
        )
        for name, paths in of.groups().items()
    ]  # fmt: skip
    grid = asked.solve(jobs)
    found = grid.partial()
    done = list(found.values())
    view = _view(of)
    parts = [press.unpacked(value) for value in done]
    data = joined(parts, list(FEATURES), view, of.protocol.name)
    head = Head(
        "force",
        SensorId.of(
            view.camera, recipe.model_dump(mode="json"), of.protocol.specimen.design,
            of.protocol.specimen.serial,
        ),
        CalibrationSource((of.protocol.name,), True, __version__, asked.seed),
    )  # fmt: skip
    return SimulatedForces(of, _judged(data, head, view, asked.seed), done, dict(grid.missing))


def _judged(data: ForceData, head: Head, view: SensorView, seed: int) -> ForceResult:
    judged, too_few = compare(data, seed, source=head.made.runs[0])
    best = judged[0].name
    kept = ForceCalibration(
        head, fit(data, best), view.skin, view.poisson, errors_kept(figures(judged[0], data))
    )
    left_out = [*data.left_out, *too_few]
    return ForceResult(data, judged, kept, seed, left_out, curves_of(data, best, seed))


def _seconds(of: ForceScene, paths: Sequence[PressPath]) -> float:
    """What a job takes on one core: its gel, solved half-way between too at a first place."""
    presses = Presses(of.protocol, of.sensor.skin, of.rig.virtual.gel)
    first = next(path for path in presses.paths if path.indenter == paths[0].indenter)
    knots = len(poses(paths[0], presses.increments, presses.relaxing_s))
    steps = plan.expand(of.protocol)
    frames = sum(step.frames for step in steps if step.press in {path.press for path in paths})
    return KNOT_S * knots * (2 if first == paths[0] else 1) + FRAME_S * frames


def _view(of: ForceScene) -> SensorView:
    camera = of.kind.camera(of.protocol, of.sensor)
    assert camera is not None, "images are asked for"
    return SensorView(camera, of.sensor.skin, of.protocol.specimen.poisson)


def _picked(protocol: Protocol, sensor: SensorDimensions, rig: VirtualConfig, name: str) -> Choice:
    """The level that the tolerance alone picks for an indenter's whole reach."""
    a_mm = protocol.shear.at_depth_mm(protocol.depths_mm[-1]) if protocol.shear else 0.0
    x, y = zip(*protocol.positions_mm, strict=True)
    reach = Reach(
        (min(x) - a_mm, max(x) + a_mm), (min(y) - a_mm, max(y) + a_mm), protocol.depths_mm[-1]
    )
    return pick(
        sensor.skin,
        Presses(protocol, sensor.skin, rig.virtual.gel).material,
        parse_indenter(name),
        reach,
        rig.virtual.gel.hyperelastic.tolerance,
    )


def settings(of: ForceScene, gel: Sequence[dict[str, Any]]) -> dict[str, str]:
    """What the points were made with, as a reader is shown it."""
    protocol, force = of.protocol, of.rig.force
    specimen, capture = protocol.specimen, protocol.capture
    told = limits.estimate(protocol, 0, of.rig.stage.box)
    shear = protocol.shear
    stops = (told.settled // told.presses - 1) // len(protocol.depths_mm) if told.presses else 0
    range_n, range_nmm = (
        ", ".join(f"{v:g}" for v in values) for values in (force.range_n, force.range_nmm)
    )
    found = {
        "protocol": f"{protocol.name}: {len(protocol.indenters)} indenters at "
        f"{len(protocol.positions_mm)} places, {stops} settled points at each of "
        f"{len(protocol.depths_mm)} depths and one at rest: {told.settled} points",
        "depths": ", ".join(f"{d:g}" for d in protocol.depths_mm) + " mm",
        "shear": "none"
        if shear is None
        else f"to +-{shear.at_depth_mm(protocol.depths_mm[-1]):g} mm along x and y at the deepest",
        "frames": f"{told.frames}, the tip at most {told.between_frames_mm:.2g} mm further in "
        "each; "
        f"{capture.settle_s or 0:g} s of rest before a settled one",
        "rig": of.rig_name,
        "pattern": specimen.pattern,
        "friction": f"{specimen.friction:g}",
        "modulus": f"{specimen.modulus_mpa:g} MPa, known to a factor of 2; Poisson's ratio "
        f"{specimen.poisson:g}",
        "force sensor": f"range {range_n} N and {range_nmm} N mm, noise "
        f"{of.rig.virtual.force.noise_n:g} N a sample at {force.rate_hz:g} Hz",
        "gel": _gel(of),
    }
    flags = Counter(name for one in gel for name in one["flags"])
    if flags:
        found["gel's flags"] = "; ".join(
            f"{name} at {n} of {len(gel)} jobs" for name, n in flags.items()
        )
    return found | interpolation(gel, "points")


def _gel(of: ForceScene) -> str:
    """Level and cells, and what the rig's cap on unknowns may make of the mesh's error."""
    tolerance = of.rig.virtual.gel.hyperelastic.tolerance
    levels = sorted({choice.level for choice in of.choices})
    presses = Presses(of.protocol, of.sensor.skin, of.rig.virtual.gel)
    meshes = [presses.choice(paths[0]) for paths in of.groups().values()]
    cells = sorted(mesh.spacing_mm for mesh in meshes)
    times = max((m.spacing_mm / m.asked_mm) ** 2 if m.asked_mm else 1.0 for m in meshes)
    text = (
        f"{of.protocol.specimen.gel_model}; the tolerance of {tolerance:.0%} of the force picks "
        f"{' and '.join(levels)}; cells {cells[0]:g} to {cells[-1]:g} mm"
    )
    if times > 1:
        asked = sorted(mesh.asked_mm for mesh in meshes)
        text += (
            f" where it asks for {asked[0]:g} to {asked[-1]:g}: the mesh's part of the error may "
            f"be {times:.2g} times as large, {times * (1 - SHARE) * tolerance:.1%} of the force"
        )
    return text


def meshes(gel: Sequence[dict[str, Any]]) -> pd.DataFrame:
    """A row a job: its points' presses, mesh, flags, and what interpolation costs."""
    import pandas as pd

    rows = [
        {
            "presses": ", ".join(dict.fromkeys(one["rows"]["press"])),
            "mesh": "; ".join(one["why"]),
            "flags": "; ".join(one["flags"].values()),
            "between_poses_n": one["between_n"] if one["between_samples"] else None,
            "between_poses_mm": one["between_mm"] if one["between_samples"] else None,
        }
        for one in gel
    ]
    return pd.DataFrame(rows)
