"""The planned ways of a protocol's presses, known before anything moves, and the solvers of them.

Straight lines between the tip points of the protocol's steps, each cut into increments; the poses
at their ends are the knots that `physics.gel.path` solves. What the gel cannot compute is told
before a run; what it solved and left out, after it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from deltact_fab.bench import GelConfig, Protocol, expand_protocol
from deltact_fab.common import Field, InputError, Note, Point, Point2
from deltact_fab.physics import (
    CONTACT_EPS_MM,
    Choice,
    GelLevel,
    Increments,
    KnotPose,
    LinearContact,
    ObservedChannels,
    PathSolver,
    choose_level,
    open_path,
    poisson_limit,
)
from deltact_fab.sensor import GelMaterial, SensorDimensions, SkinDimensions, parse_indenter

NEAR_MM = 2e-3  # by hand: a motor step and its rounding
REST_GROWTH = 1.5  # measured: see `rest_s`, error of at most 0.012 of a branch


@dataclass(frozen=True, eq=False)
class PlannedPress:
    """solver: of the path's knots. name: as of `PressPath`. waypoints: ends of its lines."""

    solver: PathSolver
    name: str = ""
    waypoints: tuple[Point, ...] = ()

    @property
    def stored_files(self) -> tuple[str, ...]:
        """Name of the file of the store that has all of the press, if it can be there."""
        file = self.solver.stored_file
        return () if file is None else (str(file),)

    def snapped(self, point: Point) -> Point:
        """Snap to a planned point within one motor step, else return the point itself."""
        for planned in self.waypoints:
            if all(abs(p - q) <= NEAR_MM for p, q in zip(planned, point, strict=True)):
                return planned
        return point

    def rest_after(self, key: int) -> float | None:
        """Seconds that the tip rests after a planned knot before the next; None: no knot for it."""
        poses = self.solver.poses
        if 0 < key < len(poses) and poses[key].part == 0:
            return poses[key].seconds
        return None


class Presses:
    """Open the presses of a protocol on a skin and count solved and cached ones.

    One press is under way at a time: opening the next closes it.
    Nothing that no channel needs: no friction without shear, no field without images, no time
    without a Prony series.
    """

    def __init__(self, protocol: Protocol, skin: SkinDimensions, config: GelConfig) -> None:
        specimen = protocol.specimen
        self.level: GelLevel = specimen.gel_model
        self.modulus_mpa = specimen.modulus_mpa
        self.shears = "shear" in protocol.channels
        self.fields = "image" in protocol.channels
        self.observed = not protocol.channels.isdisjoint(("image", "force"))
        self.tractions = "traction" in protocol.channels
        self.relaxing_s = tuple(tau for g, tau in specimen.prony if g > 0)
        self.material = GelMaterial(1.0, specimen.poisson, specimen.friction, specimen.prony)
        self.paths = press_paths(protocol)
        self._by_name = {path.press: path for path in self.paths}
        self.open_presses: list[PlannedPress] = []
        self._skin = skin
        finite, linear = config.hyperelastic, self.level == "linear"
        increments = config if linear else finite
        self.increments = Increments(increments.press_increment_mm, increments.shear_increment_mm)
        lattice_mm = (config.spacing_mm if linear else None) or finite.lattice_mm
        self._channels = ObservedChannels(
            "all" if self.fields else "none", traction=self.tractions, lattice_mm=lattice_mm
        )
        self._wishes: dict[str, Any] = {
            "tolerance": finite.tolerance,
            "level": self.level,
            "observe_shear": self.shears,
            "spacing_mm": config.spacing_mm if linear else finite.cell_mm,
            "most_unknowns": finite.most_unknowns,
        }
        self._waiting: dict[str, PlannedPress] = {}

    def axes_mm(self) -> tuple[Field, Field]:
        """The lattice's nodes along x and y, the same for all presses."""
        first = self.paths[0]
        press = self._waiting[first.press] = self._press(first)
        return press.solver.axes_mm

    def open(self, name: str, indenter: str, at_mm: Point2) -> PlannedPress:
        """The planned press of a name; InputError if it has another indenter or place."""
        path = self.path(name)
        distance_mm = math.dist(path.at_mm, at_mm)
        if path.indenter != indenter or distance_mm > NEAR_MM:
            raise InputError(
                f"press {name}: planned with {path.indenter} at ({path.at_mm[0]:g}, "
                f"{path.at_mm[1]:g}) mm, not {indenter} at ({at_mm[0]:g}, {at_mm[1]:g}) mm"
            )
        return self.planned_press(path)

    def path(self, name: str) -> PressPath:
        """A planned press by its name, as `sphere-10/p1`. Raises InputError."""
        if name not in self._by_name:
            raise InputError(f"no press {name!r}; valid: {', '.join(self._by_name)}")
        return self._by_name[name]

    def planned_press(self, path: PressPath) -> PlannedPress:
        press = self._waiting.pop(path.press, None) or self._press(path)
        if self.open_presses:
            self.open_presses[-1].solver.close()
        self.open_presses.append(press)
        return press

    def choice(self, path: PressPath) -> Choice:
        """Mesh and friction of a planned press. Raises InputError where the level has none."""
        return self._choose(path, knot_poses(path, self.increments, self.relaxing_s))

    def _press(self, path: PressPath) -> PlannedPress:
        planned = knot_poses(path, self.increments, self.relaxing_s)
        shape, choice = parse_indenter(path.indenter), self._choose(path, planned)
        solver = open_path(self._skin, self.material, shape, planned, self._channels, choice)
        return PlannedPress(solver, path.press, path.waypoints)

    def _choose(self, path: PressPath, planned: Sequence[KnotPose]) -> Choice:
        shape = parse_indenter(path.indenter)
        return choose_level(self._skin, self.material, shape, planned, **self._wishes)


