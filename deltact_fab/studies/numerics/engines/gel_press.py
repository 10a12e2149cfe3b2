"""Presses of the gel at finite strain, their check figures, and the reference solution.

Each figure has an independent check: a finer mesh; work of the indenter on a frictionless path
against the stored energy; force at the base; mirror images; the friction cone. The reference of the
curves is the same press on two meshes, extrapolated, kept in the user's cache.
A row of evidence depends on this module's imports: the linear level is in `gel`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.common import Field, Point, Store, cache_key
from deltact_fab.physics import (
    FaceLattice,
    FinitePress,
    FiniteState,
    GelLevel,
    IncrementDiagnostics,
    SolverName,
    follow_path,
)
from deltact_fab.sensor import GelMaterial, SkinDimensions, parse_indenter

from ..engine import Flagged

FocusBox = tuple[float, float, float, float]
SPHERE_INDENTER = "sphere:15"
DEFAULT_FOCUS: FocusBox = (-7.5, 7.5, -7.5, 7.5)  # by hand: the contact with margin, mm
FINER_MESH_RATIO = 1.5  # by hand: smaller shows less error, larger costs ratio^3 or more


@dataclass(frozen=True)
class GelCase:
    """One indenter on one gel with its mesh or grid; hashable, so solutions are cached."""

    indenter: str = SPHERE_INDENTER
    spacing_mm: float = 1.5
    friction: float = 0.0
    nu: float = 0.49
    side_mm: tuple[float, float] = (36.0, 34.0)
    thickness_mm: float = 12.0
    focus: FocusBox | None = DEFAULT_FOCUS
    mirrors: tuple[bool, bool] = (True, True)
    solver: SolverName = "auto"

    def skin(self) -> SkinDimensions:
        """Skin with half of its thickness proud."""
        proud = self.thickness_mm / 2
        return SkinDimensions(*self.side_mm, self.thickness_mm, min(2.0, proud / 2), proud)

    def material(self) -> GelMaterial:
        """Gel of the default modulus, which only scales the forces."""
        return GelMaterial(poisson=self.nu, friction=self.friction)

    def press(self) -> FinitePress:
        """Solver of the case, without history."""
        return FinitePress.on_block(
            self.skin(), self.material(), parse_indenter(self.indenter), self.spacing_mm,
            self.focus, self.mirrors, self.solver,
        )  # fmt: skip

    def finer(self) -> GelCase:
        return replace(self, spacing_mm=self.spacing_mm / FINER_MESH_RATIO)


@dataclass(frozen=True, eq=False)
class FiniteSolution:
    press: FinitePress
    states: tuple[FiniteState, ...]

    @property
    def last(self) -> FiniteState:
        return self.states[-1]

    @property
    def normal_n(self) -> float:
        """Final force on the whole indenter, positive when pressed."""
        return -self.last.force_n[2] * self.press.mesh.copies

    def note(self) -> str:
        """Summary: force, penetration, strain, iterations."""
        d = [s.diagnostics for s in self.states]
        return (
            f"{self.normal_n:.4g} N, {d[-1].penetration_mm:.2g} mm inside, "
            f"stretch {d[-1].most_stretch:.3g}, least J {min(x.least_j for x in d):.2g}, "
            f"{sum(x.iterations for x in d)} iterations, {sum(x.cuts for x in d)} cuts"
        )


@functools.cache
def solve_press(scene: GelCase, step_mm: float, *tips: Point) -> FiniteSolution:
    """Solve from above the first tip through all tips in steps. Raises the solver's errors."""
    press = scene.press()
    states = [press.rest((tips[0][0], tips[0][1], 0.0))]
    for tip in tips:
        states += follow_path(press, states[-1], tip, step_mm)
    return FiniteSolution(press, tuple(states))


def require_trusted(solution: FiniteSolution) -> FiniteSolution:
    """Return the solution. Raises Flagged if its last state is untrusted."""
    if not solution.last.trusted:
        d = solution.last.diagnostics
        reason = f"{d.penetration_mm:.2g} mm inside at depth {solution.last.tip_mm[2]:g} mm"
        lagged = "; jumped, with the friction of the pressures before" if d.lagged else ""
        raise Flagged(f"not trusted: {reason}{lagged}")
    return solution


def down(depth_mm: float) -> Point:
    """Tip position in the middle, at this depth."""
    return (0.0, 0.0, depth_mm)


