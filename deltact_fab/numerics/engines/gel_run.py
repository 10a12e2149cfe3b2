"""One press of the gel by any of its levels, answered on one lattice of the face."""

from __future__ import annotations

from ...elasticity.material import GelMaterial
from ...errors import RunFailed
from ...gel.level import Reach, follow
from ...gel.level_selection import pick
from ...gel.open import contact_of
from ...gel.press import press
from ...shapes import SkinDimensions
from ...shapes.indenter import parse
from .gel_press import LATTICE_MM, GelAnswer, PressSetup, solve_finite
from .gel_scene import SPHERE


def solve(run: PressSetup) -> GelAnswer:
    """The press from nothing: mesh, factors and path. Raises what the gel raises."""
    if run.level == "hyperelastic":
        return solve_finite(run)
    return solve_auto(run) if run.level == "auto" else solve_linear(run)


def solve_auto(run: PressSetup) -> GelAnswer:
    """As `gel press` does it, with its estimate."""
    material, indenter = GelMaterial(friction=run.friction), parse(SPHERE)
    found = press(SkinDimensions(), material, indenter, (0.0, 0.0), run.depth_mm,
                  tolerance=run.tolerance)  # fmt: skip
    if found.result["force_n"] is None:
        raise RunFailed(f"auto: {found.result['reason']}")
    step = round(LATTICE_MM / float(found.x_mm[1] - found.x_mm[0]))
    u = found.displacement_mm[::step, ::step, :2]
    kept = ("model", "error_estimate", "picked", "within_tolerance")
    return GelAnswer(-found.result["force_n"][2], u, {k: found.result[k] for k in kept})


def solve_linear(run: PressSetup) -> GelAnswer:
    """By the layer or the block, on a grid of the run's spacing."""
    skin, material, indenter = SkinDimensions(), GelMaterial(friction=run.friction), parse(SPHERE)
    choice = pick(skin, material, indenter, Reach(deepest_mm=run.depth_mm), level=run.level,
                  spacing_mm=run.spacing_mm)  # fmt: skip
    contact = contact_of(skin, material, indenter, choice, LATTICE_MM)
    *_, last = follow(contact, contact.rest(), (0.0, 0.0, run.depth_mm), contact.choice.step_mm)
    return GelAnswer(-last.force_n[2], last.displacement_mm[..., :2], {"dofs": contact.dofs})
