"""Newton's method for a potential, with a line search; a factor is kept while it still works."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import SolverError

from .linear import Solver
from .pattern import Pattern

Field = NDArray[np.float64]

ARMIJO = 1e-4
SHORTEST = 2.0**-14
KEEP = 0.3  # a factor is kept while it reduces the residual at least to this
NEAR = 1e-2  # residual below which those terms are tried again
SHIFTS = (0.0, 0.05, 0.3, 2.0, 20.0)  # of the tangent at rest, added against negative curvature


class Evaluation(NamedTuple):
    """energy_nmm (inf: out of range); residual_n (size,); scale_n: what the residual is small to;
    data: CSR entries of the tangent or None."""

    energy_nmm: float
    residual_n: Field
    scale_n: float
    data: Field | None


Evaluate = Callable[[Field, bool, bool], Evaluation]


@dataclass
class Minimum:
    """free_mm (size,): the solution. residual: |r| / scale there. iterations, factorisations,
    halvings: work. shifted: factorisations that needed a positive matrix added. flattened: whether
    terms that may be negative had to be left out."""

    free_mm: Field
    residual: float
    iterations: int = 0
    factorisations: int = 0
    halvings: int = 0
    shifted: int = 0
    flattened: bool = False


def minimise(
    evaluate: Evaluate,
    start_mm: Field,
    solver: Solver,
    pattern: Pattern,
    rest_data: Field,
    tolerance: float,
    most_iterations: int = 60,
    factored: bool = False,
) -> Minimum:
    """A stationary point of the potential downhill of start_mm.

    evaluate(free_mm, tangent, curved): `curved` False leaves out terms that may be negative.
    rest_data: entries of a positive definite tangent, added in multiples where all else fails.
    factored: the solver holds the factor of a tangent nearby, which is tried first.
    Raises SolverError when |r| <= tolerance x scale is not reached; nothing else is returned.
    """
    x = start_mm
    now = evaluate(x, False, True)
    if not np.isfinite(now.energy_nmm):
        raise SolverError("newton: the start turns a cell inside out")
    done = Minimum(x, _size(now))
    fresh = factored
    while not done.residual <= tolerance:
        if done.iterations >= most_iterations:
            raise SolverError(
                f"newton: residual {done.residual:.1e} after {done.iterations} iterations, "
                f"{tolerance:.0e} is needed"
            )
        step = -solver.solve(now.residual_n) if fresh else None
        if step is None or not now.residual_n @ step < 0:
            fresh = False
            step = _direction(evaluate, x, now, solver, pattern, rest_data, done)
        found = _search(evaluate, x, step, now, done)
        if found is None:
            if fresh:
                fresh = False
                continue
            raise SolverError(
                f"newton: no shorter step lowers the energy, residual {done.residual:.1e}"
            )
        before = done.residual
        x, now = found
        done.residual = _size(now)
        done.iterations += 1
        fresh = done.residual <= KEEP * before
    done.free_mm = x
    return done


def _size(e: Evaluation) -> float:
    return float(np.linalg.norm(e.residual_n)) / e.scale_n


def _direction(
    evaluate: Evaluate,
    x: Field,
    now: Evaluation,
    solver: Solver,
    pattern: Pattern,
    rest_data: Field,
    done: Minimum,
) -> Field:
    """A Newton direction that descends.

    Against negative eigenvalues the terms that may be negative are left out; what the bulk then
    still has is left to the line search, or outweighed by rest_data where the step would climb.
    """
    curved = not done.flattened or done.residual < NEAR
    for shift in (0.0, *SHIFTS):
        data = evaluate(x, True, curved).data
        assert data is not None
        solver.factorise(pattern.matrix(data + shift * rest_data if shift else data))
        done.factorisations += 1
        done.shifted += bool(shift)
        last = curved
        curved = False
        if solver.negative and last:
            done.flattened = True
            continue
        step = -solver.solve(now.residual_n)
        if np.isfinite(step).all() and now.residual_n @ step < 0:
            return step
    raise SolverError("newton: no direction descends")


def _search(
    evaluate: Evaluate, x: Field, step: Field, now: Evaluation, done: Minimum
) -> tuple[Field, Evaluation] | None:
    """Halve the step until energy falls (Armijo) or, near the minimum, the slope has shrunk.

    Energies differ by less than rounding there, so the slope along the step decides.
    """
    slope = float(now.residual_n @ step)
    length = 1.0
    while length >= SHORTEST:
        trial = x + length * step
        new = evaluate(trial, False, True)
        if np.isfinite(new.energy_nmm):
            if new.energy_nmm <= now.energy_nmm + ARMIJO * length * slope:
                return trial, new
            noise = 1e-11 * (abs(now.energy_nmm) + now.scale_n * 1e-3)
            flat = abs(float(new.residual_n @ step)) <= 0.9 * abs(slope)
            if flat and new.energy_nmm <= now.energy_nmm + noise:
                return trial, new
            # Minimum of the parabola through both energies and the slope, kept within bounds.
            bend = new.energy_nmm - now.energy_nmm - length * slope
            best = -slope * length**2 / (2 * bend) if bend > 0 else length / 2
            length = min(max(best, 0.1 * length), 0.5 * length)
        else:
            length *= 0.5
        done.halvings += 1
    return None
