"""The gel under the indenter, followed along the path that the controller really drives.

Each straight line of motion is cut into increments; a contact problem is solved at their ends
(knots), and only for the line that someone observes, unless the store has it. Between two knots
everything is interpolated linearly, for camera, force and truth alike. A line that ends out of
contact and that no one observes is not solved at all: a gel out of contact has no memory.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deltact_fab.bench import Clock
from deltact_fab.common import Point, Point2
from deltact_fab.physics import CONTACT_EPS_MM, Increments, SolvedKnot, Zones
from deltact_fab.sensor import StageFrame, SurfaceLattice

from .clock import NS_PER_S
from .controller import GrblController
from .motion import Segment
from .presses import PlannedPress

SPACING_TOLERANCE = 1e-6  # by hand, fraction of the spacing: above rounding


@dataclass(frozen=True)
class Observation:
    """The surface between two knots: `fraction` of the way from a to b."""

    a: SolvedKnot
    b: SolvedKnot
    fraction: float

    def displacement_mm(self) -> NDArray[np.float64] | None:
        """Displacement (ny, nx, 3) on the lattice; None at rest."""
        if self.a.key == self.b.key == 0:
            return None
        assert self.a.displacement_mm is not None
        assert self.b.displacement_mm is not None
        first = self.a.displacement_mm.astype(float)
        return first + self.fraction * (self.b.displacement_mm.astype(float) - first)


@dataclass
class MotionSegment:
    """One straight line of motion, its knots solved as far as they were needed.

    at: fractions of the line; where: tip positions there (x, y, z), those with z >= 0 at rest.
    """

    segment: Segment
    fractions: list[float]
    tips_mm: list[Point]
    knots: list[SolvedKnot]


class LatticeCrop:
    """The part of the contact solver's lattice that the camera can see, with square meshes.

    Where the solver's own are not square, its fields go through the cubic spline between its nodes.
    """

    def __init__(
        self, x_mm: NDArray[np.float64], y_mm: NDArray[np.float64], half_mm: tuple[float, float]
    ) -> None:
        d = float(x_mm[1] - x_mm[0])
        self._resampling: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
        if abs(float(y_mm[1] - y_mm[0]) - d) > SPACING_TOLERANCE * d:
            x_mm, y_mm = self._square(x_mm, y_mm, d)
        self.columns = _nodes_within(x_mm, half_mm[0])
        self.rows = _nodes_within(y_mm, half_mm[1])
        x, y = x_mm[self.columns], y_mm[self.rows]
        self.lattice = SurfaceLattice(float(x[0]), float(y[0]), float(x[1] - x[0]), len(x), len(y))

    def _square(
        self, x_mm: NDArray[np.float64], y_mm: NDArray[np.float64], d: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Nodes d apart about the middle of the lattice, within it."""
        from scipy.interpolate import CubicSpline

        axes, matrices = [], []
        for nodes in (x_mm, y_mm):
            middle, half = (nodes[0] + nodes[-1]) / 2, (nodes[-1] - nodes[0]) / 2
            n = int(half / d + SPACING_TOLERANCE)
            axes.append(middle + d * np.arange(-n, n + 1))
            matrices.append(CubicSpline(nodes, np.eye(len(nodes)))(axes[-1]))
        self._resampling = matrices[0], matrices[1]
        return axes[0], axes[1]

    def __call__(self, field: NDArray[np.floating]) -> NDArray[np.float32]:
        """Cut (ny, nx, 3) to the lattice."""
        if self._resampling is None:
            return field[self.rows, self.columns].astype(np.float32)
        wx, wy = self._resampling
        laid = wy[self.rows] @ np.moveaxis(field, -1, 0) @ wx[self.columns].T
        return np.ascontiguousarray(np.moveaxis(laid, 0, -1), dtype=np.float32)


def _nodes_within(nodes: NDArray[np.float64], half_mm: float) -> slice:
    """Nodes from -half to +half and two more on each side, so that a cubic has its neighbours."""
    inside = np.flatnonzero(np.abs(nodes) <= half_mm)
    return slice(max(int(inside[0]) - 2, 0), int(inside[-1]) + 3)


