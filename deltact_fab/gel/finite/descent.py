"""Descent to a minimum of the energy: for folds, where Newton's method fails.

With friction bounded by numbers that are held, an increment has a potential, and a gel that jumps
comes to rest in a minimum of it. Newton's steps are damped by the stiffness at rest, K + eta K0,
and taken if they lower the energy by a part of what the quadratic model promises, which also sets
eta (Levenberg and Marquardt as a trust region: Nocedal and Wright, Numerical Optimization, ch. 4).
The energy only falls, so it cannot run in circles.
"""

from __future__ import annotations

import numpy as np

from ...aliases import Field
from ...errors import SolverError
from .. import time_limit
from .linear import Solver
from .newton import NewtonSolution, size_of
from .pattern import Pattern
from .problem import Equilibrium

FIRST, MOST = 0.05, 1e6  # damping: begun with, given up beyond
MORE, LESS = 4.0, 0.5  # times the damping after a bad step, after a good one
GOOD, POOR, TAKEN = 0.7, 0.2, 1e-3  # energy lowered over what the model promised
NONE = 1e-3  # damping below which there is none
ENOUGH = 1e-4  # of the residual: from there Newton's method goes on
ROUNDING = 1e-12  # of the energy: changes that are not seen any more
MAX_ITERATIONS = 150


def descend(
    problem: Equilibrium,
    start_mm: Field,
    solver: Solver,
    pattern: Pattern,
    rest_data: Field,
    longest_mm: float,
) -> NewtonSolution:
    """From start_mm to a residual of ENOUGH, or as far as the energy's rounding lets see.

    longest_mm: largest displacement in one iteration. Raises SolverError after MAX_ITERATIONS.
    """
    x = start_mm
    now = problem.evaluate(x, None, True, True)
    if now is None:
        raise SolverError("descent: the start turns a cell inside out")
    done = NewtonSolution(x, now.pressure_mpa, size_of(now))
    eta = 0.0
    while done.residual > ENOUGH:
        time_limit.check()
        if done.iterations >= MAX_ITERATIONS or eta > MOST:
            raise SolverError(
                f"descent: residual {done.residual:.1e} after {done.iterations} iterations, "
                f"{ENOUGH:.0e} is needed"
            )
        assert now.data is not None
        data = now.data + eta * rest_data if eta else now.data
        solver.factorise(pattern.matrix(data))
        done.factorisations += 1
        done.damped += bool(eta)
        step = None if solver.negative else -solver.solve(now.residual_n)
        slope = 0.0 if step is None else float(now.residual_n @ step)  # = -step.(K + eta K0) step
        # Not every solver knows the inertia; of an indefinite matrix a step may lead up.
        if step is None or slope >= 0:
            eta = max(FIRST, MORE * eta)
            continue
        most = float(np.abs(step).max())
        part = min(1.0, longest_mm / most)
        promised = -slope * part * (1 - part / 2)
        step *= part
        trial = problem.evaluate(x + step, None, True, True)
        gained = -np.inf if trial is None else now.energy_nmm - trial.energy_nmm
        if promised <= ROUNDING * abs(now.energy_nmm):
            break
        share = gained / promised
        if share < POOR:
            eta = max(FIRST, MORE * eta)
        elif share > GOOD and part == 1.0:
            eta = LESS * eta if LESS * eta > NONE else 0.0
        if trial is None or share < TAKEN:
            continue
        x, now = x + step, trial
        done.iterations += 1
        done.residual = size_of(now)
    done.free_mm, done.pressure_mpa = x, now.pressure_mpa
    return done
