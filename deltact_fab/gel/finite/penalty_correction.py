"""What the force lacks because the contact is a penalty and gives.

At a depth d the elastic energy with a hard contact is more than that with a penalty by the
complementary energy C of the penalty, to first order (the penalty is a spring in series), so the
force is short by dC/dd along the equilibrium. Meshes share this: the penalty gives in proportion to
the cell, and a comparison of two shows a third of it.
"""

from __future__ import annotations

import numpy as np

from .press import FinitePress
from .state import FiniteState

STEP_MM = 1e-5  # for the difference of contact forces by the depth


def lacking_n(press: FinitePress, state: FiniteState) -> float:
    """dC/dd (N) of the mesh: more normal force with a hard contact. Friction is left out of it."""
    if state.contact_points == 0:
        return 0.0
    u, tip = state.displacement_mm, np.array(state.tip_mm)
    free = press.pattern.free
    down = np.array([0.0, 0.0, STEP_MM])
    low, high = (press.surface.evaluate(u, tip + k * down, tangent=False) for k in (-1, 1))
    by_depth = ((high.force_n - low.force_n) / (2 * STEP_MM))[free]
    bulk = press.bulk.evaluate(u, True, state.cell_pressure_mpa)
    assert bulk.data is not None
    for curved in (True, False):
        contact = press.surface.evaluate(u, tip, curved=curved)
        assert contact.data is not None
        press.solver.factorise(press.pattern.matrix(bulk.data + contact.data))
        if not press.solver.negative:
            break
    _, slope = press.surface.give(u, tip)
    return float(slope[:, 2].sum() - press.solver.solve(slope[free]) @ by_depth)
