"""Newton's method for displacements and cell pressures.

With U'(J) as the only pressure, Newton is slow near incompressibility: a step of the right shape
changes volumes at second order, U' turns that into a large stress, and the tangent's geometric part
follows it. Here every cell has its own pressure p (the three-field form of Simo, Taylor and Pister
1985). Linearised, p = U'(J) + U''(J) dJ.du, so that p is eliminated: the matrix keeps its pattern,
its geometric part is formed with the predicted p, and the right-hand side is the residual of the
displacements alone. At the solution p = U'(J).

Shear of a slipping point is friction x pressure, so its tangent is not symmetric. Only the
symmetric part is factorised; the coupling of shear to pressure, at the few points in contact, is
added by GMRES with the factor as preconditioner.

Where a dragged gel folds, the equilibrium branch ends and the next one is far away: no step lowers
the residual, or the tangent has negative eigenvalues. `descend` solves those.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse.linalg as spla

from deltact_fab.common import Field, SolverError

from .. import time_limit
from .assembly import BulkAssembly, MatrixPattern
from .linear import Solver
from .material import Memory
from .surface import Coupling, FrictionGrip, Surface


class Evaluation(NamedTuple):
    """Unbalanced forces residual_n (size,) with p = U'(J), relative to scale_n.
    data: CSR entries of the tangent's symmetric part, if requested. pressure_mpa (m,): U'(J).
    energy_nmm: potential, where friction has one."""

    residual_n: Field
    scale_n: float
    data: Field
    pressure_mpa: Field
    energy_nmm: float


class Equilibrium:
    """Equations of one increment with the tip at (x, y, depth).

    floor_n: least force that a residual is compared with.
    """

    def __init__(
        self,
        bulk: BulkAssembly,
        surface: Surface,
        tip_mm: Field,
        grip: FrictionGrip | None,
        memory: Memory | None,
        floor_n: float,
    ) -> None:
        self._bulk, self._surface = bulk, surface
        self._tip, self._grip, self._memory = tip_mm, grip, memory
        self._floor_n = floor_n
        self._volume_terms: tuple[Field, Field] | None = None
        self._coupling: Coupling | None = None

    def evaluate(
        self, free_mm: Field, pressure_mpa: Field | None, tangent: bool, curved: bool
    ) -> Evaluation | None:
        """Evaluate at displacements (size,); None where a cell is inverted. pressure_mpa (m,): of
        the tangent's geometric part; None: U'(J). `curved` False drops terms of the tangent that
        may be negative."""
        u = self._bulk.pattern.expand(free_mm)
        bulk = self._bulk.evaluate(u, tangent, pressure_mpa, memory=self._memory)
        if not bulk.least_j > 0:
            return None
        _, first, second = self._bulk.law.volumetric(bulk.jbar)
        self._volume_terms = bulk.volume_rate_mm2, second
        contact = self._surface.evaluate(u, self._tip, self._grip, tangent, curved)
        residual = (bulk.force_n + contact.force_n)[self._bulk.pattern.free]
        scale = max(float(np.linalg.norm(contact.force_n)), self._floor_n)
        if tangent:
            self._coupling = contact.coupling
        data = bulk.data + contact.data
        return Evaluation(residual, scale, data, first, bulk.energy_nmm + contact.energy_nmm)

    def pressure_rate(self, step_mm: Field) -> Field:
        """Return U'' dJ.step (m,) at the displacements of the last evaluation."""
        assert self._volume_terms is not None
        rate, second = self._volume_terms
        return second * self._volume_change(rate, step_mm) / self._bulk.volumes_mm3

    def unbalance_n(self, free_mm: Field, pressure_mpa: Field) -> float | None:
        """Norm of the residual with given cell pressures; None where a cell is inverted."""
        u = self._bulk.pattern.expand(free_mm)
        bulk = self._bulk.evaluate(u, False, memory=self._memory)
        if not bulk.least_j > 0:
            return None
        contact = self._surface.evaluate(u, self._tip, self._grip, False)
        excess_mpa = pressure_mpa - self._bulk.law.volumetric(bulk.jbar)[1]
        force = bulk.force_n + contact.force_n
        excess_n = excess_mpa[:, None] * bulk.volume_rate_mm2
        force += self._bulk.scatter(excess_n.reshape(-1, 8, 3))
        return float(np.linalg.norm(force[self._bulk.pattern.free]))

    @property
    def couples(self) -> bool:
        """True if the last tangent has an unsymmetric part: shear follows pressure."""
        return self._coupling is not None and bool(self._coupling.gain_n_mm.any())

    def coupling_force(self, step_mm: Field) -> Field:
        assert self._coupling is not None
        pattern = self._bulk.pattern
        return self._surface.coupling_force(self._coupling, pattern.expand(step_mm))[pattern.free]

    def _volume_change(self, rate: Field, step_mm: Field) -> Field:
        step = self._bulk.pattern.expand(step_mm)[self._bulk.mesh.cells]
        return np.asarray(np.einsum("mk,mk->m", rate, step.reshape(rate.shape)))


# By hand: each trades factorisations against iterations; a solution meets the tolerance anyway.
KEEP_FACTOR = 0.2  # a factorisation is reused while it reduces the residual at least to this
STEP_LENGTHS = 3  # step lengths tried per direction
ROUNDING_RESIDUAL = 1e-6  # below it full steps are accepted: growth of the residual is rounding
NEAR_RESIDUAL = 1e-2  # below it negative eigenvalues may belong to the solution
WEAK_FACTOR, MAX_WEAK_STEPS = 0.7, 3  # steps that leave more of the residual; so many are a fold
GMRES_RTOL = 1e-3
GMRES_STEPS = 60
MAX_NEWTON_ITERATIONS = 60


@dataclass
class NewtonSolution:
    """Solution free_mm (size,) with residual |r| / scale. iterations, factorisations: work. damped:
    factorisations with damping. pressure_mpa (m,): of the cells, for the next tangent."""

    free_mm: Field
    pressure_mpa: Field
    residual: float
    iterations: int = 0
    factorisations: int = 0
    damped: int = 0

    def add_work(self, start: NewtonSolution) -> NewtonSolution:
        """Add the work of the solution that this one started from."""
        self.iterations += start.iterations
        self.factorisations += start.factorisations
        self.damped += start.damped
        return self


class _Step(NamedTuple):
    move_mm: Field
    pressure_mpa: Field  # change of the cells' pressures
    length: float  # of the whole direction


class _Direction:
    """Search directions from the factorised tangent, point after point."""

    def __init__(
        self, problem: Equilibrium, solver: Solver, pattern: MatrixPattern, solution: NewtonSolution
    ) -> None:
        self._problem, self._solver = problem, solver
        self._pattern, self._solution = pattern, solution
        self.curved = True
        self.reusable = False
        self._weak = 0

    def factorise(self, x: Field) -> None:
        """Factorise a positive matrix at x, dropping terms that may be negative where needed.
        Raises SolverError where that is not enough."""
        while True:
            time_limit.check()
            evaluation = self._problem.evaluate(x, self._solution.pressure_mpa, True, self.curved)
            assert evaluation is not None
            self._solver.factorise(self._pattern.matrix(evaluation.data))
            self._solution.factorisations += 1
            if not self._solver.negative or self._solution.residual <= NEAR_RESIDUAL:
                return
            if not self.curved:
                raise SolverError(f"newton: no minimum at residual {self._solution.residual:.1e}")
            self.curved = False

    def record_step(self, full_length: bool, previous: float) -> None:
        """Record a step from residual `previous`. Raises SolverError after three weak ones."""
        residual = self._solution.residual
        self.reusable = full_length and residual < KEEP_FACTOR * previous
        self.curved = self.curved or residual < NEAR_RESIDUAL
        weak = residual > max(WEAK_FACTOR * previous, ROUNDING_RESIDUAL)
        self._weak = self._weak + 1 if weak else 0
        if self._weak >= MAX_WEAK_STEPS:
            raise SolverError(f"newton: {MAX_WEAK_STEPS} steps left a residual of {residual:.1e}")

    def step_mm(self, residual_n: Field) -> Field:
        if not self._problem.couples:
            return -self._solver.solve(residual_n)
        n = len(residual_n)

        def apply(y: Field) -> Field:
            time_limit.check()
            return y + self._problem.coupling_force(self._solver.solve(y))

        operator = spla.LinearOperator((n, n), matvec=apply, dtype=np.float64)
        y, _ = spla.gmres(operator, -residual_n, rtol=GMRES_RTOL, restart=GMRES_STEPS, maxiter=1)
        return self._solver.solve(y)


def solve(
    problem: Equilibrium,
    start_mm: Field,
    pressure_mpa: Field,
    solver: Solver,
    pattern: MatrixPattern,
    tolerance: float,
    longest_mm: float = np.inf,
) -> NewtonSolution:
    """Solve for equilibrium from start_mm.

    pressure_mpa (m,): cell pressures for the first tangent.
    longest_mm: largest displacement in one iteration.
    Raises SolverError when |r| <= tolerance x scale is not reached, TimeLimit as `time_limit`.
    """
    x = start_mm
    current = problem.evaluate(x, pressure_mpa, False, True)
    if current is None:
        raise SolverError("newton: a cell is inverted at the start")
    solution = NewtonSolution(x, pressure_mpa, relative_residual(current))
    direction = _Direction(problem, solver, pattern, solution)
    while not solution.residual <= tolerance:
        if solution.iterations >= MAX_NEWTON_ITERATIONS:
            raise SolverError(
                f"newton: residual {solution.residual:.1e} after {solution.iterations} iterations, "
                f"{tolerance:.0e} is needed"
            )
        step = _step(problem, x, current, direction, longest_mm, solution)
        previous = solution.residual
        x = x + step.move_mm
        solution.pressure_mpa = current.pressure_mpa + step.pressure_mpa
        trial = problem.evaluate(x, solution.pressure_mpa, False, True)
        assert trial is not None
        current = trial
        solution.residual = relative_residual(current)
        solution.iterations += 1
        direction.record_step(step.length == 1.0, previous)
    solution.free_mm = x
    return solution


def relative_residual(e: Evaluation) -> float:
    return float(np.linalg.norm(e.residual_n)) / e.scale_n


def _step(
    problem: Equilibrium, x: Field, current: Evaluation, direction: _Direction, longest_mm: float,
    solution: NewtonSolution,
) -> _Step:  # fmt: skip
    """Return a step no longer than longest_mm that lowers the residual.

    The residual is taken with the predicted pressures: those of the volumes alone grow at second
    order in the step.
    """
    norm = float(np.linalg.norm(current.residual_n))
    while True:
        if not direction.reusable:
            direction.factorise(x)
        step = direction.step_mm(current.residual_n)
        peak_mm = float(np.abs(step).max())
        rate = problem.pressure_rate(step)
        length = min(1.0, longest_mm / peak_mm) if peak_mm > 0 else 1.0
        # A step ten times too long has no usable direction.
        for _ in range(STEP_LENGTHS if peak_mm <= 10 * longest_mm else 0):
            norm_n = problem.unbalance_n(x + length * step, current.pressure_mpa + length * rate)
            if norm_n is not None and (norm_n <= norm or solution.residual < ROUNDING_RESIDUAL):
                return _Step(length * step, length * rate, length)
            length /= 2
        if direction.reusable:
            direction.reusable = False
        elif direction.curved:
            direction.curved = False
        else:
            raise SolverError(f"newton: no step lowers the residual of {solution.residual:.1e}")


# By hand, as is usual for a trust region: speed of the descent, not its end.
FIRST_DAMPING, MAX_DAMPING = 0.05, 1e6  # first damping; failure above the largest
DAMPING_RISE, DAMPING_FALL = 4.0, 0.5  # factors after a poor and after a good step
GOOD_GAIN, POOR_GAIN, ACCEPTED_GAIN = 0.7, 0.2, 1e-3  # actual over predicted decrease of energy
MIN_DAMPING = 1e-3  # less counts as none
DESCENT_RESIDUAL = 1e-4  # relative; from there Newton's method continues
ENERGY_ROUNDING = 1e-12  # of the energy: smaller changes are rounding
MAX_DESCENT_STEPS = 150


def descend(
    problem: Equilibrium,
    start_mm: Field,
    solver: Solver,
    pattern: MatrixPattern,
    rest_data: Field,
    longest_mm: float,
) -> NewtonSolution:
    """Minimise the energy at folds, where Newton's method fails, to DESCENT_RESIDUAL or rounding.

    With fixed bounds of friction an increment has a potential, and a gel that jumps comes to rest
    in a minimum of it. Newton's steps are damped by the stiffness at rest, K + eta K0, and accepted
    if they lower the energy by a part of the decrease predicted by the quadratic model, which also
    sets eta (Levenberg-Marquardt as a trust region: Nocedal and Wright, Numerical Optimization,
    ch. 4). The energy only falls, so it cannot cycle.
    longest_mm: largest displacement in one iteration. Raises SolverError after MAX_DESCENT_STEPS.
    """
    x = start_mm
    current = problem.evaluate(x, None, True, True)
    if current is None:
        raise SolverError("descent: a cell is inverted at the start")
    solution = NewtonSolution(x, current.pressure_mpa, relative_residual(current))
    eta = 0.0
    while solution.residual > DESCENT_RESIDUAL:
        time_limit.check()
        if solution.iterations >= MAX_DESCENT_STEPS or eta > MAX_DAMPING:
            raise SolverError(
                f"descent: residual {solution.residual:.1e} after {solution.iterations} "
                f"iterations, {DESCENT_RESIDUAL:.0e} is needed"
            )
        data = current.data + eta * rest_data if eta else current.data
        solver.factorise(pattern.matrix(data))
        solution.factorisations += 1
        solution.damped += bool(eta)
        step = None if solver.negative else -solver.solve(current.residual_n)
        # slope = -step.(K + eta K0) step: may be positive where the solver returns no inertia.
        slope = 0.0 if step is None else float(current.residual_n @ step)
        if step is None or slope >= 0:
            eta = max(FIRST_DAMPING, DAMPING_RISE * eta)
            continue
        peak_mm = float(np.abs(step).max())
        part = min(1.0, longest_mm / peak_mm)
        promised = -slope * part * (1 - part / 2)
        step *= part
        trial = problem.evaluate(x + step, None, True, True)
        gained = -np.inf if trial is None else current.energy_nmm - trial.energy_nmm
        if promised <= ENERGY_ROUNDING * abs(current.energy_nmm):
            break
        share = gained / promised
        if share < POOR_GAIN:
            eta = max(FIRST_DAMPING, DAMPING_RISE * eta)
        elif share > GOOD_GAIN and part == 1.0:
            eta = DAMPING_FALL * eta if DAMPING_FALL * eta > MIN_DAMPING else 0.0
        if trial is None or share < ACCEPTED_GAIN:
            continue
        x, current = x + step, trial
        solution.iterations += 1
        solution.residual = relative_residual(current)
    solution.free_mm, solution.pressure_mpa = x, current.pressure_mpa
    return solution
