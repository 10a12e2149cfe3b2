"""Lines of the gel's table for which `gel.choose` picks the mesh, or the level refuses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ...gel.choose import pick
from ...gel.level import Reach
from ...gel.material import GelMaterial
from ...gel.open import open_contact
from ...shapes import SkinDimensions
from ...shapes.indenter import parse
from .gel_scene import SPHERE, Scene, down


def thick(thickness_mm: float, share: float) -> tuple[Scene, float]:
    """A sphere pressed to a share of a gel's thickness; mesh and step as `gel press` picks them.

    On a thin gel all is smaller: its sides are many thicknesses away even so.
    """
    scene = Scene(thickness_mm=thickness_mm)
    if thickness_mm < 6:
        scene = replace(scene, indenter="sphere:6", side_mm=(14.0, 13.0))
    reach = Reach(deepest_mm=share * thickness_mm)
    choice = pick(scene.skin(), GelMaterial(), parse(scene.indenter), reach, level="hyperelastic",
                  friction=0.0)  # fmt: skip
    picked = replace(scene, spacing_mm=choice.spacing_mm, focus=choice.focus)
    return picked, choice.step_mm


def opened(depth_mm: float, reach_mm: float) -> None:
    """Through the interface of all levels, which knows the thickness."""
    contact = open_contact(
        SkinDimensions(), GelMaterial(), parse(SPHERE), level="hyperelastic",
        reach=Reach(deepest_mm=reach_mm),
    )  # fmt: skip
    list(contact.path(contact.rest(), down(depth_mm)))


def one_increment_of_the_level(
    depth_mm: float, spacing_mm: float, scratch: Path
) -> tuple[float, str]:
    """Force of a press with friction in one step over that in ten, less 1."""
    contact = open_contact(
        SkinDimensions(), GelMaterial(), parse(SPHERE), level="hyperelastic",
        reach=Reach(deepest_mm=depth_mm), spacing_mm=spacing_mm,
    )  # fmt: skip
    one = contact.solve(contact.rest(), down(depth_mm))
    *_, many = contact.path(contact.rest(), down(depth_mm), depth_mm / 10)
    note = f"{-one.force_n[2]:.4g} N, {one.diagnostics.iterations} iterations"
    return one.force_n[2] / many.force_n[2] - 1, note
