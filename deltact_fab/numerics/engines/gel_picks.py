"""Lines of the gel's table that go through the interface of all levels."""

from __future__ import annotations

from ...elasticity.material import GelMaterial
from ...gel.level import Reach
from ...gel.open import open_contact
from ...shapes import SkinDimensions
from ...shapes.indenter import parse
from .gel_scene import SPHERE, down


def opened(depth_mm: float, reach_mm: float) -> None:
    """Through the interface of all levels, which knows the thickness."""
    contact = open_contact(
        SkinDimensions(), GelMaterial(), parse(SPHERE), level="hyperelastic",
        reach=Reach(deepest_mm=reach_mm),
    )  # fmt: skip
    list(contact.path(contact.rest(), down(depth_mm)))
