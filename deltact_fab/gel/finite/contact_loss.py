"""States that balance and are wrong all the same: the mesh no longer feels the indenter."""

from __future__ import annotations

import numpy as np

from ...errors import SolverError
from ...shapes import Indenter
from .state import FiniteState
from .surface import Surface

HIDDEN_LIMIT = 0.75  # of the depth, or of what is inside the resting gel; beyond, a tip hides


def refuse_lost(
    surface: Surface, indenter: Indenter, cell_mm: float, previous: FiniteState, state: FiniteState
) -> None:
    """Raises SolverError where a tip hides in the mesh or contact is lost on the way down.

    indenter: as it is, not as the mesh feels it. cell_mm: side of the smallest face.
    """
    depth, penetration = state.tip_mm[2], state.diagnostics.penetration_mm
    if depth <= 0:
        return
    narrow = min(min(tip.half_mm) for tip in indenter.tips)
    if narrow < cell_mm / 2:
        raise SolverError(
            f"press: {indenter.name} is {2 * narrow:.2g} mm wide and hides between cells of "
            f"{cell_mm:.2g} mm, a finer mesh is needed"
        )
    # A thin tip may pass through the gel whole: then it is as deep inside as at rest.
    still = np.zeros_like(state.displacement_mm)
    unmoved = surface.deepest_mm(still, np.array(state.tip_mm))
    if penetration > max(HIDDEN_LIMIT * min(depth, unmoved), float(surface.width_mm.max())):
        raise SolverError(
            f"press: {indenter.name} is {penetration:.2g} mm inside the gel at depth {depth:g} mm: "
            "the tip hides between the contact points of this mesh, a finer one is needed"
        )
    # Into a dent that a relaxing gel still keeps, a tip may advance without contact.
    dented = state.overstress_mpa is not None and previous.contact_points == 0
    if state.contact_points == 0 and depth > previous.tip_mm[2] and not dented:
        raise SolverError(
            f"press: {indenter.name} lost contact while advancing to {depth:g} mm: it left the "
            "gel, or hides between the contact points of this mesh"
        )
