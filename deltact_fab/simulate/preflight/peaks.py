"""Peak loads of every indenter, position and depth of a protocol."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from deltact_fab.bench import Press, Protocol
from deltact_fab.common import InputError, Point, Point2, Progress, SolverError
from deltact_fab.sensor import (
    GelMaterial,
    Indenter,
    SensorDimensions,
    SkinDimensions,
    flat_punch_n_per_mm,
    parse_indenter,
)

if TYPE_CHECKING:
    from deltact_fab.physics import Choice, PathSolver

ForceLevel = Literal["linear", "hyperelastic", "extrapolated", "bound"]
Points = tuple[tuple[float, float], ...]
NO_POINTS: Points = ()

FORCE_TOL = 0.1  # by hand: relative; added in full on the safe side
LEVEL_ATTEMPTS: tuple[tuple[Literal["linear", "hyperelastic"], int | None], ...] = (
    ("linear", None),
    ("hyperelastic", 6_000),
    ("hyperelastic", 24_000),
)
"""Levels and mesh sizes (unknowns), tried until one gets far enough."""
# By hand, trading solves for the width of the safe side: share of the deepest depth that has to be
# solved (the rest is extrapolated, force times 2 or so); cell ratio up to which the margin grows;
# penetration over depth, unused above the one and taken off the depth above the other; drop of the
# force that means a lost tip; growth of force with depth, above all solved curves.
MIN_REACHED_SHARE = 0.75
MAX_COARSER = 2.0
MAX_PENETRATION_SHARE, MIN_PENETRATION_SHARE = 0.3, 0.1
MAX_FORCE_DROP = 0.1
DEPTH_EXPONENT = 1.7
STIFFEST_POISSON = 0.499  # measured: force within 0.5 % of 0.4999; finite strain ends before 0.5
BOUND_MARGIN = 1.1  # by hand: friction under the punch, not in its closed form


@dataclass(frozen=True)
class PressCurve:
    """Normal force of one indenter at one place.

    level: that answered. points: (depth_mm, force_n) on the safe side, both rising. ended: why
    they stop short of the deepest one, else empty. bound_n_per_mm: of the punch, before thinning.
    Forces for 1 MPa.
    """

    thickness_mm: float
    level: ForceLevel
    points: Points
    ended: str
    bound_n_per_mm: float

    @property
    def reached_mm(self) -> float:
        return self.points[-1][0] if self.points else 0.0

    def normal_n(self, depth_mm: float) -> tuple[float, ForceLevel]:
        """Force at a depth and where it is from."""
        h = self.thickness_mm
        ceiling = self.bound_n_per_mm * depth_mm * h / (h - depth_mm)
        if not self.points:
            return ceiling, "bound"
        d, f = (np.array(column) for column in zip(*self.points, strict=True))
        if depth_mm < d[0]:
            # A force grows faster than the depth, so the chord from touch lies above it.
            return float(f[0] * depth_mm / d[0]), self.level
        if depth_mm <= d[-1] * (1 + 1e-9):
            return float(np.exp(np.interp(np.log(depth_mm), np.log(d), np.log(f)))), self.level
        extrapolated_n = extrapolate_n(float(d[-1]), float(f[-1]), depth_mm, h)
        return max(float(f[-1]), min(extrapolated_n, ceiling)), "extrapolated"


def extrapolate_n(depth_mm: float, force_n: float, deeper_mm: float, thickness_mm: float) -> float:
    """Extrapolate a force to a deeper press, on the safe side."""
    thinning = (thickness_mm - depth_mm) / (thickness_mm - deeper_mm)
    return force_n * (deeper_mm / depth_mm) ** DEPTH_EXPONENT * thinning


def press_curve(
    skin: SkinDimensions,
    material: GelMaterial,
    indenter: Indenter,
    at_mm: tuple[float, float],
    depths_mm: Sequence[float],
    progress: Progress | None = None,
    solve: bool = True,
) -> PressCurve | None:
    """The curve that answers for depths_mm: normal forces on the safe side, for a modulus of 1 MPa.

    Each depth gets the first answer that holds:

    1. `linear`, `hyperelastic`: the solver of presses (`physics.gel.path`), times 1 + FORCE_TOL or
       the level's own error where that is more, and more in proportion on larger cells. Linear up
       to 25 % of the gel; then finite strain on few cells, on more where the tip is lost between
       them. Where the indenter cuts into the mesh, the depth counts as that much less; far inside,
       or with the force falling, the state is not used.
    2. `extrapolated`: from the last solved depth, as F (d/d0)^1.7 (h - d0)/(h - d); above every
       curve that was solved.
    3. `bound`: a flat punch over the whole footprint (`sensor.elasticity.layer`), times h/(h - d);
       also the ceiling of 2.

    solve False: None where finite strain is needed and not in the store; the linear level takes
    about a second. Raises InputError for a depth outside of the gel.
    """
    from deltact_fab.physics import Increments, ObservedChannels, choose_level, open_path

    for depth in depths_mm:
        if not 0 < depth < skin.thickness_mm:
            raise InputError(
                f"preflight: a depth above 0 and below the gel's {skin.thickness_mm:g} mm is "
                f"needed: {depth:g} mm fails"
            )
    unit = GelMaterial(1.0, min(material.poisson, STIFFEST_POISSON), material.friction)
    depths = sorted(set(depths_mm))
    best = PressCurve(skin.thickness_mm, "bound", (), "", _punch_n_per_mm(skin, unit, indenter))
    corners = [(*at_mm, -d) for d in (0.0, *depths)]
    label = f"{indenter.name} to {depths[-1]:.3g} mm"
    for level, max_unknowns in LEVEL_ATTEMPTS:
        try:
            choice = choose_level(
                skin, unit, indenter, Increments(depths[-1], depths[-1]).poses(corners), FORCE_TOL,
                level=level, observe_shear=False, most_unknowns=max_unknowns,
            )  # fmt: skip
        except InputError as error:
            points, ended = NO_POINTS, str(error)
        else:
            poses = Increments(choice.step_mm, choice.step_mm).poses(corners)
            solver = open_path(skin, unit, indenter, poses, ObservedChannels(), choice)
            if level == "hyperelastic" and solver.stored is None and not solve:
                return None
            points, ended = _safe_points(solver, choice, progress, label)
        if not best.points or (points and points[-1][0] > best.reached_mm):
            best = replace(best, level=level, points=points, ended=ended)
        if best.reached_mm >= MIN_REACHED_SHARE * depths[-1]:
            break
    return best


def _safe_points(
    solver: PathSolver, choice: Choice, progress: Progress | None, label: str
) -> tuple[Points, str]:
    """Return points (depth, force on the safe side) and the reason for an early end."""
    points: list[tuple[float, float]] = []
    ended = failure = ""
    try:
        solver.solve_all(progress and (lambda count, total, _: progress(count, total, label)))
    except (InputError, SolverError) as error:
        ended = str(error)
    for pose, knot in zip(solver.poses, solver.knots, strict=False):
        failure = _add(points, -pose.tip_mm[2], -knot.force_n[2], knot.penetration_mm)
    larger = choice.spacing_mm / choice.goal_mm if choice.goal_mm else 1.0
    margin = 1 + max(FORCE_TOL, choice.model_force_rel) * min(max(larger, 1.0), MAX_COARSER)
    return tuple((d, f * margin) for d, f in points), failure or ended


def _add(curve: list[tuple[float, float]], depth: float, force: float, inside_mm: float) -> str:
    """Append a state if it can be used; else, or where it counts as a shallower one, say why."""
    best = curve[-1][1] if curve else 0.0
    if not force > 0:
        return ""  # not touched yet
    if inside_mm > MAX_PENETRATION_SHARE * depth:
        return f"at {depth:g} mm the indenter is {inside_mm:.2g} mm inside the coarse mesh"
    if not force > (1 - MAX_FORCE_DROP) * best:
        return f"at {depth:g} mm the force on the coarse mesh falls"
    effective_mm, reason = depth, ""
    if inside_mm > MIN_PENETRATION_SHARE * depth:
        effective_mm = depth - inside_mm
        reason = f"at {depth:g} mm the indenter is {inside_mm:.2g} mm inside the coarse mesh"
    while curve and curve[-1][0] >= effective_mm:
        curve.pop()
    curve.append((effective_mm, max(best, force)))
    return reason


def _punch_n_per_mm(skin: SkinDimensions, unit: GelMaterial, indenter: Indenter) -> float:
    """Stiffness of a flat punch around all of the indenter on the bonded layer."""
    radius = max(math.hypot(t.x_mm, t.y_mm) + max(t.half_mm) for t in indenter.tips)
    return BOUND_MARGIN * flat_punch_n_per_mm(radius, skin.thickness_mm, unit)


MODULUS_FACTOR = 2.0
"""The gel's modulus is known to a factor of 2 (Gent's relation from Shore 15A against a
datasheet); forces are in proportion to it, and the high side counts."""
HIGH_TEXT = "with twice the modulus"


# Measured by drags of up to 10 mm along x, friction 0.5, finite strain, 2 mm cells. Tangential peak
# over friction x normal force of the press: at 5 mm sphere:10 1.5 and ellipsoid 1.5 (both up to 7
# mm of drag), 4dots 2.1, hexprism 1.4; at 10 mm sphere:15 0.6 and hexprism 1.3. The gel piles up
# before a narrow tip and pushes on its flank. Normal force over that of the press: at most 1.13.
DRAG_SHEAR = 2.2
DRAG_NORMAL = 1.2
DRAG_FLANK = 0.1  # of the normal force: without friction at all, 0.07 at 8 mm
LINEAR_SHEAR = 1.05  # at the linear level a full slide gives friction x normal
PRESS_SIDE = 0.1  # of the normal force: a press without shear, a star or near a side
OFF_CENTRE = 0.15  # of the footprint: centre of pressure of a star
GRID_SHARE = 0.25  # of the thickness: presses in one cell share the curve of its inmost corner


@dataclass(frozen=True)
class Peak:
    """Largest loads while one indenter is at one depth, with the modulus as declared.

    normal_n, tangential_n: magnitudes. moment_nmm: magnitudes about x, y, z at the force sensor's
    origin; None where the rig declares none. level: where the normal force is from; reason: why it
    is no solution, else empty. `high` is MODULUS_FACTOR times all of it.
    """

    press: str
    indenter: str
    position: int
    at_mm: tuple[float, float]
    depth_mm: float
    normal_n: float
    tangential_n: float
    moment_nmm: Point | None
    level: ForceLevel
    reason: str

    @property
    def high(self) -> Peak:
        """The same with the modulus on the high side."""
        f, m = MODULUS_FACTOR, self.moment_nmm
        moment = None if m is None else (f * m[0], f * m[1], f * m[2])
        return replace(
            self, normal_n=f * self.normal_n, tangential_n=f * self.tangential_n, moment_nmm=moment
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain data, the high side beside the expected one."""
        high = self.high
        return {
            **asdict(self), "normal_high_n": high.normal_n,
            "tangential_high_n": high.tangential_n, "moment_high_nmm": high.moment_nmm,
        }  # fmt: skip


