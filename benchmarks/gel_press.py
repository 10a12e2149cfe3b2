"""The press of the gel's curves on other parts of the block and with friction; its references."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from deltact_fab.physics.gel.finite.linear import SolverName
from deltact_fab.studies.numerics.engines import gel_press
from deltact_fab.studies.numerics.engines.gel_press import (
    SPHERE_INDENTER,
    GelCase,
    PressReference,
    PressSetup,
    rms_mm,
)

# With friction: coarser and finer cells, steps, and steps of a second run on the coarser cells:
# friction remembers its path, and how finely that is cut is a first-order error of its own.
FINE = (1.0, 0.75)
STEPS_MM = (0.25, 0.125)
# What `reference` says of itself, measured; a slow test holds it to that: depth, friction.
OWN_ERROR = {(5.0, 0.5): (0.9, 0.018)}


@dataclass(frozen=True)
class WholePress(PressSetup):
    """part: of the block that is meshed; `even`: whole, cells of one size."""

    part: Literal["whole", "even"] = "whole"
    solver: SolverName = "auto"

    @property
    def scene(self) -> GelCase:
        """Without mirrors."""
        whole = GelCase(SPHERE_INDENTER, self.spacing_mm, self.friction, mirrors=(False, False),
                        solver=self.solver)  # fmt: skip
        return replace(whole, focus=None) if self.part == "even" else whole

    @property
    def series(self) -> str:
        """As the curve is called."""
        part = {"even": "whole, cells of one size"}.get(self.part, self.part)
        return f"hyperelastic, {part}" + ("" if self.solver == "auto" else f", {self.solver}")


def reference(depth_mm: float, friction: float) -> PressReference:
    """Extrapolated from two meshes of a quarter, and two steps where there is friction."""
    if friction == 0:
        return gel_press.reference(depth_mm)
    runs = [
        PressSetup("hyperelastic", depth_mm, friction, h, step)
        for h, step in ((FINE[0], STEPS_MM[0]), (FINE[1], STEPS_MM[0]), (FINE[0], STEPS_MM[1]))
    ]
    force, u = gel_press.cached_solutions(runs)
    found = gel_press.extrapolate(force, u, FINE)
    normal_n = found.normal_n + 2 * (force[2] - force[0])
    in_plane_mm = found.in_plane_mm + 2 * (u[2] - u[0])
    return PressReference(
        normal_n, in_plane_mm, 100 * abs(normal_n / force[1] - 1), rms_mm(in_plane_mm - u[1])
    )
