"""A rigid indenter pressed into and dragged over a block of finite strain, state to state."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError, SolverError
from ..material import GelMaterial
from ...shapes import Indenter

from .assembly import BulkAssembly
from .linear import Name, make_solver
from .material import NeoHooke
from .mesh import HexMesh
from .newton import Evaluation, minimise
from .pattern import Pattern
from .state import Diagnostics, FiniteState, Point, sum_of, with_diagnostics
from .surface import Contact, Grip, Surface

Field = NDArray[np.float64]

MOST_CUTS = 6  # halvings of one increment
HIDDEN_LIMIT = 0.5  # of the depth; beyond, the tip is not seen by the mesh
PREDICTABLE = 0.75  # of the smallest cell: longest move that is extrapolated
CONE = 2e-3  # of the largest bound: how far bounds may be from friction x pressure
CONE_LIMIT = 0.1  # the same, beyond which the increment is cut
ROUGH = 1e-4  # tolerance of solves whose bound is still an estimate
FLOOR = 1e-2  # x E x thickness x cell size: least force that a residual is compared with


class FinitePress:
    """Contact of one indenter with one mesh. Holds no history: `solve` maps state to state.

    friction: Coulomb coefficient; None takes the material's; 0 builds no friction at all.
    tolerance: of Diagnostics.residual. correctors: most solves repeated with the
    bound just found; none after the bound has settled to CONE of its largest value.
    """

    def __init__(
        self,
        mesh: HexMesh,
        material: GelMaterial,
        indenter: Indenter,
        friction: float | None = None,
        tolerance: float = 1e-8,
        correctors: int = 6,
        solver: Name = "auto",
        use_compiled: bool | None = None,
    ) -> None:
        friction = material.friction if friction is None else friction
        if not (math.isfinite(friction) and friction >= 0):
            raise InputError(f"press: friction >= 0 and finite: {friction} fails")
        if not 1e-12 <= tolerance <= 1e-3:
            raise InputError(f"press: tolerance must be 1e-12 to 1e-3: {tolerance} fails")
        self.mesh, self.indenter, self.friction = mesh, indenter, friction
        self.law = NeoHooke.of(material)
        self.tolerance, self.correctors = tolerance, correctors
        free = np.ones(mesh.nodes_mm.shape, dtype=bool)
        free[mesh.base] = False
        self.pattern = Pattern(mesh, free)
        self.bulk = BulkAssembly(mesh, self.law, self.pattern, use_compiled)
        self.surface = Surface(mesh, self.pattern, indenter, material.modulus_mpa)
        self.solver = make_solver(self.pattern.size, solver)
        at_rest = self.bulk.evaluate(np.zeros_like(mesh.nodes_mm)).data
        assert at_rest is not None
        self._rest_data = at_rest
        cell = self._cell_mm = float(np.sqrt(self.surface.weights_mm2.sum(axis=1).min()))
        self._floor_n = FLOOR * material.modulus_mpa * cell * float(np.ptp(mesh.nodes_mm[:, 2]))

    def rest(self, tip_mm: Point = (0.0, 0.0, 0.0)) -> FiniteState:
        """The state without contact: nothing displaced, nothing remembered."""
        f = len(self.mesh.touched)
        nothing = (0.0, 0.0, 0.0)
        return FiniteState(
            tip_mm, np.zeros_like(self.mesh.nodes_mm), np.zeros((f, 4, 3)), np.zeros((f, 4)),
            np.zeros((f, 4, 3)), nothing, nothing, nothing, 0.0, 0,
        )  # fmt: skip

    def path(
        self, previous: FiniteState, tip_mm: Point, max_step_mm: float = 1.0
    ) -> Iterator[FiniteState]:
        """Solve along the straight way to tip_mm in equal increments; above the face one does."""
        if not (math.isfinite(max_step_mm) and max_step_mm > 0):
            raise InputError(f"press: max_step_mm > 0 and finite: {max_step_mm} fails")
        start, end = np.array(previous.tip_mm), np.array(tip_mm, dtype=np.float64)
        n = max(1, math.ceil(float(np.linalg.norm(end - start)) / max_step_mm - 1e-9))
        state = previous
        for i in range(1, n + 1):
            state = self.solve(state, _point(start + (end - start) * (i / n)))
            yield state

    def solve(self, previous: FiniteState, tip_mm: Point) -> FiniteState:
        """One increment, cut in halves where it does not converge.

        Raises SolverError when MOST_CUTS do not help, when the tip slips through the mesh, and
        when contact is lost while the depth grows.
        """
        if not all(math.isfinite(v) for v in tip_mm):
            raise InputError(f"press: a tip at {tip_mm}: three finite numbers are needed")
        started = time.perf_counter()
        start, move = np.array(previous.tip_mm), np.array(tip_mm) - np.array(previous.tip_mm)
        done, part, cuts = 0.0, 1.0, 0
        state, work = previous, Diagnostics()
        while done < 1.0:
            goal = min(1.0, done + part)
            tip = start + goal * move
            try:
                state = self._increment(state, tip_mm if goal == 1.0 else _point(tip))
            except SolverError as why:
                cuts += 1
                part /= 2
                if part < 2.0**-MOST_CUTS:
                    raise SolverError(
                        f"press: {self.indenter.name} at {_text(_point(tip))}: {why}; "
                        f"{MOST_CUTS} halvings of the increment did not help"
                    ) from why
                continue
            work = sum_of(work, state.diagnostics)
            done = goal
        self._check(previous, state)
        last = state.diagnostics
        diagnostics = Diagnostics(
            work.iterations, work.factorisations, work.shifted, cuts, last.residual,
            last.penetration_mm, last.cone_excess, last.least_j, last.most_stretch,
            time.perf_counter() - started,
        )  # fmt: skip
        return with_diagnostics(state, diagnostics)

    def _increment(self, previous: FiniteState, tip_mm: Point) -> FiniteState:
        """Predict, solve with the bound of the start, solve again with the bound just found."""
        tip = np.array(tip_mm)
        u = self._predicted(previous, tip)
        at = self.surface.points(previous.displacement_mm, np.array(previous.tip_mm))
        grip: Grip | None = None
        work = Diagnostics()
        rubs = self.friction > 0
        if rubs:
            seen = self.surface.evaluate(
                previous.displacement_mm, np.array(previous.tip_mm), tangent=False
            )
            grip = self.surface.grip(at, previous.slip_mm, seen, self.friction)
        # Only the last solve has to be exact; the bounds before it are estimates anyway.
        settled = not rubs
        for k in range(2 + self.correctors):
            found = minimise(
                self._potential(tip, grip), u[self.pattern.free], self.solver, self.pattern,
                self._rest_data, self.tolerance if settled else max(ROUGH, self.tolerance),
                factored=k > 0,
            )  # fmt: skip
            u = self._whole(found.free_mm)
            work = sum_of(work, Diagnostics(found.iterations, found.factorisations, found.shifted))
            if settled:
                break
            seen = self.surface.evaluate(u, tip, tangent=False)
            excess = self._cone_excess(seen, grip)
            settled = excess <= CONE or k == self.correctors
            if excess > CONE:
                grip = self.surface.grip(at, previous.slip_mm, seen, self.friction)
        state = self._state(previous, tip_mm, u, grip, found.residual, work)
        if state.diagnostics.cone_excess > CONE_LIMIT:
            raise SolverError(
                f"press: friction x pressure still changes by {state.diagnostics.cone_excess:.0%} "
                f"after {self.correctors} corrections"
            )
        return state

    def _potential(self, tip: Field, grip: Grip | None):  # type: ignore[no-untyped-def]
        """The function that `minimise` takes: bulk and contact over the free displacements."""
        free = self.pattern.free

        def evaluate(x: Field, tangent: bool, curved: bool) -> Evaluation:
            u = self._whole(x)
            bulk = self.bulk.evaluate(u, tangent)
            if bulk.force_n is None:
                return Evaluation(np.inf, x, 1.0, None)
            contact = self.surface.evaluate(u, tip, grip, tangent, curved)
            residual = (bulk.force_n + contact.force_n)[free]
            scale = max(float(np.linalg.norm(contact.force_n)), self._floor_n)
            data = None if bulk.data is None else bulk.data + contact.data
            return Evaluation(bulk.energy_nmm + contact.energy_nmm, residual, scale, data)

        return evaluate

    def _whole(self, free_mm: Field) -> Field:
        u = np.zeros_like(self.mesh.nodes_mm)
        u[self.pattern.free] = free_mm
        return u

    def _predicted(self, previous: FiniteState, tip: Field) -> Field:
        """The last increment continued as far as the tip moves on in its direction."""
        u = previous.displacement_mm
        if previous.rate_mm is None:
            return u
        change, moved = previous.rate_mm
        move = tip - np.array(previous.tip_mm)
        length2 = float(moved @ moved)
        along = float(move @ moved) / length2 if length2 > 0 else 0.0
        # A turn of the path keeps nothing; backwards the contact does not come off as it went on.
        if along <= 0 or along**2 * length2 < 0.9 * float(move @ move):
            return u
        # A move of a cell or more shears cells so much that plain Newton takes half the factors.
        if float(move @ move) > (PREDICTABLE * self._cell_mm) ** 2:
            return u
        trial = u + min(along, 2.0) * change
        kept = self.bulk.evaluate(trial, False).least_j > 0.2 * previous.diagnostics.least_j
        return trial if kept else u

    def _state(
        self, previous: FiniteState, tip_mm: Point, u: Field, grip: Grip | None,
        residual: float, work: Diagnostics,
    ) -> FiniteState:  # fmt: skip
        tip = np.array(tip_mm)
        bulk = self.bulk.evaluate(u, False)
        assert bulk.force_n is not None
        contact = self.surface.evaluate(u, tip, grip, tangent=False)
        pull = -contact.force_n
        where = self.mesh.nodes_mm + u
        touched = contact.pressure_mpa > 0
        present = self.surface.weights_mm2 * self.surface.area_ratio(u)
        diagnostics = Diagnostics(
            iterations=work.iterations,
            factorisations=work.factorisations,
            shifted=work.shifted,
            residual=residual,
            penetration_mm=self.surface.deepest_mm(u, tip) if tip_mm[2] > 0 else 0.0,
            cone_excess=self._cone_excess(contact, grip),
            least_j=bulk.least_j,
            most_stretch=self._most_stretch(u),
        )
        return FiniteState(
            tip_mm=tip_mm,
            displacement_mm=u,
            slip_mm=self.surface.released_slip(contact),
            pressure_mpa=contact.pressure_mpa,
            shear_mpa=contact.shear_mpa,
            force_n=_point(pull.sum(axis=0)),
            torque_nmm=_point(np.cross(where, pull).sum(axis=0)),
            base_force_n=_point(bulk.force_n[self.mesh.base].sum(axis=0)),
            contact_area_mm2=float(present[touched].sum()),
            contact_points=int(touched.sum()),
            diagnostics=diagnostics,
            rate_mm=(u - previous.displacement_mm, tip - np.array(previous.tip_mm)),
        )

    def _cone_excess(self, seen: Contact, grip: Grip | None) -> float:
        """Largest difference of the frozen bound from friction x pressure, over the largest."""
        if grip is None:
            return 0.0
        bound = self.friction * seen.pressure_mpa
        most = float(max(bound.max(), grip.bound_mpa.max()))
        return float(np.abs(grip.bound_mpa - bound).max()) / most if most > 0 else 0.0

    def _most_stretch(self, u: Field) -> float:
        """Largest principal stretch over all points."""
        f = self.bulk.deformation_gradient(u)
        return float(np.sqrt(np.linalg.eigvalsh(np.swapaxes(f, 2, 3) @ f)[..., -1].max()))

    def _check(self, previous: FiniteState, state: FiniteState) -> None:
        depth = state.tip_mm[2]
        width = float(self.surface.width_mm.max())
        if depth <= 0:
            return
        if state.diagnostics.penetration_mm > max(HIDDEN_LIMIT * depth, width):
            raise SolverError(
                f"press: {self.indenter.name} is {state.diagnostics.penetration_mm:.2g} mm inside "
                f"the gel at depth {depth:g} mm: the tip hides between the contact points of "
                "this mesh, a finer one is needed"
            )
        if state.contact_points == 0 and depth > previous.tip_mm[2]:
            raise SolverError(
                f"press: {self.indenter.name} lost contact while advancing to {depth:g} mm"
            )


def _point(v: Field) -> Point:
    return float(v[0]), float(v[1]), float(v[2])


def _text(tip: Point) -> str:
    return f"x {tip[0]:g}, y {tip[1]:g}, depth {tip[2]:g} mm"
