"""A rigid indenter pressed into and dragged over the bonded layer: pressure, friction, history.

The nodes are points of the skin and the indenter moves over them. The layer is linear, but a node
is held against the indenter's surface above where it has moved to, not above where it rested:
else a point that sticks to the indenter would leave the contact when both move together. The
textbook condition, at the resting place, is kept as `kinematics="reference"`.

Normal contact is the complementarity problem of Polonsky and Keer (Wear 231, 1999) at a given
depth. Coulomb friction is one incremental potential per step: with the slip increment
s = u - u_before - (movement of the indenter) it minimises 1/2 q.C q + q.(C_tn p - u_before -
movement) over |q| <= friction x pressure at every node, so that s = 0 in stick and q opposes s in
slip. The two are alternated (Panagiotopoulos), the heights following the in-plane displacement,
until all hold together.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Literal

import numpy as np

from ...errors import InputError, SolverError
from ...shapes import Indenter
from .complementarity import friction_contact, normal_contact, normal_violation
from .face import FaceOperator, Field
from .limits import Point, least_det, refuse_bad_contact, refuse_out_of_range
from .mixing import Mixer
from .patch import Patch, footprint, patch_below
from .state import ContactState, untouched

Kinematics = Literal["deformed", "reference"]

SMALL_STRAIN = 0.10  # of the thickness: beyond, the in-plane field is no longer to be trusted


class LayerContact:
    """Contact of one indenter with one layer. Holds no history: `solve` maps state to state.

    layer: a `BondedLayer`, or a `FreeBlock`.
    friction: Coulomb coefficient; None takes the material's.
    observe_shear: False drops the tangential problem, that is, it solves without friction.
    kinematics: where a node meets the indenter, see the module's text.
    tolerance: allowed `ContactState.residual`. tangential_solves: calls made so far.
    """

    def __init__(
        self,
        layer: FaceOperator,
        indenter: Indenter,
        friction: float | None = None,
        observe_shear: bool = True,
        kinematics: Kinematics = "deformed",
        tolerance: float = 1e-6,
        max_alternations: int = 60,
        max_iterations: int = 4000,
    ) -> None:
        friction = layer.material.friction if friction is None else friction
        if not (math.isfinite(friction) and friction >= 0):
            raise InputError(f"contact: friction >= 0 and finite: {friction} fails")
        if kinematics not in ("deformed", "reference"):
            raise InputError(f"contact: kinematics {kinematics!r}: valid: deformed, reference")
        if not 1e-12 <= tolerance <= 1e-2:
            raise InputError(f"contact: tolerance must be 1e-12 to 1e-2: {tolerance} fails")
        self.layer = layer
        self.indenter = indenter
        self.friction = friction
        self.observe_shear = observe_shear
        self.kinematics = kinematics
        self.tolerance = tolerance
        self.max_alternations = max_alternations
        self.max_iterations = max_iterations
        self.tangential_solves = 0
        self._applications = 0

    @property
    def least_depth_mm(self) -> float:
        """Depth from which every tip meets a node wherever it stands; below, `solve` may refuse."""
        dx, dy = self.layer.spacing_mm
        radius = min(t.radius_mm for t in self.indenter.tips)
        reach2 = (dx**2 + dy**2) / 4
        return radius - math.sqrt(radius**2 - reach2) if reach2 < radius**2 else math.inf

    def rest(self, tip_mm: Point = (0.0, 0.0, 0.0)) -> ContactState:
        """The state without contact: nothing displaced, nothing remembered."""
        return untouched(self.layer.shape, tip_mm)

    def path(
        self, previous: ContactState, tip_mm: Point, max_step_mm: float = 0.1
    ) -> Iterator[ContactState]:
        """Solve along the straight way from `previous` to `tip_mm` in equal increments.

        The way above the face is skipped, so the first increment starts at first touch; a move
        that ends without contact gives the one state of rest.
        """
        if not (math.isfinite(max_step_mm) and max_step_mm > 0):
            raise InputError(f"contact: max_step_mm > 0 and finite: {max_step_mm} fails")
        tip = _point(tip_mm)
        if tip[2] <= 0:
            yield self.solve(previous, tip)
            return
        refuse_out_of_range(self.layer, self.indenter, tip)  # before any of the way is solved
        start, end = np.array(previous.tip_mm), np.array(tip)
        if start[2] < 0:
            start = start + (end - start) * (-start[2] / (end[2] - start[2]))
        n = max(1, math.ceil(float(np.linalg.norm(end - start)) / max_step_mm - 1e-9))
        state = previous
        for i in range(1, n + 1):
            at = start + (end - start) * (i / n) if i < n else end
            state = self.solve(state, (float(at[0]), float(at[1]), float(at[2])))
            yield state

    def solve(self, previous: ContactState, tip_mm: Point) -> ContactState:
        """One increment: the state with the tip at (x, y, depth), coming straight from `previous`.

        Friction depends on the path, so a long move wants several increments (`path`).
        Raises InputError when the tip is not on the face or deeper than this level reaches,
        SolverError when the contact is not resolved by the grid, runs off the face or the
        indenter, folds the face, or does not converge.
        """
        tip = _point(tip_mm)
        if previous.pressure_mpa.shape != self.layer.shape:
            raise InputError(
                f"contact: the previous state has {previous.pressure_mpa.shape} nodes, "
                f"the layer {self.layer.shape}"
            )
        if tip[2] <= 0:
            return self.rest(tip)
        refuse_out_of_range(self.layer, self.indenter, tip)
        self._applications = 0
        for grow_mm in tip[2] * np.array([0.0, 2.0, 8.0, 32.0, np.inf]):
            patch = patch_below(
                self.layer, self.indenter, tip, grow_mm, self._moved(previous.displacement_mm)
            )
            p, q, residual = self._solve_patch(patch, previous, tip)
            state, outside = self._state(patch, p, q, residual, tip)
            # The patch is a guess at where contact can be; the whole grid decides.
            if outside <= self.tolerance * tip[2]:
                return state
        raise SolverError(
            f"contact: {self.indenter.name} at depth {tip[2]:g} mm still penetrates by "
            f"{outside:.1e} mm outside the window that was solved"
        )

    # -- geometry ------------------------------------------------------------------------------

    def _moved(self, u: Field) -> Field | None:
        """The displacement that the indenter minds."""
        return u if self.kinematics == "deformed" else None

    # -- the coupled problem ---------------------------------------------------------------------

    def _solve_patch(
        self, patch: Patch, previous: ContactState, tip: Point
    ) -> tuple[Field, Field, float]:
        """Pressure (my, mx), shear (2, my, mx) and residual on a patch."""
        op, depth = patch.operator, tip[2]
        at = (patch.rows, patch.columns)
        goal = self.tolerance * depth
        rubs = self.observe_shear and self.friction > 0
        moves = self.kinematics == "deformed"
        before = np.moveaxis(previous.displacement_mm[at], -1, 0)[:2]
        target = before + _drag(previous.tip_mm, tip)[:, None, None]
        p = previous.pressure_mpa[at]
        q = np.zeros((2, *op.shape))
        # What pressure and friction tell each other: in-plane shift (2) and lift by shear (1).
        trial = np.concatenate([before, np.zeros((1, *op.shape))])
        if rubs:
            q[:] = np.moveaxis(previous.shear_mpa[at], -1, 0)
            trial[2] = op.normal_of_shear(q)
        mixer = Mixer()
        once = not rubs and not moves
        inner = goal / 4 if once else 1e-3 * depth
        slip_worst = 0.0
        for _ in range(self.max_alternations):
            gap = patch.height_mm(trial[:2] if moves else None) - depth + trial[2]
            p, worst, used = normal_contact(
                op, np.where(np.isfinite(gap), p, 0.0), gap, inner, self.max_iterations
            )
            self._applications += used
            if once:
                return p, q, worst / depth
            found = np.concatenate([op.shear_of_pressure(p), np.zeros((1, *op.shape))])
            if rubs:
                q, slip, slip_worst, used = friction_contact(
                    op, q, found[:2] - target, self.friction * p, inner, self.max_iterations
                )
                self.tangential_solves += 1
                self._applications += used
                found[:2] = target + slip
                found[2] = op.normal_of_shear(q)
            gap = patch.height_mm(found[:2] if moves else None) - depth + found[2]
            gap = gap + op.normal_of_pressure(p)
            self._applications += 3
            worst = max(normal_violation(gap, p), slip_worst)
            if worst <= goal:
                return p, q, worst / depth
            inner = max(goal / 4, min(0.02 * worst, inner))
            trial = mixer.next(trial, found)
        raise SolverError(
            f"contact: pressure and friction do not agree after {self.max_alternations} "
            f"alternations at depth {depth:g} mm: {worst / depth:.1e} of the depth, "
            f"{self.tolerance:.0e} is asked; shorter increments, less depth or less friction "
            "help (steep flanks under high friction lock, and have no solution at this level)"
        )

    # -- the result ------------------------------------------------------------------------------

    def _state(
        self, patch: Patch, p: Field, q: Field, residual: float, tip: Point
    ) -> tuple[ContactState, float]:
        """The state on the whole grid, and the worst penetration (mm) outside the patch."""
        layer = self.layer
        traction = np.concatenate([q, -p[None]])
        u = layer.apply_patch(traction, patch.rows.start, patch.columns.start)
        rows, columns, xx, yy = footprint(layer, self.indenter, tip, self._moved(u))
        gap = self.indenter.height_mm(xx, yy) - tip[2] - u[rows, columns, 2]
        inside = np.zeros(layer.shape, dtype=bool)
        inside[patch.rows, patch.columns] = True
        outside = -float(np.min(gap, where=~inside[rows, columns], initial=0.0))

        contact = p > 0
        x, y = layer.x_mm[patch.columns], layer.y_mm[patch.rows]
        at = u[patch.rows, patch.columns]
        arm = np.stack([*np.meshgrid(x, y), np.zeros(p.shape)])
        if self.kinematics == "deformed":
            arm += np.moveaxis(at, -1, 0)
        height = self.indenter.height_mm(arm[0] - tip[0], arm[1] - tip[1])
        refuse_bad_contact(layer, self.indenter, tip, height, contact, x, y)
        det = least_det(layer, u, tip)
        force = traction.sum(axis=(1, 2)) * layer.cell_mm2
        torque = np.cross(arm, traction, axis=0).sum(axis=(1, 2)) * layer.cell_mm2
        pressure, shear = np.zeros(layer.shape), np.zeros((*layer.shape, 2))
        pressure[patch.rows, patch.columns] = p
        shear[patch.rows, patch.columns] = np.moveaxis(q, 0, -1)
        nodes = int(contact.sum())
        state = ContactState(
            tip_mm=tip,
            pressure_mpa=pressure,
            shear_mpa=shear,
            displacement_mm=u,
            force_n=(float(force[0]), float(force[1]), float(force[2])),
            torque_nmm=(float(torque[0]), float(torque[1]), float(torque[2])),
            contact_area_mm2=nodes * layer.cell_mm2,
            contact_nodes=nodes,
            residual=residual,
            iterations=self._applications,
            converged=True,
            beyond_small_strain=tip[2] > SMALL_STRAIN * layer.thickness_mm * (1 + 1e-9),
            least_det=det,
        )
        return state, outside


def _drag(before: Point, now: Point) -> Field:
    """In-plane movement (2,) of the indenter while it touched: what lies above the face is free."""
    share = 1.0 if before[2] >= 0 else now[2] / (now[2] - before[2])
    return share * np.array([now[0] - before[0], now[1] - before[1]])


def _point(tip_mm: Point) -> Point:
    x, y, depth = (float(c) for c in tip_mm)
    if not all(math.isfinite(c) for c in (x, y, depth)):
        raise InputError(f"contact: tip (x, y, depth) must be finite: {(x, y, depth)} fails")
    return x, y, depth
