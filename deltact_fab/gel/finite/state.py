"""A solved position of the indenter, and the work it took."""

from __future__ import annotations

from dataclasses import dataclass, field

from ...aliases import Field, Point

PENETRATION_LIMIT = 0.05  # of the depth; beyond, a state is not `trusted`


@dataclass(frozen=True)
class PressDiagnostics:
    """Work and quality of the increment that led to a state; counts are sums over its parts.

    residual: norm of the unbalanced nodal forces over that of the contact's. cuts: halvings of the
    increment. penetration_mm: deepest, also between contact points. damped: factorisations with
    damping, as where the gel folds. lagged: parts whose friction is bounded by the pressures at
    their start. seconds: wall time.
    """

    iterations: int = 0
    factorisations: int = 0
    damped: int = 0
    lagged: int = 0
    cuts: int = 0
    residual: float = 0.0
    penetration_mm: float = 0.0
    least_j: float = 1.0
    most_stretch: float = 1.0
    seconds: float = 0.0


@dataclass(frozen=True, eq=False)
class FiniteState:
    """One solved position of the indenter; also the whole history that the next one needs.

    tip_mm: (x, y, depth) of the lowest point, depth positive into the gel from the resting face.
    displacement_mm (n, 3): of all nodes. slip_mm (f, q, 3): elastic slip stored at the q points
    of every face. pressure_mpa (f, q), shear_mpa (f, q, 3): on the gel, per resting area.
    force_n, torque_nmm: on the sensor, about the centre of the resting face.
    base_force_n: of the base on the gel; minus force_n in equilibrium.
    contact_area_mm2: of the deformed face under pressure. contact_points: their number.
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
    contact_area_mm2: float
    contact_points: int
    cell_pressure_mpa: Field
    diagnostics: PressDiagnostics = field(default_factory=PressDiagnostics)
    rate: tuple[Field, Field, Field] | None = None
    overstress_mpa: Field | None = None

    @property
    def trusted(self) -> bool:
        """False where the indenter is more than PENETRATION_LIMIT of its depth inside the gel, or
        where friction is not that of the state's own pressures."""
        d = self.diagnostics
        inside_mm = PENETRATION_LIMIT * max(self.tip_mm[2], 0.0)
        return d.penetration_mm <= inside_mm and not d.lagged


def with_diagnostics(state: FiniteState, diagnostics: PressDiagnostics) -> FiniteState:
    """The same state with other diagnostics."""
    values = {k: getattr(state, k) for k in state.__dataclass_fields__}
    return FiniteState(**{**values, "diagnostics": diagnostics})


def sum_of(a: PressDiagnostics, b: PressDiagnostics) -> PressDiagnostics:
    """Counts of work added; the rest is left at its default."""
    return PressDiagnostics(
        a.iterations + b.iterations,
        a.factorisations + b.factorisations,
        a.damped + b.damped,
        a.lagged + b.lagged,
    )