# -- figures ---------------------------------------------------------------------------------------


def imbalance(solution: FiniteSolution) -> float:
    """Largest force residual at the base over the force, but across mirror planes."""
    mirrors = (*solution.press.mesh.mirrors, False)
    worst = 0.0
    for s in solution.states:
        size = math.hypot(*s.force_n)
        if size > 0:
            residual_n = [
                f + b for f, b, m in zip(s.force_n, s.base_force_n, mirrors, strict=True) if not m
            ]
            worst = max(worst, math.hypot(*residual_n) / size)
    return worst


def cone_excess(solution: FiniteSolution) -> float:
    """Largest excess of shear over friction x pressure in the last state, over the bound."""
    bound = solution.press.friction * solution.last.pressure_mpa
    size = np.linalg.norm(solution.last.shear_mpa, axis=2)
    return float((size - bound).max() / bound.max())


def energy_nmm(press: FinitePress, state: FiniteState) -> float:
    """Energy stored in the gel and the contact penalty, N mm."""
    u, tip = state.displacement_mm, np.array(state.tip_mm)
    bulk = press.bulk.evaluate(u, False).energy_nmm
    return bulk + press.surface.evaluate(u, tip, tangent=False).energy_nmm


def work_error_percent(solution: FiniteSolution) -> float:
    """Work of a frictionless press (Simpson's rule) over the stored energy, less 1, %."""
    depth = np.array([s.tip_mm[2] for s in solution.states])
    force = np.array([-s.force_n[2] for s in solution.states])
    n = len(depth) - 1
    if n % 2:
        raise ValueError("an even number of steps is needed")
    weight = np.full(n + 1, 2.0)
    weight[1::2], weight[[0, -1]] = 4.0, 1.0
    work = float(weight @ force) * (depth[-1] - depth[0]) / n / 3
    return 100 * (work / energy_nmm(solution.press, solution.last) - 1)


# -- checks of a case: the bounded figure, and a note ----------------------------------------------


def mesh_error_percent(
    scene: GelCase, step_mm: float, tips: tuple[Point, ...], scratch: Path
) -> tuple[float, str]:
    """Force of the mesh over that of the finer mesh, less 1, %."""
    solution = require_trusted(solve_press(scene, step_mm, *tips))
    fine = solve_press(scene.finer(), step_mm, *tips)
    return 100 * (solution.normal_n / fine.normal_n - 1), solution.note()


def evaluate_law(
    measure: Callable[[FiniteSolution], float], scene: GelCase, step_mm: float,
    tips: tuple[Point, ...], scratch: Path,
) -> tuple[float, str]:  # fmt: skip
    """`cone_excess`, `imbalance` or `work_error_percent` of a path."""
    solution = require_trusted(solve_press(scene, step_mm, *tips))
    return measure(solution), solution.note()


def one_increment(scene: GelCase, depth_mm: float, scratch: Path) -> tuple[float, str]:
    """Force of a press in one step over that in ten, less 1."""
    single = solve_press(scene, depth_mm, down(depth_mm))
    many = solve_press(scene, depth_mm / 10, down(depth_mm))
    return single.normal_n / many.normal_n - 1, single.note()


def expect_refusal(call: Callable[[], Any], scratch: Path) -> float:
    """Make a call that must be refused; NaN if it is not."""
    call()
    return math.nan


FACE_LATTICE_MM = 0.5  # by hand: finer compares more points, slower


@dataclass(frozen=True)
class PressSetup:
    """One way to compute the press.

    spacing_mm: of grid or cells; 0 for `auto`, which chooses it. step_mm: increments of the
    finite-strain level.
    """

    level: GelLevel
    depth_mm: float
    friction: float
    spacing_mm: float = 0.0
    step_mm: float = 1.0
    tolerance: float = 0.03

    @property
    def scene(self) -> GelCase:
        """Quarter of the block at finite strain."""
        return GelCase(SPHERE_INDENTER, self.spacing_mm, self.friction)

    @property
    def series(self) -> str:
        labels = {"auto": "auto, by tolerance, estimate included",
                "hyperelastic": "hyperelastic, quarter"}  # fmt: skip
        return labels.get(self.level, self.level)

    @property
    def name(self) -> str:
        auto = self.level == "auto"
        return f"tolerance {self.tolerance:g}" if auto else f"{self.spacing_mm:g} mm"

    @property
    def case(self) -> str:
        friction = f"friction {self.friction:g}" if self.friction else "no friction"
        return f"{SPHERE_INDENTER} pressed {self.depth_mm:g} mm, {friction}"


