"""One press of the gel by any of its levels, or by felupe, answered on one lattice of the face."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ...errors import RunFailed
from ...gel.choose import pick
from ...gel.finite import FinitePress, block_mesh
from ...gel.finite.field import FaceLattice, whole_wrench
from ...gel.finite.linear import Name
from ...gel.level import Reach
from ...gel.material import GelMaterial
from ...gel.open import contact_of
from ...gel.press import press
from ...shapes import SkinDimensions
from ...shapes.indenter import parse

Field = NDArray[np.float64]
Part = Literal["quarter", "whole", "even"]
PARTS: tuple[Part, ...] = ("quarter", "whole")

INDENTER = "sphere:15"
FOCUS = (-7.5, 7.5, -7.5, 7.5)
LATTICE_MM = 0.5
NORMAL = "sphere:15 pressed {depth:g} mm, {friction}"


@dataclass(frozen=True)
class Run:
    """One way to compute the press.

    spacing_mm: of a grid or of cells; of `auto`, whose it is to choose, 0. part: of the block that
    is meshed; `even`: whole, cells of one size. step_mm: increments of the finite-strain level.
    """

    level: Literal["layer", "block", "hyperelastic", "auto", "felupe"]
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
        if self.level == "felupe":
            return "felupe, whole, cells of one size"
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
class Answer:
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


def solve(run: Run) -> Answer:
    """The press from nothing: mesh, factors and path. Raises what the gel raises."""
    skin, material = SkinDimensions(), GelMaterial(friction=run.friction)
    indenter = parse(INDENTER)
    tip = (0.0, 0.0, run.depth_mm)
    if run.level == "auto":
        found = press(skin, material, indenter, (0.0, 0.0), run.depth_mm, tolerance=run.tolerance)
        if found.result["force_n"] is None:
            raise RunFailed(f"auto: {found.result['reason']}")
        step = round(LATTICE_MM / float(found.x_mm[1] - found.x_mm[0]))
        u = found.displacement_mm[::step, ::step, :2]
        kept = ("model", "error_estimate", "picked", "within_tolerance")
        return Answer(-found.result["force_n"][2], u, {k: found.result[k] for k in kept})
    if run.level in ("layer", "block"):
        choice = pick(skin, material, indenter, Reach(deepest_mm=run.depth_mm), level=run.level,
                      spacing_mm=run.spacing_mm)  # fmt: skip
        contact = contact_of(skin, material, indenter, choice, LATTICE_MM)
        *_, last = contact.path(contact.rest(), tip)
        return Answer(-last.force_n[2], last.displacement_mm[..., :2], {"dofs": contact.dofs})
    mirrors = (run.part == "quarter",) * 2
    focus = None if run.part == "even" else FOCUS
    mesh = block_mesh(skin, run.spacing_mm, focus, mirrors)
    finite = FinitePress(mesh, material, indenter, solver=run.solver)
    lattice = FaceLattice(mesh, *lattice_mm(skin))
    if run.level == "felupe":
        return _felupe(run, finite, lattice)
    states = list(finite.path(finite.rest(), tip, run.step_mm))
    force, _ = whole_wrench(mesh, states[-1])
    work = [s.diagnostics for s in states]
    note = {
        "dofs": mesh.free_dofs,
        "iterations": sum(d.iterations for d in work),
        "factorisations": sum(d.factorisations for d in work),
        "cuts": sum(d.cuts for d in work),
        "penetration_mm": work[-1].penetration_mm,
        "solver": finite.solver.name,
    }
    u = lattice.displacement_mm(states[-1].displacement_mm)[..., :2]
    return Answer(-float(force[2]), u, note)


def _felupe(run: Run, finite: FinitePress, lattice: FaceLattice) -> Answer:
    from ..peers import felupe_case, felupe_press

    n = max(1, math.ceil(run.depth_mm / run.step_mm - 1e-9))
    tips = [(0.0, 0.0, run.depth_mm * (i / n)) for i in range(1, n + 1)]
    found = felupe_press(felupe_case(finite, tips))
    if found is None:
        raise RunFailed("felupe: not run: no .venv-peers (make peers)")
    if not found["converged"]:
        raise RunFailed(f"felupe: {found['reason']}")
    u = np.zeros_like(finite.mesh.nodes_mm)
    u[found["surface"]] = found["displacement_mm"][-1]
    note = {
        "dofs": found["unknowns"],
        "iterations": int(np.sum(found["iterations"])),
        "version": found["felupe"],
        "setup_s": found["setup_s"],
        "press_s": found["press_s"],
        "solver_s": found["solver_s"],
    }
    inner = float(found["setup_s"] + found["press_s"])
    return Answer(-float(found["force_n"][-1][2]), lattice.displacement_mm(u)[..., :2], note, inner)
