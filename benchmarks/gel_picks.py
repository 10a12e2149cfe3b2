"""A press whose mesh the level picks itself."""

from __future__ import annotations

from pathlib import Path

from deltact_fab.elasticity.material import GelMaterial
from deltact_fab.gel.level import Reach, follow
from deltact_fab.gel.level_selection import pick
from deltact_fab.gel.path.open import contact_of
from deltact_fab.numerics.engines.gel_press import SPHERE, down
from deltact_fab.shapes import SkinDimensions
from deltact_fab.shapes.indenter import parse


def one_increment_of_the_level(
    depth_mm: float, spacing_mm: float, scratch: Path
) -> tuple[float, str]:
    """Force of a press with friction in one step over that in ten, less 1."""
    scene, reach = (SkinDimensions(), GelMaterial(), parse(SPHERE)), Reach(deepest_mm=depth_mm)
    choice = pick(*scene, reach, level="hyperelastic", spacing_mm=spacing_mm)
    contact = contact_of(*scene, choice)
    one = contact.solve(contact.rest(), down(depth_mm))
    *_, many = follow(contact, contact.rest(), down(depth_mm), depth_mm / 10)
    note = f"{-one.force_n[2]:.4g} N, {one.diagnostics.iterations} iterations"
    return one.force_n[2] / many.force_n[2] - 1, note
