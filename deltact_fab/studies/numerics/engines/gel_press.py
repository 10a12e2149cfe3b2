"""Presses of the gel at finite strain: solved once, and what is read off them; the reference.

Each figure of a case is held against something independent: a finer mesh; the work of the indenter
along a frictionless path against the energy stored; what the base carries; mirror images; the cone.
The reference of the curves is the same press on two meshes, extrapolated, kept in the user's cache.
What a row of evidence depends on is read off the imports: the linear level stands in `gel`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Sequence
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

Box = tuple[float, float, float, float]
SPHERE = "sphere:15"
FOCUS: Box = (-7.5, 7.5, -7.5, 7.5)
FINER = 1.5  # ratio of the mesh that a force is held against


@dataclass(frozen=True)
class GelCase:
    """One indenter on one gel with its mesh or grid; hashable: what is solved is solved once."""

    indenter: str = SPHERE
    spacing_mm: float = 1.5
    friction: float = 0.0
    nu: float = 0.49
    side_mm: tuple[float, float] = (36.0, 34.0)
    thickness_mm: float = 12.0
    focus: Box | None = FOCUS
    mirrors: tuple[bool, bool] = (True, True)
    solver: SolverName = "auto"

    def skin(self) -> SkinDimensions:
        """Half of it stands proud."""
        proud = self.thickness_mm / 2
        return SkinDimensions(*self.side_mm, self.thickness_mm, min(2.0, proud / 2), proud)

    def material(self) -> GelMaterial:
        """Of the default modulus: another one scales the forces and nothing else."""
        return GelMaterial(poisson=self.nu, friction=self.friction)

    def press(self) -> FinitePress:
        """The scene's solver, without history."""
        return FinitePress.on_block(
            self.skin(), self.material(), parse_indenter(self.indenter), self.spacing_mm,
            self.focus, self.mirrors, self.solver,
        )  # fmt: skip

    def finer(self) -> GelCase:
        return replace(self, spacing_mm=self.spacing_mm / FINER)


@dataclass(frozen=True, eq=False)
class FiniteSolution:
    press: FinitePress
    states: tuple[FiniteState, ...]

    @property
    def last(self) -> FiniteState:
        return self.states[-1]

    @property
    def normal_n(self) -> float:
        """Force of the whole indenter at the end, positive when pressed."""
        return -self.last.force_n[2] * self.press.mesh.copies

    def note(self) -> str:
        """Force, penetration and what it took."""
        d = [s.diagnostics for s in self.states]
        return (
            f"{self.normal_n:.4g} N, {d[-1].penetration_mm:.2g} mm inside, "
            f"stretch {d[-1].most_stretch:.3g}, least J {min(x.least_j for x in d):.2g}, "
            f"{sum(x.iterations for x in d)} iterations, {sum(x.cuts for x in d)} cuts"
        )


@functools.cache
def solved(scene: GelCase, step_mm: float, *tips: Point) -> FiniteSolution:
    """From above the first tip through all tips in steps. Raises what the solver raises."""
    press = scene.press()
    states = [press.rest((tips[0][0], tips[0][1], 0.0))]
    for tip in tips:
        states += follow_path(press, states[-1], tip, step_mm)
    return FiniteSolution(press, tuple(states))


def trusted(found: FiniteSolution) -> FiniteSolution:
    """Raises Flagged where the last state is marked as not to be trusted."""
    if not found.last.trusted:
        d = found.last.diagnostics
        why = f"{d.penetration_mm:.2g} mm inside at depth {found.last.tip_mm[2]:g} mm"
        lagged = "; jumped, with the friction of the pressures before" if d.lagged else ""
        raise Flagged(f"not trusted: {why}{lagged}")
    return found


def down(depth_mm: float) -> Point:
    """The tip in the middle, at this depth."""
    return (0.0, 0.0, depth_mm)


# -- figures ---------------------------------------------------------------------------------------