@dataclass(frozen=True)
class LineMove:
    """A straight way between two tip points (sensor frame), in seconds, and the rest at its end."""

    start_mm: Point
    end_mm: Point
    seconds: float
    dwell_s: float


@dataclass(frozen=True)
class PressPath:
    """The moves of a planned press that end in contact, and its filmed way out of it.

    press: its name in the protocol, as `sphere-10/p1`.
    """

    press: str
    indenter: str
    at_mm: tuple[float, float]
    lines: tuple[LineMove, ...]

    @property
    def waypoints(self) -> tuple[Point, ...]:
        """Ends of the lines, in order, each once."""
        return tuple(dict.fromkeys(p for line in self.lines for p in (line.start_mm, line.end_mm)))

    @property
    def deepest_mm(self) -> float:
        return -min(line.end_mm[2] for line in self.lines)


def press_paths(protocol: Protocol) -> list[PressPath]:
    """The press paths of a protocol, in its order.

    Ways that end in the air are not in them, but for a retract that is filmed.
    """
    by_name: dict[str, PressPath] = {}
    end: Point = (0.0, 0.0, protocol.motion.park_mm)
    for step in expand_protocol(protocol):
        start, end = end, step.target_mm
        if step.kind == "change":
            continue
        press = by_name.setdefault(step.press, PressPath(step.press, step.indenter, end[:2], ()))
        if step.kind == "hold":
            *earlier, last = press.lines
            rests = replace(last, dwell_s=last.dwell_s + step.hold_s)
            by_name[step.press] = replace(press, lines=(*earlier, rests))
        elif end[2] < -CONTACT_EPS_MM or (step.kind == "retract" and step.frames):
            seconds = math.dist(start, end) / (step.feed_mm_min / 60)
            line = LineMove(start, end, seconds, step.settle_s)
            by_name[step.press] = replace(press, lines=(*press.lines, line))
    return list(by_name.values())


def knot_poses(
    path: PressPath, increments: Increments, relaxing_s: Sequence[float] = ()
) -> list[KnotPose]:
    """All knots of a press that have to be solved, in order.

    relaxing_s: the times in which the gel relaxes; none: it does not, and rests do not count. Else
    a rest is knots more at the same place, see `rest_s`.
    """
    knots = []
    for line in path.lines:
        fractions, tips_mm = increments.divide(line.start_mm, line.end_mm)
        for (a, b), tip in zip(itertools.pairwise(fractions), tips_mm[1:], strict=True):
            if tip[2] < 0:
                knots.append(KnotPose(tip, (b - a) * line.seconds, b))
        if relaxing_s and line.dwell_s > 0:
            knots += [KnotPose(line.end_mm, s, 0.0) for s in rest_s(line.dwell_s, relaxing_s)]
    return knots


def rest_s(dwell_s: float, relaxing_s: Sequence[float]) -> list[float]:
    """A rest in parts, each ending REST_GROWTH times as late as the one before.

    The first is at most an eighth of the shortest time of relaxing. Straight lines between the
    ends are off by at most 0.012 of what a branch of the series gives.
    """
    latest = math.log(8 * dwell_s / min(relaxing_s)) / math.log(REST_GROWTH)
    parts = max(0, math.ceil(latest))
    ends = [dwell_s / REST_GROWTH**k for k in range(parts, -1, -1)]
    return [b - a for a, b in itertools.pairwise([0.0, *ends])]


def simulation_refusals(
    protocol: Protocol, sensor: SensorDimensions, config: GelConfig, source: str
) -> list[str]:
    """Reasons why presses cannot be simulated, one line per press or one for the level."""
    try:
        require_gel_level(protocol, sensor, source)
        presses = Presses(protocol, sensor.skin, config)
    except InputError as error:
        return [str(error)]
    if not presses.observed:
        return []
    reasons = []
    for path in presses.paths:
        try:
            presses.choice(path)
        except InputError as error:
            reasons.append(f"{source}: press {path.press}: {error}")
    return reasons


