"""A rigid indenter pressed into and dragged over a finite-strain block, from state to state."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from deltact_fab.common import Field, InputError, Point, SolverError
from deltact_fab.sensor import GelMaterial, Indenter, SkinDimensions

from ..level import IncrementDiagnostics
from . import newton
from .assembly import BulkAssembly, MatrixPattern
from .distance import SHARP_CELLS, blunted
from .linear import SolverName, make_solver
from .material import Memory, NeoHooke, Viscosity
from .mesh import FocusBox, HexMesh, block_mesh
from .newton import Equilibrium, NewtonSolution, descend
from .state import FiniteState, Guide, predict_start
from .surface import FrictionGrip, Surface

HIDDEN_LIMIT = 0.75  # most penetration, of the depth or of that at rest; docs/evidence/gel.md


def require_contact(
    surface: Surface, indenter: Indenter, cell_mm: float, previous: FiniteState, state: FiniteState
) -> None:
    """Raise SolverError where a tip hides between cells or contact is lost while advancing.

    indenter: without the mesh's rounding. cell_mm: side of the smallest face.
    """
    depth, penetration = state.tip_mm[2], state.diagnostics.penetration_mm
    if depth <= 0:
        return
    narrow = min(min(tip.half_mm) for tip in indenter.tips)
    if narrow < cell_mm / 2:
        raise SolverError(
            f"press: {indenter.name} is {2 * narrow:.2g} mm wide and not resolved by cells of "
            f"{cell_mm:.2g} mm; a finer mesh is needed"
        )
    # A thin tip may pass through the gel: then it is as deep inside as in the gel at rest.
    undisplaced = np.zeros_like(state.displacement_mm)
    unmoved = surface.deepest_mm(undisplaced, np.array(state.tip_mm))
    if penetration > max(HIDDEN_LIMIT * min(depth, unmoved), float(surface.width_mm.max())):
        raise SolverError(
            f"press: {indenter.name} is {penetration:.2g} mm inside the gel at depth {depth:g} mm: "
            "the contact points of this mesh do not resolve the tip; a finer one is needed"
        )
    # A tip may advance without contact into a dent of a relaxing gel.
    dented = state.overstress_mpa is not None and previous.contact_points == 0
    if state.contact_points == 0 and depth > previous.tip_mm[2] and not dented:
        raise SolverError(
            f"press: {indenter.name} lost contact while advancing to {depth:g} mm: it left the "
            "gel, or the contact points of this mesh do not resolve it"
        )


# By hand: tighter or more cost time; looser or fewer end more presses with an error.
NEWTON_TOLERANCE = 1e-8  # of `IncrementDiagnostics.residual`
MAX_FINITE_CUTS = 6  # halvings of one increment
MAX_MOVE_CELLS = 1.0  # cells that a node may move in one iteration, plus twice the tip's move
FORCE_FLOOR = 1e-2  # x E x thickness x cell size: least force that a residual is compared with
SHARP_POINTS = 5  # along a face's side under a sharp tip; measured, docs/evidence/gel.md


class FinitePress:
    """Contact of one indenter with one mesh. Holds no history: `solve` maps state to state.

    friction: Coulomb coefficient; None takes the material's; 0: frictionless.
    points: contact points along a face's side; None: 2, or SHARP_POINTS where a radius is below
    SHARP_CELLS cells, since a face that wraps it is stretched.
    """

    def __init__(
        self,
        mesh: HexMesh,
        material: GelMaterial,
        indenter: Indenter,
        friction: float | None = None,
        solver: SolverName = "auto",
        points: int | None = None,
    ) -> None:
        self.mesh, self.indenter = mesh, indenter
        self.friction = material.friction if friction is None else friction
        self.tolerance = NEWTON_TOLERANCE
        self.law = NeoHooke.from_material(material)
        self.viscosity = Viscosity.from_material(material, self.law)
        self.pattern = MatrixPattern(mesh, ~mesh.fixed)
        self.bulk = BulkAssembly(mesh, self.law, self.pattern)
        face_mm = _smallest_face_mm(mesh)
        sharp = indenter.edge_radius_mm < SHARP_CELLS * face_mm
        points = points or (SHARP_POINTS if sharp else 2)
        rounded = blunted(indenter, face_mm)
        self.surface = Surface(mesh, self.pattern, rounded, material.modulus_mpa, points)
        self.solver = make_solver(solver)
        self._rest_data = self.bulk.evaluate(np.zeros_like(mesh.nodes_mm)).data
        cell = self._cell_mm = float(np.sqrt(self.surface.weights_mm2.sum(axis=1).min()))
        floor_mpa = FORCE_FLOOR * material.modulus_mpa
        self.floor_n = floor_mpa * cell * float(np.ptp(mesh.nodes_mm[:, 2]))

    @classmethod
    def on_block(
        cls, skin: SkinDimensions, material: GelMaterial, indenter: Indenter, spacing_mm: float,
        focus: FocusBox | None = None, mirrors: tuple[bool, bool] = (False, False),
        solver: SolverName = "auto",
    ) -> FinitePress:  # fmt: skip
        """Press on a block of a skin, meshed by `block_mesh`."""
        return cls(block_mesh(skin, spacing_mm, focus, mirrors), material, indenter, solver=solver)

    def wrench(self, state: FiniteState) -> tuple[Field, Field]:
        """Force (3,) in N and torque (3,) in N mm on the whole body of a mirrored mesh."""
        force = np.array(state.force_n) * self.mesh.copies
        torque = np.array(state.torque_nmm) * self.mesh.copies
        for axis, mirror in enumerate(self.mesh.mirrors):
            if mirror:
                force[axis] = 0.0
                torque[np.arange(3) != axis] = 0.0
        return force, torque

    def rest(self, tip_mm: Point = (0.0, 0.0, 0.0)) -> FiniteState:
        shape = self.surface.weights_mm2.shape
        nothing = (0.0, 0.0, 0.0)
        return FiniteState(
            tip_mm, np.zeros_like(self.mesh.nodes_mm), np.zeros((*shape, 3)), np.zeros(shape),
            np.zeros((*shape, 3)), nothing, nothing, nothing, 0, np.zeros(len(self.mesh.cells)),
        )  # fmt: skip

    def solve(
        self,
        previous: FiniteState,
        tip_mm: Point,
        seconds: float | None = None,
        guide: Guide | None = None,
    ) -> FiniteState:
        """Solve one increment, halved where it does not converge.

        seconds: duration, 0 (sudden) to infinity (long rest), at constant speed; required (raises
        InputError) for a gel with a Prony series, else ignored. The same tip again is a hold.
        guide: increments of a coarser mesh on the same path, to start from.
        Raises SolverError when MAX_FINITE_CUTS do not help, or the tip slips through the mesh or
        loses contact while advancing.
        """
        _require_finite(tip_mm)
        if self.viscosity is not None and seconds is None:
            raise InputError(
                "press: a gel with a Prony series needs the duration of an increment in seconds: "
                "0 for a sudden one, inf for long rest"
            )
        start, move = np.array(previous.tip_mm), np.array(tip_mm) - np.array(previous.tip_mm)
        fraction, part, cuts = 0.0, 1.0, 0
        state, parts = previous, []
        change = None if guide is None else guide.change(previous.tip_mm, tip_mm)
        while fraction < 1.0:
            goal = min(1.0, fraction + part)
            tip = start + goal * move
            memory = self._memory(state, seconds, goal - fraction)
            try:
                target = tip_mm if goal == 1.0 else _point(tip)
                state = self._increment(state, target, memory, change)
            except SolverError as error:
                if change is not None:
                    change = None
                    continue
                cuts += 1
                part /= 2
                if part < 2.0**-MAX_FINITE_CUTS and part * np.linalg.norm(move) < self._cell_mm:
                    raise SolverError(
                        f"press: {self.indenter.name} at {_text(_point(tip))}: {error}; "
                        f"{MAX_FINITE_CUTS} halvings of the increment did not help"
                    ) from error
                continue
            change = None
            parts.append(state.diagnostics)
            fraction = goal
        require_contact(self.surface, self.indenter, self._cell_mm, previous, state)
        work = IncrementDiagnostics.combine(parts)
        return replace(state, diagnostics=replace(work, cuts=cuts))

    def _memory(self, state: FiniteState, seconds: float | None, part: float) -> Memory | None:
        if self.viscosity is None or seconds is None:
            return None
        f = self.bulk.deformation_gradient(state.displacement_mm)
        return self.viscosity.memory(f, state.overstress_mpa, seconds * part)

    def _increment(
        self,
        previous: FiniteState,
        tip_mm: Point,
        memory: Memory | None,
        change: tuple[Field, Field] | None = None,
    ) -> FiniteState:
        """Predict and solve by Newton's method; where that fails, minimise the energy.

        change: predicted change of displacements and cell pressures; None: the last increment's.

        The energy needs a fixed bound of friction, at the pressures of the start; from its minimum
        the bound is released. Where there is no equilibrium then, the fixed one is returned: its
        error is of first order in the increment, as friction's is anyway.
        """
        tip = np.array(tip_mm)
        u, pressure = predict_start(self.bulk, previous, tip, self._cell_mm, change)
        move = tip - np.array(previous.tip_mm)
        grip = self._grip(previous, move) if self.friction > 0 and tip_mm[2] > 0 else None
        longest = MAX_MOVE_CELLS * self._cell_mm + 2 * float(np.abs(move).max())

        def solve_newton(grip: FrictionGrip | None, start: Field, cells: Field) -> NewtonSolution:
            system = Equilibrium(self.bulk, self.surface, tip, grip, memory, self.floor_n)
            return newton.solve(
                system, start, cells, self.solver, self.pattern, self.tolerance, longest
            )

        lagged = 0
        try:
            solution = solve_newton(grip, u[self.pattern.free], pressure)
        except SolverError:
            if change is not None or float(np.linalg.norm(move)) > self._cell_mm * (1 + 1e-9):
                raise  # over a long move there may be several minima: cut the increment
            fixed_bound = grip and replace(grip, bound_mpa=grip.friction * previous.pressure_mpa)
            problem = Equilibrium(self.bulk, self.surface, tip, fixed_bound, memory, self.floor_n)
            low = descend(
                problem, u[self.pattern.free], self.solver, self.pattern, self._rest_data, longest
            )
            solution = solve_newton(fixed_bound, low.free_mm, low.pressure_mpa).add_work(low)
            if grip is not None:
                try:
                    final = solve_newton(grip, solution.free_mm, solution.pressure_mpa)
                    solution = final.add_work(solution)
                except SolverError:
                    grip, lagged = fixed_bound, 1
        return self._state(
            previous, tip_mm, self.pattern.expand(solution.free_mm), grip, solution, memory, lagged
        )

    def _grip(self, previous: FiniteState, move: Field) -> FrictionGrip:
        """History of the points in contact, and reference positions of those about to touch.

        A free point stays until the tip has moved the fraction t of its move that closes the gap,
        t = gap / (move . normal); from there on it slips. So a point that only sinks ahead of the
        tip has not slipped when it is touched.
        """
        start = np.array(previous.tip_mm)
        points = self.surface.points(previous.displacement_mm, start)
        contact = self.surface.evaluate(previous.displacement_mm, start, tangent=False)
        pressure, normal = contact.pressure_mpa, contact.gap.normal.reshape(points.shape)
        touching = pressure > 0
        free_gap = np.maximum(contact.gap.distance_mm.reshape(pressure.shape), 0.0)
        closing = normal @ move
        t = np.divide(free_gap, closing, out=np.ones_like(closing), where=closing > free_gap)
        coming = ~touching & (t < 1)
        points = np.where(coming[..., None], points - t[..., None] * move, points)
        normal = self.surface.normals(points)
        return FrictionGrip(points, previous.slip_mm, normal, touching | coming, self.friction)

    def _state(
        self, previous: FiniteState, tip_mm: Point, u: Field, grip: FrictionGrip | None,
        solution: NewtonSolution, memory: Memory | None, lagged: int,
    ) -> FiniteState:  # fmt: skip
        tip = np.array(tip_mm)
        bulk = self.bulk.evaluate(u, False, memory=memory)
        pressure = self.law.volumetric(bulk.jbar)[1]
        contact = self.surface.evaluate(u, tip, grip, tangent=False)
        pull = -contact.force_n
        nodes_mm = self.mesh.nodes_mm + u
        diagnostics = IncrementDiagnostics(
            iterations=solution.iterations,
            factorisations=solution.factorisations,
            damped=solution.damped,
            lagged=lagged,
            residual=solution.residual,
            penetration_mm=self.surface.deepest_mm(u, tip) if tip_mm[2] > 0 else 0.0,
            least_j=bulk.least_j,
            most_stretch=self._most_stretch(u),
        )
        overstress = None
        if self.viscosity is not None and memory is not None:
            overstress = self.viscosity.overstress(self.bulk.deformation_gradient(u), memory)
        return FiniteState(
            tip_mm=tip_mm,
            displacement_mm=u,
            # The elastic slip that carries the shear on to the next increment.
            slip_mm=-contact.shear_mpa / self.surface.grip_stiffness[..., None],
            pressure_mpa=contact.pressure_mpa,
            shear_mpa=contact.shear_mpa,
            force_n=_point(pull.sum(axis=0)),
            torque_nmm=_point(np.cross(nodes_mm, pull).sum(axis=0)),
            base_force_n=_point(bulk.force_n[self.mesh.base].sum(axis=0)),
            contact_points=int((contact.pressure_mpa > 0).sum()),
            cell_pressure_mpa=pressure,
            diagnostics=diagnostics,
            overstress_mpa=overstress,
            rate=(
                u - previous.displacement_mm,
                tip - np.array(previous.tip_mm),
                pressure - previous.cell_pressure_mpa,
            ),
        )

    def _most_stretch(self, u: Field) -> float:
        f = self.bulk.deformation_gradient(u)
        return float(np.sqrt(np.linalg.eigvalsh(np.swapaxes(f, 2, 3) @ f)[..., -1].max()))


def _smallest_face_mm(mesh: HexMesh) -> float:
    x = mesh.nodes_mm[mesh.faces]
    across = np.linalg.norm(np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]), axis=1) / 2
    return float(np.sqrt(across.min()))


def _require_finite(tip_mm: Point) -> None:
    if not all(math.isfinite(v) for v in tip_mm):
        raise InputError(f"press: tip_mm must be three finite numbers (got {tip_mm})")


def _point(v: Field) -> Point:
    return float(v[0]), float(v[1]), float(v[2])


def _text(tip: Point) -> str:
    return f"x {tip[0]:g}, y {tip[1]:g}, depth {tip[2]:g} mm"
