"""Bulk and contact in balance over the free displacements: what `newton.solve` solves."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...aliases import Field
from .assembly import BulkAssembly
from .material import Memory
from .surface import Coupling, FrictionGrip, Surface


class Evaluation(NamedTuple):
    """residual_n (size,): unbalanced forces, p = U'(J). scale_n: what they are small to.
    data: CSR entries of the tangent's symmetric part, if asked for. pressure_mpa (m,): U'(J).
    energy_nmm: the potential, where friction has one."""

    residual_n: Field
    scale_n: float
    data: Field
    pressure_mpa: Field
    energy_nmm: float


class Equilibrium:
    """One increment with the tip at (x, y, depth): the system to be solved.

    floor_n: least force that a residual is compared with.
    """

    def __init__(
        self,
        bulk: BulkAssembly,
        surface: Surface,
        tip_mm: Field,
        grip: FrictionGrip | None,
        memory: Memory | None,
        floor_n: float,
    ) -> None:
        self._bulk, self._surface = bulk, surface
        self._tip, self._grip, self._memory = tip_mm, grip, memory
        self._floor_n = floor_n
        self._seen: tuple[Field, Field] | None = None
        self._coupling: Coupling | None = None

    def evaluate(
        self, free_mm: Field, pressure_mpa: Field | None, tangent: bool, curved: bool
    ) -> Evaluation | None:
        """At displacements (size,); None where a cell is turned inside out. pressure_mpa (m,): of
        the tangent's geometric part; None: U'(J). `curved` False leaves out terms of the tangent
        that may be negative."""
        u = self._bulk.pattern.whole(free_mm)
        bulk = self._bulk.evaluate(u, tangent, pressure_mpa, memory=self._memory)
        if not bulk.least_j > 0:
            return None
        _, first, second = self._bulk.law.volumetric(bulk.jbar)
        self._seen = bulk.volume_rate_mm2, second
        contact = self._surface.evaluate(u, self._tip, self._grip, tangent, curved)
        residual = (bulk.force_n + contact.force_n)[self._bulk.pattern.free]
        scale = max(float(np.linalg.norm(contact.force_n)), self._floor_n)
        if tangent:
            self._coupling = contact.coupling
        data = bulk.data + contact.data
        return Evaluation(residual, scale, data, first, bulk.energy_nmm + contact.energy_nmm)

    def pressure_rate(self, step_mm: Field) -> Field:
        """U'' dJ.step (m,) at the displacements of the last evaluation."""
        assert self._seen is not None
        rate, second = self._seen
        return second * self._volume_change(rate, step_mm) / self._bulk.volumes_mm3

    def unbalance_n(self, free_mm: Field, pressure_mpa: Field) -> float | None:
        """Norm of the residual with given cell pressures; None if inside out."""
        u = self._bulk.pattern.whole(free_mm)
        bulk = self._bulk.evaluate(u, False, memory=self._memory)
        if not bulk.least_j > 0:
            return None
        contact = self._surface.evaluate(u, self._tip, self._grip, False)
        own = pressure_mpa - self._bulk.law.volumetric(bulk.jbar)[1]
        force = bulk.force_n + contact.force_n
        own_n = own[:, None] * bulk.volume_rate_mm2
        force += self._bulk.scatter(own_n.reshape(-1, 8, 3))
        return float(np.linalg.norm(force[self._bulk.pattern.free]))

    @property
    def couples(self) -> bool:
        """Whether the last tangent has a part that is not symmetric: shear follows pressure."""
        return self._coupling is not None and bool(self._coupling.gain_n_mm.any())

    def coupled(self, step_mm: Field) -> Field:
        assert self._coupling is not None
        pattern = self._bulk.pattern
        return self._surface.coupled(self._coupling, pattern.whole(step_mm))[pattern.free]

    def _volume_change(self, rate: Field, step_mm: Field) -> Field:
        step = self._bulk.pattern.whole(step_mm)[self._bulk.mesh.cells]
        return np.asarray(np.einsum("mk,mk->m", rate, step.reshape(rate.shape)))