def require_gel_level(protocol: Protocol, sensor: SensorDimensions, source: str) -> None:
    """Raise InputError for a protocol outside the range of its gel level."""
    specimen = protocol.specimen
    level, thickness_mm = specimen.gel_model, sensor.skin.thickness_mm
    if protocol.weights is not None:
        raise InputError(f"{source}: weights: not available on a virtual rig")
    key = "press.depth_mm" if protocol.press else "depths_mm"
    deepest = protocol.stops_mm[-1]
    if deepest >= thickness_mm:
        raise InputError(
            f"{source}: {key}: {deepest:g} mm is not less than the gel's thickness of "
            f"{thickness_mm:g} mm: no gel level can be pressed that deep"
        )
    poisson_max = poisson_limit(level)
    if specimen.poisson > poisson_max:
        raise InputError(
            f"{source}: specimen.poisson: {specimen.poisson} exceeds {poisson_max}, the limit of "
            f"level {level!r}; use 0.499"
        )
    if level != "linear":
        return
    material = GelMaterial(1.0, specimen.poisson, specimen.friction, specimen.prony)
    key = "specimen.prony" if specimen.prony else key
    for name, depth_mm in sorted({(p.indenter, p.depths_mm[-1]) for p in protocol.list_presses()}):
        shape = parse_indenter(name)
        if refusal := LinearContact.refusal(sensor.skin, material, shape, depth_mm):
            raise InputError(
                f"{source}: {key}: {refusal}: beyond level {level!r}; this protocol needs the "
                "level 'hyperelastic'"
            )


def gel_not_built(presses: Presses, choices: Sequence[Choice]) -> Iterator[Note]:
    """Notes on the parts of the gel model that this scene did not need."""
    if not presses.observed:
        yield Note("gel", "no channel needs it")
        return
    if not presses.shears and not any(c.friction for c in choices):
        yield Note("friction", "no channel 'shear'")
    if presses.level == "linear":
        yield Note("finite-strain gel", f"the protocol uses level {presses.level!r}")
    elif not presses.fields:
        yield Note("the gel's surface field", "no channel needs images")
    if not presses.tractions:
        yield Note("the face's tractions", "no channel 'traction'")
    if not presses.relaxing_s:
        yield Note("viscosity", "the specimen has no Prony series")


def gel_notes(presses: Presses, choices: Sequence[Choice], skin: SkinDimensions) -> Iterator[Note]:
    """Notes on the simulated gel for readers of a run."""
    pressed = presses.open_presses
    solves = sum(p.solver.solves for p in pressed)
    cached = sum(len(p.solver.knots) for p in pressed if p.solver.stored is not None)
    text = (
        f"{solves} contact problems solved, {cached} found in the store (independent of pattern, "
        "camera and modulus); between them displacements and forces are interpolated linearly"
    )
    yield Note("solved", text)
    linear = presses.level == "linear"
    if linear:
        text = "the linear gel ignores large strain: tenths of a mm in plane from 2 mm deep"
        yield Note("linear gel", text)
    yield from dict.fromkeys(Note("level", f"gel: {choice.reason}") for choice in choices)
    if presses.level == "tabulated":
        yield from _table_notes(presses, choices)
    if not presses.shears and any(c.friction for c in choices):
        yield Note("friction", "friction is solved, as it changes the force of these presses")
    # From the plan, for the presses that a resumed run kept are not solved again.
    deepest_mm = max(p.deepest_mm for p in presses.paths)
    if linear and LinearContact.is_large_strain(deepest_mm, skin.thickness_mm):
        text = "pressed deeper than 10 % of the thickness, beyond small strain"
        yield Note("small strain", text, warns=True)
    if presses.relaxing_s:
        text = (
            "gel times follow the plan: moves at their feed, rests of their settling time; stage "
            "ramps and host delays, some hundredths of a second, are not included"
        )
        yield Note("time", text)
    yield from _flag_notes(presses)


def _table_notes(presses: Presses, choices: Sequence[Choice]) -> Iterator[Note]:
    """Notes on the table's own error, and on presses that the table does not serve."""
    force = max(choice.model_force_rel for choice in choices)
    in_plane_mm = max(choice.model_in_plane_mm for choice in choices)
    text = (
        "beside the mesh's error, moving presses from a few solved places adds up to "
        f"{force:.1%} of force, {in_plane_mm:.2g} mm rms in plane"
    )
    yield Note("tabulated gel", text)
    pairs = zip(presses.paths, choices, strict=True)
    outside = [path.press for path, choice in pairs if choice.level != presses.level]
    if outside:
        text = (
            f"{len(outside)} of {len(choices)} presses, {outside[0]} the first, are outside the "
            "table and solved at level 'hyperelastic'"
        )
        yield Note("not tabulated", text, warns=True)


def _flag_notes(presses: Presses) -> Iterator[Note]:
    """A note for each kind of flag: where, in how many states, and the last of them in full."""
    occurrences: dict[str, list[str]] = {}
    example: dict[str, Note] = {}
    for press in presses.open_presses:
        for name, count in press.solver.flags.items():
            occurrences.setdefault(name, []).append(f"{count} of {press.name}")
        example |= {flag.id: flag for knot in press.solver.knots for flag in knot.flags}
    for id, counts in sorted(occurrences.items()):
        text = f"{example[id].labelled}; affected states: {', '.join(counts)}"
        yield Note(id, text, warns=True)
