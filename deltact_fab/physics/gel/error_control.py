"""A press solved on a sequence of meshes: extrapolation, error estimate, refinement to a tolerance.

Each mesh is MESH_RATIO times as fine as the one before and starts from its increments. Forces are
corrected to a hard contact (`finite.gel.lacking_n`) and, where the contact is smooth, extrapolated
from two meshes at second order. The contact's rim falls into the cells by chance, so what remains
is scatter: a mesh's is a factor of the kind of contact x a power of cell/contact radius, that of an
extrapolation follows, and it is never less than half of the correction. With friction, steps
STEP_RATIO times as large on the coarser mesh estimate the step error. The linear level adds its
model error by the measured rule of `linear.validity`. docs/evidence/gel.md tests the estimate on
presses that did not set the factors.

A CPU time limit (`time_limit`) shortens the sequence at both ends: where the first mesh costs too
much, coarser ones are solved first, and no mesh is started that is predicted to exceed the limit.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from deltact_fab.common import Field, Progress, SolverError, TimeLimit

from . import time_limit
from .finite.distance import SHARP_CELLS
from .level import FINITE_LEVEL, Choice
from .level_selection import FORCE_TOLERANCE, HIDDEN_RADII, IN_PLANE_MM, MAX_DOFS, STEP_SHARE
from .path.solver import PathSolver
from .zones import Zones

PressErrors = tuple[float, float]
"""Errors of the force, relative, and in plane, mm rms over the face."""
Opener = Callable[[Choice, PathSolver | None], PathSolver]


@dataclass(frozen=True)
class ContactKind:
    """Error of a mesh at one kind of contact, measured (docs/evidence/gel.md).

    scatter: x (cell/contact radius)^power: of the force, twice the standard deviation over the
    places of the rim in its cells. peak: x largest change of displacement between two meshes: error
    of its largest value. extrapolated: whether the force is, at second order.
    """

    scatter: float
    power: float
    peak: float
    extrapolated: bool


SMOOTH_CONTACT = ContactKind(scatter=0.055, power=1.3, peak=1.5, extrapolated=True)
SHARP_CONTACT = ContactKind(scatter=0.22, power=1.0, peak=2.0, extrapolated=False)
# Cells over the contact radius, of which the fit had none larger: docs/evidence/gel.md.
RESOLVED_CELLS, UNRESOLVED_POWER = 0.75, 3.0
CORRECTION_SHARE = 0.5  # by hand: least error, of the correction to finer cells
# Factors of the estimate, set on measured presses (docs/evidence/gel.md).
MESH_RATIO, STEP_RATIO = 1.5, 2.0  # by hand: smaller ones resolve less, larger ones waste a mesh
LONE_FACTOR = 3.0  # x scatter with a single mesh; in plane the whole field counts as error
MESH_IN_PLANE, STEP_IN_PLANE = 2.4, 1.75  # x change of displacement: local errors add up
LINEAR_FORCE, LINEAR_IN_PLANE = 0.9, 1.9  # x change with the grid of the linear level
# By hand, for the CPU time of a press: more and finer meshes cost more and change no estimate.
MIN_MESH_RATIO = 1.4  # least ratio of the cells of two meshes that are compared
COARSER_MESHES = 2  # number of meshes coarser than the requested one
FINER_MESHES = 3  # most meshes finer than it, sized by the estimate
FINEST_STEP = 0.25  # least factor of the steps
# Work is counted, not timed, so that a busy machine changes no result (docs/evidence/gel.md).
MAX_WORK = 1.2e7  # most increments x unknowns^WORK_POWER of a mesh, about a minute on one core
WORK_POWER = 1.3  # by hand, with INCREMENT_WORK a model of CPU time: errors misjudge time only
INCREMENT_WORK = 3e3  # by hand: fixed cost of an increment, in unknowns^WORK_POWER
WORK_S = 60 / MAX_WORK  # CPU time per unit of work, until it is measured
DOFS_POWER = 2.5  # unknowns grow with this power of 1/cell size; by hand, between area and volume
AIM_SHARE = 0.85  # of the tolerance, aimed at; by hand: nearer to 1 misses more often
MIN_FINER = 0.85  # by hand: largest cell factor of a next mesh; closer ones hardly differ
MAX_USEFUL_FACTOR = 0.9  # by hand: stop where the work affords no smaller cell factor


@dataclass(frozen=True, eq=False)
class RefinedPress:
    """The finest run and its estimates; limited: stopped by the CPU time limit.

    force_n (3,): at the end, corrected and extrapolated.
    """

    run: PathSolver
    force_n: Field
    estimate: dict[str, float]
    zones: Zones
    limited: bool


class MeshConvergence:
    """Error estimate and refinement of one path over a sequence of meshes.

    opener: opens the path's solver for a choice, and for the solver on a coarser mesh or None.
    unknowns: number for a choice, without building its mesh. radius_mm: contact radius at the
    deepest point. edge_mm: smallest edge radius of the indenter.
    """

    def __init__(
        self,
        opener: Opener,
        unknowns: Callable[[Choice], int],
        radius_mm: float,
        edge_mm: float,
        tolerance: float,
        progress: Progress | None = None,
    ) -> None:
        self._report = progress or (lambda count, total, label: None)
        self._open, self._radius_mm, self._edge_mm = opener, float(radius_mm), float(edge_mm)
        self._unknowns = unknowns
        self._work_s: list[float] = []  # measured CPU time per unit of work
        self.tolerance = tolerance
        self.in_plane_mm = IN_PLANE_MM * tolerance / FORCE_TOLERANCE
        self._runs: list[PathSolver] = []
        self._step_errors, self._steps_checked = (0.0, 0.0), False

    def excess(self, estimate: dict[str, float]) -> float:
        """The larger of the estimates, over its tolerance."""
        force, in_plane = estimate["force_rel"], estimate["displacement_mm"]
        return max(force / self.tolerance, in_plane / self.in_plane_mm)

    def better(self, refined: RefinedPress, cheaper: RefinedPress) -> RefinedPress:
        """The refined press, unless it misses the tolerance by more than the cheaper one."""
        if self.excess(refined.estimate) <= max(1.0, self.excess(cheaper.estimate)):
            return refined
        return replace(cheaper, limited=refined.limited)

    def meets_tolerance(self, estimate: dict[str, float]) -> bool:
        return self.excess(estimate) <= 1

    def refine(self, choice: Choice, free: bool) -> RefinedPress:
        """Return the finest run and its estimate; free: mesh and steps may differ from the choice.

        At the CPU time limit (`time_limit`) the best run so far is returned. Raises TimeLimit where
        there is none, SolverError where no mesh is solved.
        """
        self._runs, self._step_errors, self._steps_checked = [], (0.0, 0.0), False
        limited = False
        try:
            self._climb(choice, free)
        except TimeLimit:
            if not self._runs:
                raise
            limited = True
            choice = self._runs[-1].choice
            if choice.level == FINITE_LEVEL and choice.friction > 0 and not any(self._step_errors):
                # Step error not measured: use the rule by which the steps were chosen.
                self._step_errors = (LONE_FACTOR * STEP_SHARE * self.tolerance, 0.0)
        zones = self._runs[-1].last.zones.with_errors_at_least(self._runs[-2:][0].last.zones)
        return RefinedPress(self._runs[-1], self._force_n(), self.estimate(), zones, limited)

    def _climb(self, choice: Choice, free: bool) -> None:
        if choice.level != FINITE_LEVEL:
            self._runs.append(self._run(choice.times(MESH_RATIO)))
            self._runs.append(self._run(choice))
            return
        if free:
            choice = replace(choice, goal_mm=0.0)  # the estimate replaces the rule's cell size
        largest = HIDDEN_RADII * self._radius_mm / choice.spacing_mm
        below = [f for k in range(COARSER_MESHES, 0, -1) if (f := MESH_RATIO**k) <= largest]
        steps = len(self._open(choice, None).poses)
        while free and below and below[0] * MESH_RATIO <= largest:
            # Solved about three times, for the step error.
            if 3 * WORK_S * self._work(choice.times(below[0]), steps) < time_limit.remaining_s():
                break
            below.insert(0, below[0] * MESH_RATIO)
        for factor in below:
            choice = self._solve_coarser(choice, factor, free)
            if free and self._converged():
                return
        if not (free and self._runs):
            self._add(choice)
        for _ in range(FINER_MESHES if free else 0):
            if self._converged():
                return
            last = self._runs[-1]
            factor = affordable_factor(last, self._next_factor())
            if factor > MAX_USEFUL_FACTOR:
                return
            self._add(choice.times(factor * last.choice.spacing_mm / choice.spacing_mm))

    def _solve_coarser(self, choice: Choice, factor: float, free: bool) -> Choice:
        """Solve a coarser mesh and determine on it the steps that the tolerance needs."""
        min_step_mm, coarser_runs = choice.step_mm * FINEST_STEP, len(self._runs)
        while True:
            try:
                self._add(choice.times(factor))
            except SolverError:
                # Too coarse for the tip; the requested mesh may not be.
                del self._runs[coarser_runs:]
                return choice
            del self._runs[coarser_runs:-1]  # the same mesh with longer steps
            if choice.friction == 0 or self._steps_checked:
                return choice
            self._step_errors = self._errors_of_steps(self._runs[-1])
            goals = STEP_SHARE * self.tolerance, STEP_SHARE * self.in_plane_mm
            over = max(e / g for e, g in zip(self._step_errors, goals, strict=True))
            if not free or over <= 1 or choice.step_mm <= min_step_mm:
                self._steps_checked = True
                return choice
            choice = choice.times(1.0, min(max(1 / over, 0.5), 0.75))

    def _converged(self) -> bool:
        return len(self._runs) > 1 and self.meets_tolerance(self.estimate())

    def _add(self, choice: Choice) -> None:
        text = f"{choice.spacing_mm:.3g} mm, steps of {choice.step_mm:.3g} mm"
        choice = replace(choice, reason=f"{choice.reason}; taken {text}")
        self._runs.append(self._run(choice, self._runs[-1] if self._runs else None))

    def estimate(self) -> dict[str, float]:
        choice = self._runs[-1].choice
        force, in_plane = zip(self._mesh_errors(), self._step_errors, strict=True)
        return {
            "force_rel": choice.model_force_rel + sum(force),
            "displacement_mm": choice.model_in_plane_mm + sum(in_plane),
            "peak_in_plane_mm": self._peak_error_mm(),
        }

    def _coarser_runs(self) -> list[PathSolver]:
        """Runs enough coarser than the last one to be compared with it, the coarsest first."""
        limit_mm = MIN_MESH_RATIO * self._runs[-1].choice.spacing_mm
        return [r for r in self._runs if r.choice.spacing_mm >= limit_mm]

    def _kind(self) -> ContactKind:
        sharp = self._edge_mm < SHARP_CELLS * self._runs[-1].choice.spacing_mm
        return SHARP_CONTACT if sharp else SMOOTH_CONTACT

    def _extrapolate(self) -> tuple[Field, float]:
        """Change of the force to infinitely fine cells, (3,) in N, and its relative scatter."""
        fine, kind = self._runs[-1], self._kind()

        def scatter(run: PathSolver) -> float:
            cells = run.choice.spacing_mm / self._radius_mm
            unresolved = max(1.0, cells / RESOLVED_CELLS) ** UNRESOLVED_POWER
            return kind.scatter * cells**kind.power * unresolved

        best = np.zeros(3), LONE_FACTOR * scatter(fine)
        nearest: Field | None = None
        for coarse in reversed(self._coarser_runs()):
            weight = _second_order(fine, coarse)
            change_n = weight * (_hard_force_n(fine) - _hard_force_n(coarse))
            nearest = change_n if nearest is None else nearest
            # Cells too coarse for second order disagree with the next finer ones.
            discord = _relative_size(change_n - nearest, fine)
            error_rel = math.hypot((1 + weight) * scatter(fine), weight * scatter(coarse), discord)
            if error_rel < best[1]:
                best = change_n, error_rel
        return best if kind.extrapolated or not self._coarser_runs() else (best[0], scatter(fine))

    def _force_n(self) -> Field:
        force_n = _hard_force_n(self._runs[-1])
        if self._runs[-1].choice.level == FINITE_LEVEL and self._kind().extrapolated:
            force_n = force_n + self._extrapolate()[0]
        return force_n

    def _mesh_errors(self) -> PressErrors:
        fine = self._runs[-1]
        correction_n, scatter = self._extrapolate()
        if not (coarser := self._coarser_runs()):
            return (scatter, _rms_mm(_field_mm(fine)))
        force_n, in_plane = _change(fine, coarser[-1])
        if fine.choice.level != FINITE_LEVEL:
            return (LINEAR_FORCE * _relative_size(force_n, fine), LINEAR_IN_PLANE * in_plane)
        correction = CORRECTION_SHARE * _relative_size(correction_n, fine)
        in_plane *= MESH_IN_PLANE * _second_order(fine, coarser[-1])
        return (max(scatter, correction), in_plane)

    def _peak_error_mm(self) -> float:
        """Error of the largest in-plane displacement."""
        change_mm = _field_mm(self._runs[-1])
        if coarser := self._coarser_runs():
            change_mm = change_mm - _field_mm(coarser[-1])
        return self._kind().peak * float(np.hypot(change_mm[..., 0], change_mm[..., 1]).max())

    def _errors_of_steps(self, run: PathSolver) -> PressErrors:
        """Errors of a run from its step size: friction lags within each step."""
        choice = run.choice
        fewer = self._run(choice.times(1.0, STEP_RATIO), run)
        if sum(knot.cuts for knot in fewer.knots) == sum(knot.cuts for knot in run.knots):
            force, in_plane = _change(run, fewer)  # steps are of first order
            return (_relative_size(force, run), STEP_IN_PLANE * in_plane)
        # The longer steps were cut, so they do not differ from the run's: halve its steps.
        force, in_plane = _change(self._run(choice.times(1.0, 1 / STEP_RATIO)), run)
        return (STEP_RATIO * _relative_size(force, run), STEP_RATIO * STEP_IN_PLANE * in_plane)

    def _next_factor(self) -> float:
        """Cell factor at which the estimate is predicted to reach AIM_SHARE of the tolerance."""
        mesh, step = self._mesh_errors(), self._step_errors
        goals = AIM_SHARE * self.tolerance, AIM_SHARE * self.in_plane_mm
        factors = [
            (max(goal - s, goal / 4) / m) ** (1 / power) if m > 0 else 1.0
            for m, s, goal, power in zip(mesh, step, goals, (self._kind().power, 2), strict=True)
        ]
        return max(min(*factors, MIN_FINER), 1 / MESH_RATIO)

    def _run(self, choice: Choice, coarser: PathSolver | None = None) -> PathSolver:
        """Solve the path on a choice, starting from the increments of a coarser mesh."""
        solver = self._open(choice, coarser)
        solver.choice = choice
        label = f"{choice.level}, {choice.spacing_mm:.3g} mm"
        self._report(0, len(solver.poses), label)
        new = choice.level == FINITE_LEVEL and solver.stored is None
        if new:
            work = self._work(choice, len(solver.poses))
            # Use the least measured rate: the first run also loads libraries.
            time_limit.check(min(self._work_s, default=0.0) * work)
        start_s = time.thread_time()
        solver.solve_all(lambda count, total, _: self._report(count, total, label))
        if new:
            self._work_s.append((time.thread_time() - start_s) / work)
        return solver

    def _work(self, choice: Choice, increments: int) -> float:
        return increments * (self._unknowns(choice) ** WORK_POWER + INCREMENT_WORK)


def affordable_factor(run: PathSolver, factor: float) -> float:
    """Return the cell factor, enlarged to what MAX_DOFS and MAX_WORK allow."""
    dofs = run.dofs
    factor = max(factor, min(1.0, (dofs / MAX_DOFS) ** (1 / DOFS_POWER)))
    work = len(run.poses) * dofs**WORK_POWER / MAX_WORK
    return max(factor, min(1.0, work ** (1 / (DOFS_POWER * WORK_POWER))))


def _change(fine: PathSolver, coarse: PathSolver) -> tuple[Field, float]:
    """Change from a run to a coarser one: hard-contact force (3,) in N, in plane rms in mm."""
    force_n = _hard_force_n(coarse) - _hard_force_n(fine)
    return force_n, _rms_mm(_field_mm(coarse) - _field_mm(fine))


def _second_order(fine: PathSolver, coarse: PathSolver) -> float:
    """Weight of the change from coarse to fine cells that leads to infinitely fine ones."""
    return 1 / ((coarse.choice.spacing_mm / fine.choice.spacing_mm) ** 2 - 1)


def _hard_force_n(run: PathSolver) -> Field:
    """Force (3,) at the end with a hard contact."""
    return np.asarray((1 + run.last.lacking_rel) * np.array(run.last.force_n))


def _relative_size(force_n: Field, run: PathSolver) -> float:
    total_n = math.hypot(*run.last.force_n)
    return float(np.linalg.norm(force_n)) / total_n if total_n else 0.0


def _field_mm(run: PathSolver) -> Field:
    """The face's displacement at the end, (ny, nx, 3)."""
    field = run.last.displacement_mm
    assert field is not None, "the last field is observed"
    return field.astype(np.float64)


def _rms_mm(displacement_mm: Field) -> float:
    return math.sqrt(float((displacement_mm[..., :2] ** 2).sum(axis=-1).mean()))
