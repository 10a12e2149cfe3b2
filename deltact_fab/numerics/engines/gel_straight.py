"""Sharp tips straight down, with friction: whether the mesh makes a side force.

Edges and points slip over the cells' facets one after the other, each a small jump. Where symmetry
forbids a side force, all that is found is the mesh's.
"""

from __future__ import annotations

import math
from pathlib import Path

from ...gel.finite.field import whole_wrench
from .gel_scene import Scene, down, solved


def worst_side_force(
    scene: Scene, step_mm: float, depth_mm: float, scratch: Path
) -> tuple[float, str]:
    """The largest side force on the way over the normal force then, trusted states or not."""
    found = solved(scene, step_mm, down(depth_mm))
    worst, where, doubted = 0.0, 0.0, 0
    for state in found.states[1:]:
        x, y, z = whole_wrench(found.press.mesh, state)[0]
        share = math.hypot(x, y) / abs(z)
        if share > worst:
            worst, where = share, state.tip_mm[2]
        doubted += not state.trusted
    told = f"largest at {where:g} mm; {doubted} of {len(found.states) - 1} states not trusted"
    return worst, f"{told}; {found.note()}"
