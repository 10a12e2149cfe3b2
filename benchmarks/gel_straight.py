"""Sharp tips straight down, with friction: whether the mesh makes a side force.

Edges and points slip over the cells' facets one after the other, each a small jump. Where symmetry
forbids a side force, all that is found is the mesh's.
"""

from __future__ import annotations

import math
from pathlib import Path

from deltact_fab.errors import SolverError
from deltact_fab.gel.finite.gel import whole_wrench
from deltact_fab.gel.finite.state import PENETRATION_LIMIT
from deltact_fab.numerics.engine import Flagged
from deltact_fab.numerics.engines.gel_press import GelCase, down


def worst_side_force(
    scene: GelCase, step_mm: float, depth_mm: float, most: float, scratch: Path
) -> tuple[float, str]:
    """The largest side force on the way over the normal force then.

    most: that is allowed. Where the solver refuses to go on, or the indenter comes too deep inside
    the gel that it was not in before, Flagged is raised with what was found until then, unless that
    was over `most`.
    """
    press = scene.press()
    state = press.rest()
    worst, where, held, why = 0.0, 0.0, False, ""
    try:
        for found in press.path(state, down(depth_mm), step_mm):
            inside_mm = found.diagnostics.penetration_mm
            outside = inside_mm <= PENETRATION_LIMIT * found.tip_mm[2]
            if held and not outside:
                why = f"press: {inside_mm:.2g} mm inside the gel at {found.tip_mm[2]:g} mm"
                break
            state, held = found, outside
            x, y, z = whole_wrench(press.mesh, state)[0]
            share = math.hypot(x, y) / abs(z)
            if share > worst:
                worst, where = share, state.tip_mm[2]
    except SolverError as error:
        why = str(error)
    told = f"{worst:.2g} at {where:g} mm, the largest to {state.tip_mm[2]:g} mm"
    told += f", {-whole_wrench(press.mesh, state)[0][2]:.4g} N there"
    if why and worst <= most:
        raise Flagged(f"{told}; {why}")
    return worst, f"{told}; {why}" if why else told
