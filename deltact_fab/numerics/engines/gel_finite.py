"""One press of the gel at finite strain, on a mesh that is named, answered on a lattice."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ...aliases import Field
from ...elasticity.material import GelMaterial
from ...gel.finite import FinitePress, block_mesh
from ...gel.finite.field import FaceLattice, whole_wrench
from ...gel.finite.linear import Name
from ...shapes import SkinDimensions
from ...shapes.indenter import parse

Part = Literal["quarter", "whole", "even"]

INDENTER = "sphere:15"
FOCUS = (-7.5, 7.5, -7.5, 7.5)
LATTICE_MM = 0.5
NORMAL = "sphere:15 pressed {depth:g} mm, {friction}"


@dataclass(frozen=True)
class PressSetup:
    """One way to compute the press.

    spacing_mm: of a grid or of cells; of `auto`, whose it is to choose, 0. part: of the block that
    is meshed; `even`: whole, cells of one size. step_mm: increments of the finite-strain level.
    """

    level: Literal["layer", "block", "hyperelastic", "auto"]
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
        return NORMAL.format(depth=self.depth_mm, friction=friction)


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


def solve(run: PressSetup) -> GelAnswer:
    """The press from nothing: mesh, factors and path. Raises what the gel raises."""
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