def imbalance(found: FiniteSolution) -> float:
    """What the base does not carry, over the force; across a mirror the mirror carries too."""
    mirrors = (*found.press.mesh.mirrors, False)
    worst = 0.0
    for s in found.states:
        size = math.hypot(*s.force_n)
        if size > 0:
            left = [
                f + b for f, b, m in zip(s.force_n, s.base_force_n, mirrors, strict=True) if not m
            ]
            worst = max(worst, math.hypot(*left) / size)
    return worst


def cone_excess(found: FiniteSolution) -> float:
    """Shear beyond friction x pressure at a contact point, over the largest bound, end of path."""
    bound = found.press.friction * found.last.pressure_mpa
    size = np.linalg.norm(found.last.shear_mpa, axis=2)
    return float((size - bound).max() / bound.max())


def energy_nmm(press: FinitePress, state: FiniteState) -> float:
    """Stored in the gel and in the contact's penalty."""
    u, tip = state.displacement_mm, np.array(state.tip_mm)
    bulk = press.bulk.evaluate(u, False).energy_nmm
    return bulk + press.surface.evaluate(u, tip, tangent=False).energy_nmm


def work_error_percent(found: FiniteSolution) -> float:
    """Work of a frictionless straight press by Simpson's rule over the energy stored, less 1."""
    depth = np.array([s.tip_mm[2] for s in found.states])
    force = np.array([-s.force_n[2] for s in found.states])
    n = len(depth) - 1
    if n % 2:
        raise ValueError("an even number of steps is needed")
    weight = np.full(n + 1, 2.0)
    weight[1::2], weight[[0, -1]] = 4.0, 1.0
    work = float(weight @ force) * (depth[-1] - depth[0]) / n / 3
    return 100 * (work / energy_nmm(found.press, found.last) - 1)


# -- what a case computes: the figure that is held to a bound, and a note -------------------------


def finer(
    scene: GelCase, step_mm: float, tips: tuple[Point, ...], scratch: Path
) -> tuple[float, str]:
    """Force of the mesh over that of the finer one, less 1, in %."""
    found = trusted(solved(scene, step_mm, *tips))
    fine = solved(scene.finer(), step_mm, *tips)
    return 100 * (found.normal_n / fine.normal_n - 1), found.note()


def law(
    of: Callable[[FiniteSolution], float], scene: GelCase, step_mm: float,
    tips: tuple[Point, ...], scratch: Path,
) -> tuple[float, str]:  # fmt: skip
    """`cone_excess`, `imbalance` or `work_error_percent` of a path."""
    found = trusted(solved(scene, step_mm, *tips))
    return of(found), found.note()


def one_increment(scene: GelCase, depth_mm: float, scratch: Path) -> tuple[float, str]:
    """Force of a press in one step over that in ten, less 1."""
    one = solved(scene, depth_mm, down(depth_mm))
    many = solved(scene, depth_mm / 10, down(depth_mm))
    return one.normal_n / many.normal_n - 1, one.note()


def run(call: Callable[[], Any], scratch: Path) -> float:
    """For calls that must be refused: there is no figure."""
    call()
    return math.nan


LATTICE_MM = 0.5


@dataclass(frozen=True)
class PressSetup:
    """One way to compute the press.

    spacing_mm: of a grid or of cells; of `auto`, whose it is to choose, 0. step_mm: increments of
    the finite-strain level.
    """

    level: GelLevel
    depth_mm: float
    friction: float
    spacing_mm: float = 0.0
    step_mm: float = 1.0
    tolerance: float = 0.03

    @property
    def scene(self) -> GelCase:
        """A quarter of the block at finite strain."""
        return GelCase(SPHERE, self.spacing_mm, self.friction)

    @property
    def series(self) -> str:
        told = {"auto": "auto, by tolerance, estimate included",
                "hyperelastic": "hyperelastic, quarter"}  # fmt: skip
        return told.get(self.level, self.level)

    @property
    def name(self) -> str:
        auto = self.level == "auto"
        return f"tolerance {self.tolerance:g}" if auto else f"{self.spacing_mm:g} mm"

    @property
    def case(self) -> str:
        friction = f"friction {self.friction:g}" if self.friction else "no friction"
        return f"{SPHERE} pressed {self.depth_mm:g} mm, {friction}"


