"""A solved position of the indenter on a mesh."""

from __future__ import annotations

from dataclasses import dataclass

from ...aliases import Field, Point
from ..level import IncrementDiagnostics

PENETRATION_LIMIT = 0.05  # of the depth; beyond, a state is not `trusted`

UNSTRETCHED = IncrementDiagnostics(most_stretch=1.0)


@dataclass(frozen=True, eq=False)
class FiniteState:
    """One solved position of the indenter; also the whole history that the next one needs.

    tip_mm: (x, y, depth) of the lowest point, depth positive into the gel from the resting face.
    displacement_mm (n, 3): of all nodes. slip_mm (f, q, 3): elastic slip stored at the q points
    of every face. pressure_mpa (f, q), shear_mpa (f, q, 3): on the gel, per resting area.
    force_n, torque_nmm: on the sensor, about the centre of the resting face.
    base_force_n: of the base on the gel; minus force_n in equilibrium.
    contact_points: how many are under pressure.
    cell_pressure_mpa (m,): mean pressure of the cells, tension positive.
    rate: what the last increment changed: displacement (n, 3), tip (3,) and cell pressure (m,).
    overstress_mpa (k, m, 8, 6): of a gel with a Prony series, see `viscous`; None: all has faded.
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
    diagnostics: IncrementDiagnostics = UNSTRETCHED
    rate: tuple[Field, Field, Field] | None = None
    overstress_mpa: Field | None = None

    @property
    def trusted(self) -> bool:
        """False where the indenter is more than PENETRATION_LIMIT of its depth inside the gel, or
        where friction is not that of the state's own pressures."""
        d = self.diagnostics
        inside_mm = PENETRATION_LIMIT * max(self.tip_mm[2], 0.0)
        return d.penetration_mm <= inside_mm and not d.lagged
