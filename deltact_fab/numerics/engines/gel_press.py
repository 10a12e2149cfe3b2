"""One press of the gel at finite strain, answered on a lattice of the face, and the reference.

The reference is the same on two meshes, extrapolated, and is kept in the user's cache. What a row
of evidence depends on is read off the imports: the linear level stands in `gel_run`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ... import cache
from ...aliases import Field
from ...gel.finite import FinitePress
from ...gel.finite.field import FaceLattice, whole_wrench
from ...gel.level import Level
from .gel_scene import SPHERE, GelCase

LATTICE_MM = 0.5


@dataclass(frozen=True)
class PressSetup:
    """One way to compute the press.

    spacing_mm: of a grid or of cells; of `auto`, whose it is to choose, 0. step_mm: increments of
    the finite-strain level.
    """

    level: Level
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
        """As the curve is called."""
        told = {"auto": "auto, by tolerance, estimate included",
                "hyperelastic": "hyperelastic, quarter"}  # fmt: skip
        return told.get(self.level, self.level)

    @property
    def name(self) -> str:
        """As the point on the curve is called."""
        auto = self.level == "auto"
        return f"tolerance {self.tolerance:g}" if auto else f"{self.spacing_mm:g} mm"

    @property
    def case(self) -> str:
        """What is computed."""
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
    states = list(press.path(press.rest(), (0.0, 0.0, run.depth_mm), run.step_mm))
    force, _ = whole_wrench(press.mesh, states[-1])
    work = [s.diagnostics for s in states]
    note = {
        "dofs": press.mesh.free_dofs,
        "iterations": sum(d.iterations for d in work),
        "factorisations": sum(d.factorisations for d in work),
        "cuts": sum(d.cuts for d in work),
        "penetration_mm": work[-1].penetration_mm,
        "solver": press.solver.name,
    }
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
    return extrapolated(*solved(PressSetup("hyperelastic", depth_mm, 0.0, h) for h in cells), cells)


def solved(runs: Iterable[PressSetup]) -> tuple[list[float], list[Field]]:
    """Normal forces and in-plane displacements at finite strain; kept in the user's cache."""
    runs = list(runs)
    key = cache.key("numerics.engines.gel_press", runs=runs, lattice=LATTICE_MM)
    held = cache.get("gel-reference", key)
    if held is None:
        answers = [solve_finite(r) for r in runs]
        held = {
            "normal_n": [a.normal_n for a in answers],
            "in_plane_mm": [a.in_plane_mm.tolist() for a in answers],
        }
        cache.put("gel-reference", key, held)
    return held["normal_n"], [np.array(u) for u in held["in_plane_mm"]]


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