@dataclass(frozen=True, eq=False)
class GelAnswer:
    """normal_n: positive when pressed. in_plane_mm (ny, nx, 2) on the lattice. note: what it took.

    inner_s: seconds without the start of a process, where a process of its own was needed.
    """

    normal_n: float
    in_plane_mm: Field
    note: dict[str, Any]
    inner_s: float | None = None


def prepared(run: PressSetup) -> tuple[FinitePress, FaceLattice]:
    """Its mesh with the solver, and the lattice on it, laid as `path.open.contact_of` lays it."""
    press = run.scene.press()
    x, y = (
        np.linspace(-half, half, 2 * math.ceil(half / LATTICE_MM - 1e-9) + 1)
        for half in run.scene.skin().opening_half_mm
    )
    return press, FaceLattice(press.mesh, x, y)


def solve_finite(run: PressSetup) -> GelAnswer:
    """At finite strain on the run's mesh."""
    press, lattice = prepared(run)
    states = list(follow_path(press, press.rest(), (0.0, 0.0, run.depth_mm), run.step_mm))
    force, _ = press.wrench(states[-1])
    work = IncrementDiagnostics.combine([s.diagnostics for s in states])
    note = {"dofs": press.mesh.free_dofs, "solver": press.solver.name, **vars(work)}
    u = lattice.displacement_mm(states[-1].displacement_mm)[..., :2]
    return GelAnswer(-float(force[2]), u, note)


# -- the reference --------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PressReference:
    """The truth, and its own errors: in % of the force and in mm rms."""

    normal_n: float
    in_plane_mm: Field
    force_error: float
    in_plane_error: float


FINE, QUICK_FINE = (0.75, 0.5), (1.5, 1.0)  # coarser and finer cells
# What `reference` says of itself, measured; a slow test holds it to that.
OWN_ERROR = {
    # (depth, quick): % of the force, mm rms in plane
    (2.0, True): (0.24, 0.0042),
    (2.0, False): (0.17, 0.0015),
    (5.0, False): (0.08, 0.005),
}


def reference(depth_mm: float, quick: bool = False) -> PressReference:
    """Extrapolated from two meshes of a quarter, without friction."""
    cells = QUICK_FINE if quick else FINE
    return extrapolated(*kept(PressSetup("hyperelastic", depth_mm, 0.0, h) for h in cells), cells)


def kept(runs: Iterable[PressSetup]) -> tuple[list[float], list[Field]]:
    """Normal forces and in-plane displacements at finite strain; kept in the user's cache."""
    runs = list(runs)
    key = cache_key("studies.numerics.engines.gel_press", runs=runs, lattice=LATTICE_MM)
    store = Store("gel-reference")
    held: tuple[list[float], list[Field]] | None = store.read(key)
    if held is None:
        answers = [solve_finite(r) for r in runs]
        held = [a.normal_n for a in answers], [a.in_plane_mm for a in answers]
        store.write(key, held)
    return held


def extrapolated(
    normal_n: Sequence[float], in_plane_mm: Sequence[Field], cells_mm: tuple[float, float]
) -> PressReference:
    """From a coarser and a finer mesh. Its error: how far it lies from the finer one."""
    weight = 1 / ((cells_mm[0] / cells_mm[1]) ** 2 - 1)
    force = normal_n[1] + weight * (normal_n[1] - normal_n[0])
    u = in_plane_mm[1] + weight * (in_plane_mm[1] - in_plane_mm[0])
    return PressReference(force, u, 100 * abs(force / normal_n[1] - 1), rms_mm(u - in_plane_mm[1]))


def rms_mm(off: Field) -> float:
    """Of in-plane vectors (ny, nx, 2)."""
    return math.sqrt(float((off**2).sum(axis=-1).mean()))


def errors(answer: GelAnswer, truth: PressReference) -> tuple[float, float]:
    """Signed, in % of the force; in mm rms."""
    force = 100 * (answer.normal_n / truth.normal_n - 1)
    return force, rms_mm(answer.in_plane_mm - truth.in_plane_mm)
