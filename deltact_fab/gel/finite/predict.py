"""The starting point of Newton's method in an increment."""

from __future__ import annotations

import numpy as np

from ...aliases import Field
from .assembly import BulkAssembly
from .state import FiniteState

PREDICTABLE = 0.75  # of the smallest cell: longest move that is extrapolated
KEPT = 0.2  # of the least volume ratio, by which a start may crush a cell


def start_of(
    bulk: BulkAssembly,
    previous: FiniteState,
    tip_mm: Field,
    cell_mm: float,
    change: tuple[Field, Field] | None,
) -> tuple[Field, Field]:
    """Displacements (n, 3) and cell pressures (m,): the state before and a change of them.

    change: as it is foreseen; None: the last increment's, repeated.
    """
    u, pressure = previous.displacement_mm, previous.cell_pressure_mpa
    if change is None:
        share = _share(previous, tip_mm, cell_mm)
        if previous.rate is None or share == 0:
            return u, pressure
        change = share * previous.rate[0], share * previous.rate[2]
    trial = u + change[0]
    kept = bulk.evaluate(trial, False).least_j > KEPT * previous.diagnostics.least_j
    return (trial, pressure + change[1]) if kept else (u, pressure)


def _share(previous: FiniteState, tip_mm: Field, cell_mm: float) -> float:
    """How much of the last increment is repeated; 0 where the path turns or the move is long.

    On the way back the contact does not open as it closed. A move of a cell or more shears cells so
    much that Newton from rest takes half the factors.
    """
    if previous.rate is None:
        return 0.0
    moved = previous.rate[1]
    move = tip_mm - np.array(previous.tip_mm)
    length2, goal2 = float(moved @ moved), float(move @ move)
    along = float(move @ moved) / length2 if length2 > 0 else 0.0
    turned = along <= 0 or along**2 * length2 < 0.9 * goal2
    return 0.0 if turned or goal2 > (PREDICTABLE * cell_mm) ** 2 else min(along, 2.0)
