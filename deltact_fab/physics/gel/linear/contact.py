"""A rigid indenter pressed into and dragged over the linear gel: pressure, friction, history.

Normal contact is the complementarity problem of Polonsky and Keer (Wear 231, 1999) at a given
depth. Coulomb friction is one incremental potential per step: with the slip increment
s = u - u_before - (movement of the indenter) it minimises 1/2 q.C q + q.(C_tn p - u_before -
movement) over |q| <= friction x pressure at every node, so that s = 0 in stick and q opposes s in
slip. The two are alternated (Panagiotopoulos) until all hold together.

The nodes are points of the skin and the indenter moves over them. The contact condition of a press
is the textbook's, with the gap above every node's resting position (Johnson, Contact Mechanics,
4.2): using the displaced position adds one second-order term out of many, and makes a press too
stiff. A drag is not small compared with the indenter's slopes: sticking points travel with it. So
the gap is taken above the resting position plus `drag`, the displacement by the shear that the
sideways travel added: q less the q of the same pressures applied without travel, from the same
potential without the movement. A straight press, and any path without friction, is the
textbook's; a point that sticks from first touch has drag = travel and keeps its place under the
indenter; unloading releases both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from deltact_fab.common import Field, InputError, Note, Point, SolverError
from deltact_fab.sensor import FreeBlock, Indenter

from ..level import IncrementDiagnostics
from .complementarity import (
    Patch,
    ShearComplianceBound,
    footprint,
    friction_contact,
    normal_contact,
    normal_violation,
    patch_below,
)
from .validity import least_det, linear_refusal, refuse_bad_contact, refuse_out_of_range


@dataclass(frozen=True, eq=False)
class ContactState:
    """One solved position of the indenter; also the full history for the next one.

    tip_mm: (x, y, depth) of the indenter's lowest point, depth positive into the gel.
    pressure_mpa: (ny, nx). shear_mpa: (ny, nx, 2), on the sensor.
    displacement_mm: (ny, nx, 3) of the face, z out of the sensor, so pressed is negative.
    drag_mpa (ny, nx, 2): shear added by the indenter's sideways travel; drag_mm (ny, nx, 2):
    displacement by it, see `contact`. Both 0 in a straight press.
    force_n, torque_nmm: on the sensor, about the centre of the resting face; the torque uses the
    displaced face.
    contact_nodes: number of nodes under pressure.
    """

    tip_mm: Point
    pressure_mpa: Field
    shear_mpa: Field
    displacement_mm: Field
    drag_mpa: Field
    drag_mm: Field
    force_n: Point
    torque_nmm: Point
    contact_nodes: int = 0
    diagnostics: IncrementDiagnostics = IncrementDiagnostics()  # noqa: RUF009 - frozen

    def __post_init__(self) -> None:
        # States are shared as history: make them read-only.
        fields = (self.displacement_mm, self.drag_mm)
        for array in (self.pressure_mpa, self.shear_mpa, self.drag_mpa, *fields):
            array.setflags(write=False)


class Mixer:
    """Anderson mixing of a fixed-point iteration, type II, over the last few iterates.

    On a steep flank friction and height feed back on each other, with a factor near -1 in front of
    the indenter and +1 behind it: plain alternation converges slowly or oscillates there.
    """

    def __init__(self, memory: int = 6) -> None:
        self._memory = memory
        self._trials: list[Field] = []
        self._errors: list[Field] = []

    def next(self, trial: Field, output: Field) -> Field:
        """Return the next trial, after `trial` gave `output`; arrays of one shape."""
        self._trials.append(output.ravel())
        self._errors.append((output - trial).ravel())
        del self._trials[: -self._memory], self._errors[: -self._memory]
        if len(self._errors) < 2:
            return output
        steps = np.stack([e - self._errors[-1] for e in self._errors[:-1]], axis=1)
        weights, *_ = np.linalg.lstsq(steps, -self._errors[-1], rcond=1e-8)
        moves = np.stack([t - self._trials[-1] for t in self._trials[:-1]], axis=1)
        return (self._trials[-1] + moves @ weights).reshape(output.shape)


SMALL_STRAIN_DEPTH = 0.10  # of the thickness: in-plane field valid (docs/evidence/gel.md)


class _Solution(NamedTuple):
    """Pressure (my, mx), shear (2, my, mx), its part added by a drag, and the worst violation over
    the depth."""

    pressure: Field
    shear: Field
    drag: Field
    residual: float


class LinearContact:
    """Contact of one indenter with one face. Holds no history: `solve` maps state to state.

    friction: Coulomb coefficient; None takes the material's; 0 drops the tangential problem.
    """

    max_alternations = 80
    refusal = staticmethod(linear_refusal)

    @staticmethod
    def is_large_strain(depth_mm: float, thickness_mm: float) -> bool:
        """True if the in-plane field of a press to that depth is not valid."""
        return depth_mm > SMALL_STRAIN_DEPTH * thickness_mm * (1 + 1e-9)

    def __init__(
        self,
        face: FreeBlock,
        indenter: Indenter,
        friction: float | None = None,
        tolerance: float = 1e-6,
    ) -> None:
        """tolerance: allowed `IncrementDiagnostics.residual`."""
        self.face = face
        self.indenter = indenter
        self.friction = face.material.friction if friction is None else friction
        self.tolerance = tolerance
        self._applications = 0

    def rest(self, tip_mm: Point = (0.0, 0.0, 0.0)) -> ContactState:
        scalar, plane = np.zeros(self.face.shape), np.zeros((*self.face.shape, 2))
        nothing, displacement = (0.0, 0.0, 0.0), np.zeros((*self.face.shape, 3))
        return ContactState(
            tip_mm, scalar, plane, displacement, plane.copy(), plane.copy(), nothing, nothing
        )  # fmt: skip

    def solve(self, previous: ContactState, tip_mm: Point) -> ContactState:
        """Solve one increment: the tip moves straight from `previous` to (x, y, depth).

        Friction depends on the path: divide a long move (`level.follow_path`). Raises InputError
        for a tip off the face or too deep, SolverError for a contact that the grid does not
        resolve, that runs off face or indenter, folds the face, or does not converge.
        """
        tip = _point(tip_mm)
        if tip[2] <= 0:
            return self.rest(tip)
        refuse_out_of_range(self.face, self.indenter, tip)
        self._applications = 0
        for grow_mm in tip[2] * np.array([0.0, 2.0, 8.0, 32.0, np.inf]):
            patch = patch_below(self.face, self.indenter, tip, grow_mm, previous.drag_mm)
            state, outside = self._state(patch, self._solve_patch(patch, previous, tip), tip)
            # The patch is a guess; check penetration on the whole grid.
            if outside <= self.tolerance * tip[2]:
                return state
        raise SolverError(
            f"contact: {self.indenter.name} at depth {tip[2]:g} mm still penetrates by "
            f"{outside:.1e} mm outside the solved window"
        )

    # -- the coupled problem ---------------------------------------------------------------------

    def _solve_patch(self, patch: Patch, previous: ContactState, tip: Point) -> _Solution:
        op, depth = patch.operator, tip[2]
        window = (patch.rows, patch.columns)
        goal = self.tolerance * depth
        p = previous.pressure_mpa[window]
        none = np.zeros((2, *op.shape))
        if self.friction == 0:
            gap = patch.height_mm(none) - depth
            start = np.where(np.isfinite(gap), p, 0.0)
            p, worst, applications = normal_contact(op, start, gap, goal / 4)
            self._applications += applications
            return _Solution(p, none, none, worst / depth)
        travel = _travel(previous.tip_mm, tip)
        dragged = bool(travel.any() or previous.drag_mm.any())
        u_before, drag_before, q, drag = (
            np.moveaxis(field[window], -1, 0)[:2]
            for field in (
                previous.displacement_mm, previous.drag_mm, previous.shear_mpa, previous.drag_mpa
            )
        )  # fmt: skip
        alone = q - drag
        target, target_alone = u_before + travel[:, None, None], u_before - drag_before
        # Coupling variables of pressure and friction: drag in plane (2) and lift by shear (1).
        trial = np.concatenate([drag_before, op.normal_of_shear(q)[None]])
        mixer, compliance = Mixer(), ShearComplianceBound(op)

        def rub(
            shear: Field, free_slip: Field, bound: Field, goal_mm: float
        ) -> tuple[Field, Field, float]:
            """Solve friction: shear and slip (2, my, mx) and the worst violation (mm)."""
            q, slip, worst, count = friction_contact(
                op, shear, free_slip, bound, goal_mm, compliance
            )
            self._applications += count
            return q, slip, worst

        inner = 1e-3 * depth
        for i in range(1, self.max_alternations + 1):
            gap = patch.height_mm(trial[:2]) - depth + trial[2]
            p, _, applications = normal_contact(op, np.where(np.isfinite(gap), p, 0.0), gap, inner)
            self._applications += applications
            spread, bound = op.shear_of_pressure(p), self.friction * p
            q, slip, worst = rub(q, spread - target, bound, inner)
            output = np.zeros_like(trial)
            if dragged:
                alone, slip_alone, worst_alone = rub(alone, spread - target_alone, bound, inner)
                worst = max(worst, worst_alone)
                output[:2] = (target + slip) - (target_alone + slip_alone)
            output[2] = op.normal_of_shear(q)
            gap = patch.height_mm(output[:2]) - depth + output[2] + op.normal_of_pressure(p)
            self._applications += 3
            worst = max(normal_violation(gap, p), worst)
            if worst <= goal:
                return _Solution(p, q, q - alone if dragged else none, worst / depth)
            inner = max(goal / 4, min(0.02 * worst, inner))
            if 2 * i == self.max_alternations:
                # A node that switches between contact and none spoils a long memory.
                mixer = Mixer(memory=2)
            trial = mixer.next(trial, output)
        raise SolverError(
            f"contact: pressure and friction do not agree after {self.max_alternations} "
            f"alternations at depth {depth:g} mm: {worst / depth:.1e} of the depth, "
            f"{self.tolerance:.0e} required; use shorter increments, less depth or less friction "
            "(steep flanks under high friction lock and have no solution at this level)"
        )

    # -- the result ------------------------------------------------------------------------------

    def _state(self, patch: Patch, solution: _Solution, tip: Point) -> tuple[ContactState, float]:
        """Return the state on the whole grid, and the worst penetration (mm) outside the patch."""
        face, p = self.face, solution.pressure
        traction = np.concatenate([solution.shear, -p[None]])
        u = face.apply_patch(traction, patch.rows.start, patch.columns.start)
        drag = np.zeros((*face.shape, 2))
        if solution.drag.any():
            drag_traction = np.concatenate([solution.drag, np.zeros_like(p)[None]])
            drag = face.apply_patch(drag_traction, patch.rows.start, patch.columns.start)[..., :2]
        rows, columns, xx, yy = footprint(face, self.indenter, tip, drag)
        gap = self.indenter.height_mm(xx, yy) - tip[2] - u[rows, columns, 2]
        inside = np.zeros(face.shape, dtype=bool)
        inside[patch.rows, patch.columns] = True
        outside = -float(np.min(gap, where=~inside[rows, columns], initial=0.0))

        contact = p > 0
        x, y = face.x_mm[patch.columns], face.y_mm[patch.rows]
        window = (patch.rows, patch.columns)
        height = patch.height_mm(np.moveaxis(drag[window], -1, 0))
        refuse_bad_contact(self.indenter, tip, height, contact)
        arm = np.stack([*np.meshgrid(x, y), np.zeros(p.shape)]) + np.moveaxis(u[window], -1, 0)
        det = least_det(face, u, tip)
        force = traction.sum(axis=(1, 2)) * face.cell_mm2
        torque = np.cross(arm, traction, axis=0).sum(axis=(1, 2)) * face.cell_mm2
        pressure = np.zeros(face.shape)
        shear, drag_q = np.zeros((2, *face.shape, 2))
        pressure[window] = p
        shear[window] = np.moveaxis(solution.shear, 0, -1)
        drag_q[window] = np.moveaxis(solution.drag, 0, -1)
        flags: tuple[Note, ...] = ()
        if self.is_large_strain(tip[2], face.thickness_mm):
            text = (
                f"depth {tip[2]:g} mm is over 10 % of the thickness; "
                "the in-plane field of the linear level is not valid there"
            )
            flags = (Note("small strain", text),)
        diagnostics = IncrementDiagnostics(
            iterations=self._applications,
            residual=solution.residual,
            penetration_mm=solution.residual * tip[2],
            least_j=det,
            flags=flags,
        )
        state = ContactState(
            tip_mm=tip,
            pressure_mpa=pressure,
            shear_mpa=shear,
            displacement_mm=u,
            drag_mpa=drag_q,
            drag_mm=drag,
            force_n=(float(force[0]), float(force[1]), float(force[2])),
            torque_nmm=(float(torque[0]), float(torque[1]), float(torque[2])),
            contact_nodes=int(contact.sum()),
            diagnostics=diagnostics,
        )
        return state, outside


def _travel(start: Point, end: Point) -> Field:
    """In-plane movement (2,) of the indenter below the face."""
    share = 1.0 if start[2] >= 0 else end[2] / (end[2] - start[2])
    return share * np.array([end[0] - start[0], end[1] - start[1]])


def _point(tip_mm: Point) -> Point:
    x, y, depth = (float(c) for c in tip_mm)
    if not all(math.isfinite(c) for c in (x, y, depth)):
        raise InputError(f"contact: tip (x, y, depth) must be finite (got {(x, y, depth)})")
    return x, y, depth
