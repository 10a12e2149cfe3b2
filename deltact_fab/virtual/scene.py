"""The gel under the indenter, followed along the path that the controller really drives.

Each straight line of motion is cut into increments; a contact problem is solved at their ends
(knots), and only for the line that someone observes. Between two knots everything is interpolated
linearly, for camera, force and truth alike. A line that ends out of contact and that no one
observes is not solved at all: an elastic gel out of contact has no memory.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..gel.contact import ContactState, LayerContact
from ..optics import StageFrame, SurfaceLattice
from ..rig.config import GelConfig
from .clock import NsClock
from .controller import GrblController
from .motion import Segment

Point = tuple[float, float, float]
Wrench = tuple[Point, Point]
CONTACT_EPS_MM = 1e-9  # rounding of the frame's transform; a motor step is 1e-3


@dataclass(frozen=True)
class Knot:
    """One solved pose: what camera and force sensor need of it."""

    index: int
    displacement_mm: NDArray[np.float32] | None  # (ny, nx, 3) on the lattice; None unless drawn
    force_n: Point
    torque_nmm: Point


@dataclass(frozen=True)
class Observation:
    """The surface between two knots: `fraction` of the way from a to b."""

    a: Knot
    b: Knot
    fraction: float

    def displacement_mm(self) -> NDArray[np.float64] | None:
        """Displacement (ny, nx, 3) on the lattice; None at rest."""
        if self.a.index == self.b.index == 0:
            return None
        assert self.a.displacement_mm is not None
        assert self.b.displacement_mm is not None
        first = self.a.displacement_mm.astype(float)
        return first + self.fraction * (self.b.displacement_mm.astype(float) - first)

    def wrench(self) -> Wrench:
        """Force (N) and torque (N mm) on the sensor."""

        def mix(p: Point, q: Point) -> Point:
            x, y, z = (u + self.fraction * (v - u) for u, v in zip(p, q, strict=True))
            return (x, y, z)

        return (
            mix(self.a.force_n, self.b.force_n),
            mix(self.a.torque_nmm, self.b.torque_nmm),
        )


@dataclass
class _Line:
    """One straight line of motion, its knots solved as far as they were needed.

    at: fractions of the line; where: tip positions there (x, y, z), those with z >= 0 at rest.
    """

    segment: Segment
    at: list[float]
    where: list[Point]
    knots: list[Knot]


class LatticeCrop:
    """The part of the contact solver's grid that the camera can see, as a lattice."""

    def __init__(
        self, x_mm: NDArray[np.float64], y_mm: NDArray[np.float64], half_mm: tuple[float, float]
    ) -> None:
        self.columns = _covering(x_mm, half_mm[0])
        self.rows = _covering(y_mm, half_mm[1])
        x, y = x_mm[self.columns], y_mm[self.rows]
        self.lattice = SurfaceLattice(float(x[0]), float(y[0]), float(x[1] - x[0]), len(x), len(y))

    def __call__(self, field: NDArray[np.float64]) -> NDArray[np.float32]:
        """Cut (ny, nx, 3) to the lattice."""
        return field[self.rows, self.columns].astype(np.float32)


def _covering(nodes: NDArray[np.float64], half_mm: float) -> slice:
    """Nodes from -half to +half and two more on each side, so that a cubic has its neighbours."""
    inside = np.flatnonzero(np.abs(nodes) <= half_mm)
    return slice(max(int(inside[0]) - 2, 0), int(inside[-1]) + 3)