def predict_peaks(
    protocol: Protocol,
    sensor: SensorDimensions,
    origin_mm: Point | None = None,
    progress: Progress | None = None,
    solve: bool = True,
) -> list[Peak] | None:
    """Peaks in the order of the plan, of repeats once.

    solve False: None where that would take more than seconds.

    The normal force is that of `press_curve`. Free sides make a gel softer, so a press takes
    the curve of a place up to GRID of the thickness nearer to the centre; mirror images share one.
    Tangential: a drag is bounded by friction x normal force times DRAG_SHEAR, which is never less
    than linear theory gives (at most friction x normal force). Moments are bounds as well: of the
    force anywhere between the resting face and the tip, wherever the drag takes it. A gel with a
    Prony series is taken as pressed at once, before it relaxes.
    Raises InputError for a depth outside of the gel.
    """
    specimen = protocol.specimen
    material = GelMaterial(specimen.modulus_mpa, specimen.poisson, specimen.friction)
    skin = sensor.skin
    curves: dict[tuple[str, Point2], PressCurve] = {}
    peaks = []
    depths_mm: dict[tuple[str, Point2], set[float]] = {}
    presses: dict[Press, tuple[Press, tuple[str, Point2]]] = {}
    for press in protocol.list_presses():
        node = press.indenter, _inner_node(press.at_mm, GRID_SHARE * skin.thickness_mm)
        depths_mm.setdefault(node, set()).update(press.depths_mm)
        presses.setdefault(replace(press, name="", number=0, role="fit", mounting=0), (press, node))
    for press, node in presses.values():
        if node not in curves:
            shape, stops_mm = parse_indenter(press.indenter), sorted(depths_mm[node])
            curve = press_curve(skin, material, shape, node[1], stops_mm, progress, solve)
            if curve is None:
                return None
            curves[node] = curve
        peaks += [_peak_at(protocol, press, d, curves[node], origin_mm) for d in press.depths_mm]
    return peaks


