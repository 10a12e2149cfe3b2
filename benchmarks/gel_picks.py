"""A press whose mesh the level picks itself."""

from __future__ import annotations

from pathlib import Path

from deltact_fab.elasticity.material import GelMaterial
from deltact_fab.gel.level import Reach
from deltact_fab.gel.open import open_contact
from deltact_fab.numerics.engines.gel_scene import SPHERE, down
from deltact_fab.shapes import SkinDimensions
from deltact_fab.shapes.indenter import parse


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
