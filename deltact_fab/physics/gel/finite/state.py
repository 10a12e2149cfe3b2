"""State of a solved position of the indenter on a mesh, and the next increment's start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deltact_fab.common import Field, Point

from ..level import IncrementDiagnostics
from .assembly import BulkAssembly
from .mesh import HexMesh

PENETRATION_LIMIT = 0.05  # of the depth; by hand: above, a state is not `trusted`

REST_DIAGNOSTICS = IncrementDiagnostics(most_stretch=1.0)


@dataclass(frozen=True, eq=False)
class FiniteState:
    """One solved position of the indenter; also the full history for the next one.

    tip_mm: (x, y, depth) of the lowest point, depth positive into the gel from the resting face.
    displacement_mm (n, 3): of all nodes. slip_mm (f, q, 3): elastic slip at the q points of every
    face. pressure_mpa (f, q), shear_mpa (f, q, 3): on the gel, per resting area.
    force_n, torque_nmm: on the sensor, about the centre of the resting face.
    base_force_n: of the base on the gel; minus force_n in equilibrium.
    contact_points: number of points under pressure.
    cell_pressure_mpa (m,): mean pressure of the cells, tension positive.
    rate: changes in the last increment: displacement (n, 3), tip (3,) and cell pressure (m,).
    overstress_mpa (k, m, 8, 6): of a gel with a Prony series, see `Viscosity`; None: relaxed.
    """

    tip_mm: Point
    displacement_mm: Field
    slip_mm: Field
    pressure_mpa: Field
    shear_mpa: Field
    force_n: Point
    torque_nmm: Point
    base_force_n: Point
    contact_points: int
    cell_pressure_mpa: Field
    diagnostics: IncrementDiagnostics = REST_DIAGNOSTICS
    rate: tuple[Field, Field, Field] | None = None
    overstress_mpa: Field | None = None

    @property
    def trusted(self) -> bool:
        """True unless the indenter is more than PENETRATION_LIMIT of its depth inside the gel, or
        friction is not that of the state's own pressures."""
        d = self.diagnostics
        inside_mm = PENETRATION_LIMIT * max(self.tip_mm[2], 0.0)
        return d.penetration_mm <= inside_mm and not d.lagged


SAME_TIP_MM = 1e-6  # by hand: tips no further apart are the same, above rounding


class Guide:
    """Increments of a path solved on a coarser mesh, requested in order.

    Starting from them, Newton's method needs about half the factorisations on the finer mesh.
    Both meshes are blocks, so interpolation is a product of three along the axes.
    states: of the coarser mesh, in the order solved.
    """

    def __init__(self, coarse: HexMesh, states: Sequence[FiniteState], fine: HexMesh) -> None:
        assert coarse.axes_mm is not None
        assert fine.axes_mm is not None
        self._states, self._next = states, 0
        self._nodes = [_linear(a, b) for a, b in zip(coarse.axes_mm, fine.axes_mm, strict=True)]
        middles = [[(a[1:] + a[:-1]) / 2 for a in mesh.axes_mm or ()] for mesh in (coarse, fine)]
        self._cells = [_linear(a, b) for a, b in zip(*middles, strict=True)]

    def change(self, start_mm: Point, end_mm: Point) -> tuple[Field, Field] | None:
        """Change of displacements (n, 3), cell pressures (m,) between two tips; None if unknown."""
        first = self._index(start_mm, self._next)
        last = None if first is None else self._index(end_mm, first + 1)
        if first is None or last is None:
            return None
        self._next = first
        a, b = self._states[first], self._states[last]
        shift_mm = _interpolate(b.displacement_mm - a.displacement_mm, self._nodes)
        pressure = (b.cell_pressure_mpa - a.cell_pressure_mpa)[:, None]
        return shift_mm, _interpolate(pressure, self._cells)[:, 0]

    def _index(self, tip_mm: Point, start: int) -> int | None:
        for k in range(start, len(self._states)):
            if np.allclose(self._states[k].tip_mm, tip_mm, rtol=0, atol=SAME_TIP_MM):
                return k
        return None


def _linear(at_mm: Field, to_mm: Field) -> Field:
    """Weights (len(to), len(at)) of linear interpolation, constant outside the ends."""
    return np.stack([np.interp(to_mm, at_mm, unit) for unit in np.eye(len(at_mm))], axis=1)


def _interpolate(values: Field, weights: Sequence[Field]) -> Field:
    """Interpolate values (points, k) of a block, x fastest and z slowest, to another block."""
    x, y, z = weights
    grid = values.reshape(z.shape[1], y.shape[1], x.shape[1], -1)
    mapped = np.einsum("ai,bj,ck,ijkd->abcd", z, y, x, grid, optimize=True)
    return np.asarray(mapped.reshape(-1, grid.shape[-1]))


PREDICTABLE_CELLS = 0.75  # longest extrapolated move, in cells; by hand, for the work only
MIN_VOLUME_SHARE = 0.2  # least volume ratio of a start over the previous one; by hand, likewise


def predict_start(
    bulk: BulkAssembly,
    previous: FiniteState,
    tip_mm: Field,
    cell_mm: float,
    change: tuple[Field, Field] | None,
) -> tuple[Field, Field]:
    """Predict displacements (n, 3) and cell pressures (m,) from the previous state.

    change: predicted change; None: repeats the last increment's.
    """
    u, pressure = previous.displacement_mm, previous.cell_pressure_mpa
    if change is None:
        share = _repeat_share(previous, tip_mm, cell_mm)
        if previous.rate is None or share == 0:
            return u, pressure
        change = share * previous.rate[0], share * previous.rate[2]
    trial = u + change[0]
    usable = bulk.evaluate(trial, False).least_j > MIN_VOLUME_SHARE * previous.diagnostics.least_j
    return (trial, pressure + change[1]) if usable else (u, pressure)


def _repeat_share(previous: FiniteState, tip_mm: Field, cell_mm: float) -> float:
    """Fraction of the last increment to repeat; 0 where the path turns or the move is long.

    On reversal the contact does not open as it closed. A move of a cell or more shears cells so
    much that Newton without prediction takes half the factorisations.
    """
    if previous.rate is None:
        return 0.0
    last_move = previous.rate[1]
    move = tip_mm - np.array(previous.tip_mm)
    length2, goal2 = float(last_move @ last_move), float(move @ move)
    along = float(move @ last_move) / length2 if length2 > 0 else 0.0
    turned = along <= 0 or along**2 * length2 < 0.9 * goal2
    return 0.0 if turned or goal2 > (PREDICTABLE_CELLS * cell_mm) ** 2 else min(along, 2.0)