@dataclass
class GelScene:
    """Observes the gel at the present time of the controller.

    presses: opens a press by name, indenter and place, solved for a modulus of 1 MPa. crop: cuts
    the surface field for the camera; None when nothing is drawn. knots: of the press, rest first,
    their displacements cut, for the gel's own modulus.
    """

    controller: GrblController
    clock: Clock
    frame: StageFrame
    increments: Increments
    presses: Callable[[str, str, Point2], PlannedPress]
    crop: Callable[[NDArray[np.floating]], NDArray[np.float32]] | None
    modulus_mpa: float = 1.0

    def __post_init__(self) -> None:
        self._indenter = ""
        self._press: PlannedPress | None = None
        self._next_segment = 0
        self._line: MotionSegment | None = None
        self._rest = SolvedKnot()
        self._current = self._rest
        self._arrived_ns = 0
        self.knots = [self._rest]
        self.begun = "", 0
        """Name of the press under way, and the time of its start in ns."""

    def mount(self, indenter: str) -> None:
        """Another indenter, in the air."""
        self.observe()
        self._indenter, self._press = indenter, None
        self._settle(self._rest, 0)

    def begin(self, name: str) -> None:
        """Start a press where the tip is: knots are numbered from 1 again, 0 is the rest."""
        self.observe()
        x, y, _ = self.frame.to_sensor_mm(self.controller.position_mm())
        self._press = press = self.presses(name, self._indenter, (x, y))
        rest = no_traction = zones = None
        if self.crop is not None:
            nothing = np.zeros((len(self.axes_mm[1]), len(self.axes_mm[0]), 3), np.float32)
            rest = np.zeros_like(self.crop(nothing))
            no_traction = nothing if press.solver.observed.traction else None
            zones = nothing[..., 0].astype(np.uint8)
        self._rest = SolvedKnot(
            zones=Zones(centroid_mm=(x, y)), displacement_mm=rest, traction_mpa=no_traction,
            zone_map=zones,
        )  # fmt: skip
        self._settle(self._rest, 0)
        self.knots = [self._rest]
        self.begun = name, self.clock.now_ns()

    @property
    def axes_mm(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The nodes along x and y of the face's whole lattice; a press has begun."""
        assert self._press is not None, "begin() comes first"
        return self._press.solver.axes_mm

    def observe(self) -> Observation:
        """The surface now. Raises SolverError or InputError when the gel cannot be solved."""
        now_ns = self.clock.now_ns()
        segment = self._reach(now_ns)
        if segment is None:
            return self._observe_rest(now_ns)
        return self._between_knots(self._segment_of(segment), segment, now_ns)

    def depth_mm(self, t_ns: int) -> float:
        """Depth of the tip below the resting face at a time that has come."""
        return -self.frame.to_sensor_mm(self.controller.position_mm(t_ns / NS_PER_S))[2]

    def wrenches(self, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Forces (N) and torques (N mm) on the sensor (n, 6) at times (n,), ascending.

        None is later than now or earlier than what was looked at before. Raises as `observe`.
        """
        wrenches = np.empty((len(t_ns), 6))
        k = 0
        while k < len(t_ns):
            segment = self._reach(int(t_ns[k]))
            until_ns = self._next_start_ns() if segment is None else segment.end_ns
            last = k + int(np.searchsorted(t_ns[k:], until_ns))
            part = t_ns[k:last]
            wrenches[k:last] = self._along(segment, part) if segment else self._at_rest(part)
            k = last
        return wrenches

    def _reach(self, now_ns: int) -> Segment | None:
        """Carry the state over all lines that are over; the line under way, None at rest."""
        started = [
            s for s in self.controller.segments[self._next_segment :] if s.start_ns <= now_ns
        ]
        over = sum(s.end_ns <= now_ns for s in started)
        heights_mm = (self.frame.to_sensor_mm(s.end_mm)[2] for s in started[:over])
        lifted = [k for k, z_mm in enumerate(heights_mm) if z_mm > -CONTACT_EPS_MM]
        if lifted:
            self._settle(self._rest, 0)
        for segment in started[lifted[-1] + 1 if lifted else 0 : over]:
            self._finish(segment)
        self._next_segment += over
        return started[over] if over < len(started) else None

    def _next_start_ns(self) -> float:
        segments = self.controller.segments
        return (
            segments[self._next_segment].start_ns
            if self._next_segment < len(segments)
            else math.inf
        )

    def _along(self, segment: Segment, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Wrenches (n, 6) at times (n,) of a line under way."""
        line = self._segment_of(segment)
        length = math.dist(segment.start_mm, segment.end_mm)
        progress = np.clip(segment.travelled_mm(t_ns) / length, 0.0, 1.0)
        ends = np.searchsorted(line.fractions, progress[[0, -1]], "right")
        ends = np.minimum(ends, len(line.fractions) - 1)
        first, last = max(int(ends[0]) - 1, 0), int(ends[1])
        self._solve_up_to(line, last)
        knots = np.array([knot.wrench for knot in line.knots[first : last + 1]])
        shares = line.fractions[first : last + 1]
        return np.stack([np.interp(progress, shares, column) for column in knots.T], axis=1)

    def _at_rest(self, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Wrenches (n, 6) at times (n,) of a rest, which may have several knots."""
        wrenches = np.empty((len(t_ns), 6))
        for k, now_ns in enumerate(t_ns.tolist()):
            observation = self._observe_rest(now_ns)
            a, b = np.array(observation.a.wrench), np.array(observation.b.wrench)
            wrenches[k] = a + observation.fraction * (b - a)
            if observation.a is observation.b:  # nothing creeps
                wrenches[k:] = a
                break
        return wrenches

    def _observe_rest(self, now_ns: float) -> Observation:
        """Observe the gel at rest; it creeps if it relaxes."""
        while self._press is not None:
            rest_s = self._press.rest_after(self._current.key)
            if rest_s is None:
                break
            tip = self._press.solver.poses[self._current.key].tip_mm
            successor = self._own_knot(self._press.solver.next(self._current.key, tip, rest_s))
            fraction = (now_ns - self._arrived_ns) / NS_PER_S / rest_s
            if fraction < 1.0:
                return Observation(self._current, successor, fraction)
            self._settle(successor, self._arrived_ns + round(rest_s * NS_PER_S))
        return Observation(self._current, self._current, 0.0)

    def _finish(self, segment: Segment) -> None:
        """Carry the state to the end of a line that is over and ends in contact."""
        line = self._segment_of(segment)
        self._solve_up_to(line, len(line.fractions) - 1)
        self._settle(line.knots[-1], segment.end_ns)

    def _settle(self, knot: SolvedKnot, since_ns: int) -> None:
        self._current = knot
        self._line = None
        self._arrived_ns = since_ns

    def _segment_of(self, segment: Segment) -> MotionSegment:
        """The line of a segment; when it was cut short since, what was passed already is kept."""
        line = self._line
        if line is not None and line.segment == segment:
            return line
        if line is None:
            # The plan's rest is over when the next line starts, whatever the host took for it.
            self._observe_rest(math.inf)
        start, end = (self._planned(p) for p in (segment.start_mm, segment.end_mm))
        shares, points_mm = self.increments.divide(start, end)
        knots = [self._current]
        if line is not None:
            # A hold: the new end lies between two knots of the old plan.
            length = math.dist(line.segment.start_mm, line.segment.end_mm)
            share = math.dist(segment.start_mm, segment.end_mm) / length
            passed = [i for i, a in enumerate(line.fractions[: len(line.knots)]) if a <= share]
            shares = [line.fractions[i] / share for i in passed] + [1.0]
            points_mm = [line.tips_mm[i] for i in passed] + [end]
            knots = [line.knots[i] for i in passed]
        self._line = MotionSegment(segment, shares, points_mm, knots)
        return self._line

    def _planned(self, machine_mm: Point) -> Point:
        """A point of the stage in the sensor frame: the plan's own where it is a motor step off."""
        point = self.frame.to_sensor_mm(machine_mm)
        return point if self._press is None else self._press.snapped(point)

    def _between_knots(self, line: MotionSegment, segment: Segment, now_ns: int) -> Observation:
        length = math.dist(segment.start_mm, segment.end_mm)
        progress = math.dist(segment.start_mm, segment.position_mm(now_ns)) / length
        k = 0
        while k + 2 < len(line.fractions) and line.fractions[k + 1] <= progress:
            k += 1
        self._solve_up_to(line, k + 1)
        fraction = (progress - line.fractions[k]) / (line.fractions[k + 1] - line.fractions[k])
        return Observation(line.knots[k], line.knots[k + 1], min(max(fraction, 0.0), 1.0))

    def _solve_up_to(self, line: MotionSegment, last: int) -> None:
        while len(line.knots) <= last:
            k = len(line.knots)
            tip = line.tips_mm[k]
            if tip[2] >= 0:
                line.knots.append(self._rest)
                continue
            assert self._press is not None, "begin() comes before the first press"
            whole_s = (line.segment.end_ns - line.segment.start_ns) / NS_PER_S
            seconds = (line.fractions[k] - line.fractions[k - 1]) * whole_s
            solution = self._press.solver.next(line.knots[-1].key, tip, seconds)
            line.knots.append(self._own_knot(solution))

    def _own_knot(self, solution: SolvedKnot) -> SolvedKnot:
        """The scene's own of a knot that the press's solver gave."""
        for knot in reversed(self.knots):
            if knot.key == solution.key:
                return knot
        field = None
        if self.crop is not None:
            assert solution.displacement_mm is not None, "a scene that draws keeps fields"
            field = self.crop(solution.displacement_mm)
        self.knots.append(replace(solution.scaled(self.modulus_mpa), displacement_mm=field))
        return self.knots[-1]
