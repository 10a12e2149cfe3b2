"""One press of the gel at finite strain, answered on a lattice of the face, and the reference.

The reference is the same on two meshes, extrapolated, and is kept in the user's cache. What a row
of evidence depends on is read off the imports: the other levels stand in `gel_run`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from ... import cache, digest
from ...aliases import Field
from ...elasticity.material import GelMaterial
from ...gel.finite import FinitePress, block_mesh
from ...gel.finite.field import FaceLattice, whole_wrench
from ...gel.finite.linear import Name
from ...shapes import SkinDimensions
from ...shapes.indenter import parse
from .gel_scene import FOCUS

Part = Literal["quarter", "whole", "even"]
Level = Literal["layer", "block", "hyperelastic", "auto"]

INDENTER = "sphere:15"
LATTICE_MM = 0.5


@dataclass(frozen=True)
class PressSetup:
    """One way to compute the press.

    spacing_mm: of a grid or of cells; of `auto`, whose it is to choose, 0. part: of the block that
    is meshed; `even`: whole, cells of one size. step_mm: increments of the finite-strain level.
    """

    level: Level
    depth_mm: float
    friction: float
    spacing_mm: float = 0.0
    part: Part = "quarter"
    solver: Name = "auto"
    step_mm: float = 1.0
    tolerance: float = 0.03

    @property
    def series(self) -> str:
        """As the curve is called."""
        if self.level == "auto":
            return "auto, by tolerance, estimate included"
        if self.level != "hyperelastic":
            return self.level
        part = {"even": "whole, cells of one size"}.get(self.part, self.part)
        return f"hyperelastic, {part}" + ("" if self.solver == "auto" else f", {self.solver}")

    @property
    def name(self) -> str:
        """As the point on the curve is called."""
        return (
            f"tolerance {self.tolerance:g}" if self.level == "auto" else f"{self.spacing_mm:g} mm"
        )

    @property
    def case(self) -> str:
        """What is computed."""
        friction = f"friction {self.friction:g}" if self.friction else "no friction"
        return f"{INDENTER} pressed {self.depth_mm:g} mm, {friction}"


@dataclass(frozen=True, eq=False)
class GelAnswer:
    """normal_n: positive when pressed. in_plane_mm (ny, nx, 2) on the lattice. note: what it took.

    inner_s: seconds without the start of a process, where a process of its own was needed.
    """

    normal_n: float
    in_plane_mm: Field
    note: dict[str, Any]
    inner_s: float | None = None


def lattice_mm(skin: SkinDimensions) -> tuple[Field, Field]:
    """x (nx,) and y (ny,), as `open.contact_of` lays them."""
    counts = [math.ceil(half / LATTICE_MM - 1e-9) for half in skin.opening_half_mm]
    axes: list[Field] = [
        np.arange(-n, n + 1, dtype=np.float64) * (half / n)
        for n, half in zip(counts, skin.opening_half_mm, strict=True)
    ]
    return axes[0], axes[1]


def prepared(run: PressSetup) -> tuple[FinitePress, FaceLattice]:
    """Its mesh with the solver, and the lattice on it."""
    skin, material = SkinDimensions(), GelMaterial(friction=run.friction)
    focus = None if run.part == "even" else FOCUS
    mesh = block_mesh(skin, run.spacing_mm, focus, (run.part == "quarter",) * 2)
    press = FinitePress(mesh, material, parse(INDENTER), solver=run.solver)
    return press, FaceLattice(mesh, *lattice_mm(skin))


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


# Coarser and finer cells, steps, and steps of a second run on the coarser cells: friction remembers
# its path, and how finely that is cut is a first-order error of its own.
FINE: dict[bool, tuple[float, float, float, float | None]] = {
    True: (0.75, 0.5, 1.0, None),  # without friction
    False: (1.0, 0.75, 0.25, 0.125),
}
QUICK_FINE = (1.5, 1.0, 1.0, None)
# What `reference` says of itself, measured; a slow test holds it to that.
OWN_ERROR: dict[tuple[float, float, bool], tuple[float, float]] = {
    # (depth, friction, quick): % of the force, mm rms in plane
    (2.0, 0.0, True): (0.24, 0.0042),
    (2.0, 0.0, False): (0.17, 0.0015),
    (5.0, 0.0, False): (0.08, 0.005),
    (5.0, 0.5, False): (0.9, 0.018),
}


def reference(depth_mm: float, friction: float, quick: bool = False) -> PressReference:
    """Extrapolated from two meshes of a quarter, and two steps; kept in the user's cache."""
    coarse, fine, step, half = QUICK_FINE if quick else FINE[friction == 0]
    made = [(coarse, step), (fine, step), *([] if half is None else [(coarse, half)])]
    runs = [PressSetup("hyperelastic", depth_mm, friction, h, step_mm=s) for h, s in made]
    key = {
        "source": digest.of("numerics.engines.gel_press"),
        "runs": [asdict(r) for r in runs],
        "lattice": LATTICE_MM,
    }
    held = cache.get("gel-reference", key)
    if held is None:
        answers = [solve_finite(r) for r in runs]
        held = {
            "normal_n": [a.normal_n for a in answers],
            "in_plane_mm": [a.in_plane_mm.tolist() for a in answers],
        }
        cache.put("gel-reference", key, held)
    fields = [np.array(u) for u in held["in_plane_mm"]]
    return extrapolated(held["normal_n"], fields, coarse / fine)


def extrapolated(
    normal_n: Sequence[float], in_plane_mm: Sequence[Field], ratio: float
) -> PressReference:
    """From a coarser and a finer mesh, their cells in this ratio, and, where there is a third, the
    coarser one in half the steps. Its error: how far it lies from the finer mesh."""
    weight = 1 / (ratio**2 - 1)
    force = normal_n[1] + weight * (normal_n[1] - normal_n[0])
    u = in_plane_mm[1] + weight * (in_plane_mm[1] - in_plane_mm[0])
    if len(normal_n) > 2:
        force += 2 * (normal_n[2] - normal_n[0])
        u = u + 2 * (in_plane_mm[2] - in_plane_mm[0])
    off = rms_mm(u - in_plane_mm[1])
    return PressReference(force, u, 100 * abs(force / normal_n[1] - 1), off)


def rms_mm(off: Field) -> float:
    """Of in-plane vectors (ny, nx, 2)."""
    return math.sqrt(float((off**2).sum(axis=-1).mean()))


def errors(answer: GelAnswer, truth: PressReference) -> tuple[float, float]:
    """Signed, in % of the force; in mm rms."""
    force = 100 * (answer.normal_n / truth.normal_n - 1)
    return force, rms_mm(answer.in_plane_mm - truth.in_plane_mm)