@dataclass(frozen=True, eq=False)
class GelAnswer:
    """normal_n: positive when pressed. in_plane_mm: (ny, nx, 2) on the lattice. note: solver data.

    inner_s: seconds without the start of the process, for solvers in one of their own.
    """

    normal_n: float
    in_plane_mm: Field
    note: dict[str, Any]
    inner_s: float | None = None


def mesh_and_lattice(run: PressSetup) -> tuple[FinitePress, FaceLattice]:
    """Mesh with solver, and the face lattice, placed as by `path.open.contact_of`."""
    press = run.scene.press()
    x, y = (
        np.linspace(-half, half, 2 * math.ceil(half / FACE_LATTICE_MM - 1e-9) + 1)
        for half in run.scene.skin().opening_half_mm
    )
    return press, FaceLattice(press.mesh, x, y)


def solve_finite(run: PressSetup) -> GelAnswer:
    """Solve at finite strain on the run's mesh."""
    press, lattice = mesh_and_lattice(run)
    states = list(follow_path(press, press.rest(), (0.0, 0.0, run.depth_mm), run.step_mm))
    force, _ = press.wrench(states[-1])
    work = IncrementDiagnostics.combine([s.diagnostics for s in states])
    note = {"dofs": press.mesh.free_dofs, "solver": press.solver.name, **vars(work)}
    u = lattice.displacement_mm(states[-1].displacement_mm)[..., :2]
    return GelAnswer(-float(force[2]), u, note)


# -- the reference --------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PressReference:
    """Reference solution and its errors, in % of the force and mm rms."""

    normal_n: float
    in_plane_mm: Field
    force_error: float
    in_plane_error: float


REFERENCE_CELLS_MM, QUICK_CELLS_MM = (0.75, 0.5), (1.5, 1.0)  # by hand: 0.5 mm takes a minute
# Errors of `reference`, measured (test_gel_engine.py, slow).
REFERENCE_ERROR = {
    # (depth, quick): % of the force, mm rms in plane
    (2.0, True): (0.24, 0.0042),
    (2.0, False): (0.17, 0.0015),
    (5.0, False): (0.08, 0.005),
}


def reference(depth_mm: float, quick: bool = False) -> PressReference:
    """Reference from two meshes of a quarter, without friction."""
    cells = QUICK_CELLS_MM if quick else REFERENCE_CELLS_MM
    runs = [PressSetup("hyperelastic", depth_mm, 0.0, h) for h in cells]
    return extrapolate(*cached_solutions(runs), cells)


def cached_solutions(runs: list[PressSetup]) -> tuple[list[float], list[Field]]:
    """Normal forces and in-plane displacements at finite strain, from the user's cache."""
    key = cache_key("studies.numerics.engines.gel_press", runs=runs, lattice=FACE_LATTICE_MM)
    store = Store("gel-reference")
    cached: tuple[list[float], list[Field]] | None = store.read(key)
    if cached is None:
        answers = [solve_finite(r) for r in runs]
        cached = [a.normal_n for a in answers], [a.in_plane_mm for a in answers]
        store.write(key, cached)
    return cached


def extrapolate(
    normal_n: Sequence[float], in_plane_mm: Sequence[Field], cells_mm: tuple[float, float]
) -> PressReference:
    """Richardson-extrapolate at second order; error: the change from the finer mesh."""
    weight = 1 / ((cells_mm[0] / cells_mm[1]) ** 2 - 1)
    force = normal_n[1] + weight * (normal_n[1] - normal_n[0])
    u = in_plane_mm[1] + weight * (in_plane_mm[1] - in_plane_mm[0])
    return PressReference(force, u, 100 * abs(force / normal_n[1] - 1), rms_mm(u - in_plane_mm[1]))


def rms_mm(vectors_mm: Field) -> float:
    """Root mean square length of in-plane vectors (ny, nx, 2)."""
    return math.sqrt(float((vectors_mm**2).sum(axis=-1).mean()))


def errors(answer: GelAnswer, truth: PressReference) -> tuple[float, float]:
    """Errors: signed, % of the force; in-plane, mm rms."""
    force = 100 * (answer.normal_n / truth.normal_n - 1)
    return force, rms_mm(answer.in_plane_mm - truth.in_plane_mm)
