"""Newton's method for displacements and cell pressures, the pressures eliminated cell by cell.

With U'(J) as the only pressure, Newton is slow near incompressibility: a step that is right in
shape changes volumes at second order, U' makes a large stress of that, and the tangent's geometric
part follows it. Here every cell carries a pressure p of its own (the three-field form of Simo,
Taylor and Pister 1985). Linearised, p = U'(J) + U''(J) dJ.du, so that p leaves the equations again:
the matrix keeps its pattern, its geometric part is formed with the predicted p, and the right-hand
side is the residual of the displacements alone. Where that vanishes, p is U'(J).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ...errors import SolverError
from .linear import Solver
from .pattern import Pattern

Field = NDArray[np.float64]

KEEP = 0.2  # a factor is kept while it reduces the residual at least to this
OVERSHOT = 0.9  # of the slope at the start: beyond, the step is shortened
SEARCHES = 6
SHORTEST = 1e-3
SURE = 1e-6  # residual below which steps are taken whole
NEAR = 1e-2  # residual below which terms that may be negative are tried again
WILD = 1e4  # times the smallest residual so far, after SETTLING iterations: hopeless
SETTLING = 8
SHIFTS = (0.0, 0.02, 0.1, 0.5, 3.0)  # of the tangent at rest, added against negative curvature


class Evaluation(NamedTuple):
    """residual_n (size,): unbalanced forces, p = U'(J). scale_n: what they are small to.
    data: CSR entries of the tangent or None. pressure_mpa (m,): U'(J) of the cells."""

    residual_n: Field
    scale_n: float
    data: Field | None
    pressure_mpa: Field


class Problem(Protocol):
    """What is solved: see `press`."""

    def evaluate(
        self, free_mm: Field, pressure_mpa: Field, tangent: bool, curved: bool
    ) -> Evaluation | None:
        """At displacements (size,); None where a cell is turned inside out. `curved` False leaves
        out terms of the tangent that may be negative."""

    def pressure_rate(self, step_mm: Field) -> Field:
        """U'' dJ.step (m,) at the displacements of the last evaluation."""

    def slope(self, free_mm: Field, pressure_mpa: Field, step_mm: Field) -> float | None:
        """Residual with given cell pressures times a step; None if inside out."""


@dataclass
class Solution:
    """free_mm (size,). residual: |r| / scale. iterations, factorisations, halvings: work.
    shifted: factorisations with a positive matrix added. flattened: whether terms that may be
    negative were left out. pressure_mpa (m,): of the cells, for the next tangent."""

    free_mm: Field
    pressure_mpa: Field
    residual: float
    iterations: int = 0
    factorisations: int = 0
    halvings: int = 0
    shifted: int = 0
    flattened: bool = False


def solve(
    problem: Problem,
    start_mm: Field,
    pressure_mpa: Field,
    solver: Solver,
    pattern: Pattern,
    rest_data: Field,
    tolerance: float,
    longest_mm: float = np.inf,
    most_iterations: int = 40,
    factored: bool = False,
) -> Solution:
    """Equilibrium from start_mm on.

    pressure_mpa (m,): cell pressures for the first tangent.
    rest_data: entries of a positive definite tangent, added in multiples where all else fails.
    longest_mm: displacement in one iteration beyond which the tangent is weighted.
    factored: the solver holds the factor of a tangent nearby, which is tried first.
    Raises SolverError when |r| <= tolerance x scale is not reached; nothing else is returned.
    """
    x = start_mm
    now = problem.evaluate(x, pressure_mpa, False, True)
    if now is None:
        raise SolverError("newton: the start turns a cell inside out")
    done = Solution(x, pressure_mpa, _size(now))
    fresh, best = factored, done.residual
    while not done.residual <= tolerance:
        if done.iterations >= most_iterations:
            raise SolverError(
                f"newton: residual {done.residual:.1e} after {done.iterations} iterations, "
                f"{tolerance:.0e} is needed"
            )
        if done.iterations >= SETTLING and done.residual > WILD * best:
            raise SolverError(f"newton: residual {done.residual:.1e}, growing")
        step = -solver.solve(now.residual_n) if fresh else None
        if step is None or not (np.isfinite(step).all() and now.residual_n @ step < 0):
            fresh = False
            step = _direction(problem, x, now, solver, pattern, rest_data, longest_mm, done)
        length, pressure = _search(problem, x, step, now, done)
        if not length > 0:
            if fresh:
                fresh = False
                continue
            raise SolverError(f"newton: every step turns a cell inside out ({done.residual:.1e})")
        before = done.residual
        x = x + length * step
        done.pressure_mpa = pressure
        after = problem.evaluate(x, pressure, False, True)
        assert after is not None
        now = after
        done.residual = _size(now)
        done.iterations += 1
        best = min(best, done.residual)
        fresh = done.residual <= KEEP * before
    done.free_mm = x
    return done


def _size(e: Evaluation) -> float:
    return float(np.linalg.norm(e.residual_n)) / e.scale_n


def _direction(
    problem: Problem,
    x: Field,
    now: Evaluation,
    solver: Solver,
    pattern: Pattern,
    rest_data: Field,
    longest_mm: float,
    done: Solution,
) -> Field:
    """A Newton direction that descends, no longer than `longest_mm` where that can be had.

    Against negative eigenvalues the terms that may be negative are left out; what the bulk then
    still has is outweighed by rest_data. Where the gel folds or snaps the tangent is all but
    singular: a full step runs for centimetres, and the weighted one follows the way down instead.
    """
    curved = not done.flattened or done.residual < NEAR
    best: Field | None = None
    for shift in (0.0, *SHIFTS):
        found = problem.evaluate(x, done.pressure_mpa, True, curved)
        assert found is not None
        assert found.data is not None
        solver.factorise(pattern.matrix(found.data + shift * rest_data if shift else found.data))
        done.factorisations += 1
        done.shifted += bool(shift)
        last = curved
        curved = False
        if solver.negative and last:
            done.flattened = True
            continue
        step = -solver.solve(now.residual_n)
        if not (np.isfinite(step).all() and now.residual_n @ step < 0):
            continue
        best = step
        if not solver.negative and float(np.abs(step).max()) <= longest_mm:
            return step
    if best is not None:
        return best
    raise SolverError("newton: no direction descends")


def _search(
    problem: Problem, x: Field, step: Field, now: Evaluation, done: Solution
) -> tuple[float, Field]:
    """Length of the step, 0 if none is allowed, and the pressures that go with it.

    There is no energy to lower while pressures are free: the length is a zero of the slope along
    the step, found roughly by regula falsi, and only where the full step runs far past it.
    """
    rate = problem.pressure_rate(step)
    start = float(now.residual_n @ step)
    low, low_slope, length = 0.0, start, 1.0
    high, high_slope = 0.0, 0.0
    for _ in range(SEARCHES):
        pressure = now.pressure_mpa + length * rate
        slope = problem.slope(x + length * step, pressure, step)
        # So near the end the slopes are rounding.
        if slope is not None and (done.residual < SURE or slope <= OVERSHOT * abs(start)):
            return length, pressure
        done.halvings += 1
        if slope is None:
            length *= 0.5
            continue
        high, high_slope = length, slope
        root = low - low_slope * (high - low) / (high_slope - low_slope)
        length = min(max(root, 0.1 * high), 0.7 * high)
        if length < SHORTEST:
            break
    while length >= SHORTEST / 16:
        pressure = now.pressure_mpa + length * rate
        if problem.slope(x + length * step, pressure, step) is not None:
            return length, pressure
        length *= 0.5
    return 0.0, now.pressure_mpa