class GelScene:
    """Observes the gel at the present time of the controller."""

    def __init__(
        self,
        controller: GrblController,
        clock: NsClock,
        frame: StageFrame,
        config: GelConfig,
        crop: Callable[[NDArray[np.float64]], NDArray[np.float32]] | None,
    ) -> None:
        """crop: cuts the surface field for the camera; None when nothing is drawn."""
        self._controller = controller
        self._clock = clock
        self._frame = frame
        self._config = config
        self._crop = crop
        self._contact: LayerContact | None = None
        self._next_segment = 0
        self._line: _Line | None = None
        self._states: dict[int, ContactState] = {}
        self._rest = Knot(0, None, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        self._here = self._rest
        self.knots: list[Knot] = [self._rest]
        self.solves = 0

    def mount(self, contact: LayerContact) -> None:
        """Another indenter, in the air."""
        self.observe()
        self._contact = contact
        self._settle(self._rest, None)

    def begin(self) -> None:
        """Start a press: knots are numbered from 1 again, 0 is the surface at rest."""
        self.observe()
        self._settle(self._rest, None)
        rest = np.zeros_like(self._crop(self._zeros())) if self._crop is not None else None
        self._rest = Knot(0, rest, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        self._here = self._rest
        self.knots = [self._rest]

    def observe(self) -> Observation:
        """The surface now. Raises SolverError or InputError when the gel cannot be solved."""
        now_ns = self._clock.now_ns()
        started = [
            s for s in self._controller.segments[self._next_segment :] if s.start_ns <= now_ns
        ]
        over = sum(s.end_ns <= now_ns for s in started)
        lifted = [k for k in range(over) if self._in_air(started[k])]
        if lifted:
            self._settle(self._rest, None)
        for segment in started[lifted[-1] + 1 if lifted else 0 : over]:
            self._finish(segment)
        self._next_segment += over
        if over < len(started):
            return self._between(self._line_of(started[over]), started[over], now_ns)
        return Observation(self._here, self._here, 0.0)

    def _in_air(self, segment: Segment) -> bool:
        """Whether a line ends out of contact."""
        return self._frame.to_sensor_mm(segment.end_mm)[2] > -CONTACT_EPS_MM

    def _finish(self, segment: Segment) -> None:
        """Carry the state to the end of a line that is over and ends in contact."""
        line = self._line_of(segment)
        self._solve_up_to(line, len(line.at) - 1)
        last = line.knots[-1]
        self._settle(last, self._states.get(last.index))

    def _settle(self, knot: Knot, state: ContactState | None) -> None:
        self._here = knot
        self._line = None
        self._states = {} if state is None else {knot.index: state}

    def _line_of(self, segment: Segment) -> _Line:
        """The line of a segment; when it was cut short since, what was passed already is kept."""
        line = self._line
        if line is not None and line.segment == segment:
            return line
        start = self._frame.to_sensor_mm(segment.start_mm)
        end = self._frame.to_sensor_mm(segment.end_mm)
        at, where = self._divide(start, end)
        knots = [self._here]
        if line is not None:
            # A hold: the new end lies between two knots of the old plan.
            length = math.dist(line.segment.start_mm, line.segment.end_mm)
            share = math.dist(segment.start_mm, segment.end_mm) / length
            kept = [i for i, a in enumerate(line.at[: len(line.knots)]) if a <= share]
            at = [line.at[i] / share for i in kept] + [1.0]
            where = [line.where[i] for i in kept] + [end]
            knots = [line.knots[i] for i in kept]
        self._line = _Line(segment, at, where, knots)
        return self._line

    def _divide(self, start: Point, end: Point) -> tuple[list[float], list[Point]]:
        """Fractions and points of the knots of a line, one of them exactly at first touch."""
        cuts = [0.0, 1.0]
        if min(start[2], end[2]) < 0 < max(start[2], end[2]):
            cuts.insert(1, start[2] / (start[2] - end[2]))
        at = [0.0]
        for a, b in itertools.pairwise(cuts):
            dx, dy, dz = ((q - p) * (b - a) for p, q in zip(start, end, strict=True))
            air = (
                max(start[2] + a * (end[2] - start[2]), start[2] + b * (end[2] - start[2]))
                > CONTACT_EPS_MM
            )
            pieces = 1 if air else max(
                1,
                math.ceil(abs(dz) / self._config.press_increment_mm - 1e-9),
                math.ceil(math.hypot(dx, dy) / self._config.shear_increment_mm - 1e-9),
            )  # fmt: skip
            at += [a + (b - a) * k / pieces for k in range(1, pieces + 1)]
        where = []
        for f in at:
            x, y, z = (p + f * (q - p) for p, q in zip(start, end, strict=True))
            where.append((x, y, 0.0 if abs(z) < CONTACT_EPS_MM else z))
        return at, where

    def _between(self, line: _Line, segment: Segment, now_ns: int) -> Observation:
        length = math.dist(segment.start_mm, segment.end_mm)
        done = math.dist(segment.start_mm, segment.position_mm(now_ns)) / length
        k = 0
        while k + 2 < len(line.at) and line.at[k + 1] <= done:
            k += 1
        self._solve_up_to(line, k + 1)
        fraction = (done - line.at[k]) / (line.at[k + 1] - line.at[k])
        return Observation(line.knots[k], line.knots[k + 1], min(max(fraction, 0.0), 1.0))

    def _solve_up_to(self, line: _Line, last: int) -> None:
        while len(line.knots) <= last:
            line.knots.append(self._solve(line.knots[-1], line.where[len(line.knots)]))

    def _solve(self, before: Knot, tip: Point) -> Knot:
        x, y, z = tip
        if z >= 0:
            return self._rest
        assert self._contact is not None, "an indenter is mounted before the first press"
        previous = self._states.get(before.index) or self._contact.rest((x, y, 0.0))
        state = self._contact.solve(previous, (x, y, -z))
        self.solves += 1
        field = self._crop(state.displacement_mm) if self._crop is not None else None
        knot = Knot(len(self.knots), field, state.force_n, state.torque_nmm)
        self.knots.append(knot)
        # Two are enough: a hold can throw back by one knot, never by two.
        self._states = {i: s for i, s in self._states.items() if i == before.index} | {
            knot.index: state
        }
        return knot

    def _zeros(self) -> NDArray[np.float64]:
        assert self._contact is not None, "an indenter is mounted before the first press"
        return np.zeros((*self._contact.layer.shape, 3))
