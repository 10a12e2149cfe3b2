"""One press of the gel by either level, answered on one lattice of the face."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...elasticity.block import FreeBlock
from ...elasticity.material import GelMaterial
from ...errors import RunFailed
from ...gel.level import Reach, follow
from ...gel.level_selection import pick
from ...gel.linear.contact import LinearContact
from ...gel.path.open import contact_of
from ...gel.press import press
from ...shapes import SkinDimensions
from ...shapes.indenter import parse
from .gel_press import LATTICE_MM, GelAnswer, PressSetup, solve_finite
from .gel_scene import SPHERE, GelCase


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
    """By the linear level, on a grid of the run's spacing."""
    skin, material, indenter = SkinDimensions(), GelMaterial(friction=run.friction), parse(SPHERE)
    choice = pick(skin, material, indenter, Reach(deepest_mm=run.depth_mm), level=run.level,
                  spacing_mm=run.spacing_mm)  # fmt: skip
    contact = contact_of(skin, material, indenter, choice, LATTICE_MM)
    *_, last = follow(contact, contact.rest(), (0.0, 0.0, run.depth_mm), contact.choice.step_mm)
    return GelAnswer(-last.force_n[2], last.displacement_mm[..., :2], {"dofs": contact.dofs})


def linear_breach(scene: GelCase, depth_mm: float, scratch: Path) -> tuple[float, str]:
    """Of a press and a drag of .3 mm at the linear level, the worst breach of contact.

    Penetration, a gap under pressure (both over the depth) and shear above friction x pressure (of
    its largest bound), worked out anew on the whole face.
    """
    face = FreeBlock(scene.skin(), scene.material(), scene.spacing_mm)
    contact = LinearContact(face, parse(scene.indenter))
    *_, pressed = follow(contact, contact.rest(), (0.0, 0.0, depth_mm), 0.3)
    state = contact.solve(pressed, (0.3, 0.0, depth_mm))
    traction = np.concatenate([state.shear_mpa, -state.pressure_mpa[..., None]], axis=-1)
    x, y = np.meshgrid(face.x_mm, face.y_mm)
    height = contact.indenter.height_mm(x + state.drag_mm[..., 0] - 0.3, y + state.drag_mm[..., 1])
    gap = height - depth_mm - face.apply(traction)[..., 2]
    bound = contact.friction * state.pressure_mpa
    excess = (np.hypot(*np.moveaxis(state.shear_mpa, -1, 0)) - bound).max() / bound.max()
    worst = max(-gap.min(), np.abs(gap[state.pressure_mpa > 0]).max()) / depth_mm
    fx, _, fz = state.force_n
    return float(max(worst, excess)), f"Fx {fx:+.3f} N, Fz {fz:+.3f} N"
