"""One part to one gated solid: rules first, then the kernel, then the gate."""

from __future__ import annotations

from typing import Any

from . import feasibility
from .dimensions import Design
from .kernel import guarded
from .part import Part
from .solid_gate import SolidProperties, gate


def build_part(part: Part, design: Design) -> tuple[Any, SolidProperties]:
    """Build one part and gate it: a cadquery Solid and its measures.

    Raises InputError when a dimension breaks an inequality, before the kernel runs; RunFailed
    naming the part when the kernel fails or returns something else.
    """
    if part.indenter is None:
        feasibility.check(design)
    return build_from(part, part.source(design))


def build_from(part: Part, source: Any) -> tuple[Any, SolidProperties]:
    """The same from what `part.source` gives, whose inequalities hold already."""
    with guarded(part.name):
        return gate(part.name, part.build(source), part.box(source))
