"""A press whose mesh the level picks itself."""

from __future__ import annotations

from pathlib import Path

from deltact_fab.physics.gel.level import Reach, follow_path
from deltact_fab.physics.gel.level_selection import select_level
from deltact_fab.physics.gel.path.open import open_contact
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions
from deltact_fab.studies.numerics.engines.gel_press import SPHERE_INDENTER, down


def one_increment_of_the_level(
    depth_mm: float, spacing_mm: float, scratch: Path
) -> tuple[float, str]:
    """Force of a press with friction in one step over that in ten, less 1."""
    scene, reach = (
        (SkinDimensions(), GelMaterial(), parse_indenter(SPHERE_INDENTER)),
        Reach(deepest_mm=depth_mm),
    )
    choice = select_level(*scene, reach, level="hyperelastic", spacing_mm=spacing_mm)
    contact = open_contact(*scene, choice)
    one = contact.solve(contact.rest(), down(depth_mm))
    *_, many = follow_path(contact, contact.rest(), down(depth_mm), depth_mm / 10)
    note = f"{-one.force_n[2]:.4g} N, {one.diagnostics.iterations} iterations"
    return one.force_n[2] / many.force_n[2] - 1, note