def worst_press(figures: Sequence[float], peaks: Sequence[Peak]) -> tuple[float, str]:
    """The largest of the peaks' figures, and the press that it comes with."""
    k = max(range(len(peaks)), key=lambda k: figures[k])
    peak = peaks[k]
    x, y = peak.at_mm
    reason = f" ({peak.level}: {peak.reason})" if peak.reason else ""
    return figures[k], f"{peak.indenter} at ({x:g}, {y:g}) mm, {peak.depth_mm:g} mm deep{reason}"


def _inner_node(at_mm: tuple[float, float], grid_mm: float) -> tuple[float, float]:
    x, y = (math.floor(abs(v) / grid_mm + 1e-9) * grid_mm for v in at_mm)
    return x, y


def _peak_at(
    protocol: Protocol, press: Press, depth_mm: float, curve: PressCurve, origin_mm: Point | None
) -> Peak:
    unit_n, level = curve.normal_n(depth_mm)
    specimen = protocol.specimen
    # Before any relaxation: a Prony series adds its shares to the long-term modulus.
    normal = unit_n * (specimen.modulus_mpa * (1.0 + math.fsum(g for g, _ in specimen.prony)))
    friction = specimen.friction
    side = PRESS_SIDE * normal
    if press.shear and level == "linear":
        side = max(side, LINEAR_SHEAR * friction * normal)
    elif press.shear:
        side = max(DRAG_SHEAR * friction, DRAG_FLANK) * normal
        normal *= DRAG_NORMAL
    moment = None
    if origin_mm is not None:
        moment = _moment_nmm(press, depth_mm, normal, side, origin_mm)
    reason = curve.ended if level in ("extrapolated", "bound") else ""
    return Peak(
        press.name, press.indenter, press.number, press.at_mm, depth_mm, normal, side, moment,
        level, reason,
    )  # fmt: skip


def _moment_nmm(
    press: Press, depth_mm: float, normal_n: float, side_n: float, origin_mm: Point
) -> Point:
    """Bounds of r x F; r runs from the origin to wherever the force may act."""
    half_mm = parse_indenter(press.indenter).footprint_half_mm
    x, y = (
        abs(x0 - origin) + drag + OFF_CENTRE * half
        for x0, origin, drag, half in zip(
            press.at_mm, origin_mm, press.reach_mm(depth_mm), half_mm, strict=False
        )
    )
    z = max(abs(origin_mm[2]), abs(origin_mm[2] + depth_mm))
    return (y * normal_n + z * side_n, x * normal_n + z * side_n, math.hypot(x, y) * side_n)
