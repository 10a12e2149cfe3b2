"""Linear gel, a `level.GelContact`: grid fields on the common lattice."""

from __future__ import annotations

import numpy as np

from deltact_fab.common import Field, Point, SolverError
from deltact_fab.sensor import FreeBlock, GelMaterial, Indenter, SkinDimensions

from ..level import Choice, GelContact, State
from ..zones import FRICTION_MARGIN, ZoneMap, Zones, hermite, means, measure_zones
from .contact import ContactState, LinearContact

MAX_LINEAR_CUTS = 2  # halvings of an increment; by hand: more only delay the refusal


class LinearGel(GelContact):
    def __init__(
        self,
        skin: SkinDimensions,
        material: GelMaterial,
        indenter: Indenter,
        choice: Choice,
        x_mm: Field,
        y_mm: Field,
    ) -> None:
        self.level = choice.level
        self.choice, self.x_mm, self.y_mm = choice, x_mm, y_mm
        face = FreeBlock(skin, material, choice.spacing_mm)
        self.dofs = 3 * face.shape[0] * face.shape[1]
        self.contact = LinearContact(face, indenter, choice.friction)
        self._sampled = hermite(face.x_mm, x_mm), hermite(face.y_mm, y_mm)
        # A traction at a grid node is constant over the cell around it.
        edges = (
            np.append(nodes - step / 2, nodes[-1] + step / 2)
            for nodes, step in zip((face.x_mm, face.y_mm), face.spacing_mm, strict=True)
        )
        self._means = means(next(edges), x_mm), means(next(edges), y_mm)

    def rest(self, tip_mm: Point = (0.0, 0.0, 0.0)) -> State:
        return self._state(self.contact.rest(tip_mm))

    def solve(
        self, previous: State, tip_mm: Point, seconds: float = 0.0, guide: None = None
    ) -> State:
        """One increment, halved where pressure and friction do not agree.

        `seconds` makes no difference at the linear level.
        """
        return self._state(self._cut(previous.inner, tip_mm, MAX_LINEAR_CUTS))

    def _cut(self, inner: ContactState, tip_mm: Point, cuts_left: int) -> ContactState:
        try:
            return self.contact.solve(inner, tip_mm)
        except SolverError:
            if cuts_left == 0 or self.choice.friction == 0 or not inner.contact_nodes:
                raise
        x, y, z = ((a + b) / 2 for a, b in zip(inner.tip_mm, tip_mm, strict=True))
        return self._cut(self._cut(inner, (x, y, z), cuts_left - 1), tip_mm, cuts_left - 1)

    def displacement_mm(self, inner: ContactState) -> Field:
        return sample_on_lattice(self._sampled, inner.displacement_mm)

    def traction_mpa(self, inner: ContactState) -> Field:
        """Return tractions (ny, nx, 3) on the lattice; linear, so pressure acts along -z."""
        shear = sample_on_lattice(self._means, inner.shear_mpa)
        pressure = sample_on_lattice(self._means, inner.pressure_mpa[..., None])
        return np.concatenate([shear, -pressure], axis=-1)

    def zones(self, inner: ContactState) -> tuple[Zones, ZoneMap] | None:
        """Return the zones of the nodes under pressure; None without contact."""
        if not inner.contact_nodes:
            return None
        face, h = self.contact.face, max(self.contact.face.spacing_mm)
        place = np.stack(np.meshgrid(face.x_mm, face.y_mm), axis=-1)
        bound = self.choice.friction * inner.pressure_mpa * (1 - FRICTION_MARGIN)
        return measure_zones(
            (face.x_mm, face.y_mm), place + inner.displacement_mm[..., :2],
            (inner.pressure_mpa > 0).astype(np.float64),
            np.linalg.norm(inner.shear_mpa, axis=2) < bound,
            h, 0.0, (self.x_mm, self.y_mm),
        )  # fmt: skip

    def _state(self, inner: ContactState) -> State:
        return State(inner, inner.force_n, inner.torque_nmm, inner.diagnostics, self)


def sample_on_lattice(to_lattice: tuple[Field, Field], field: Field) -> Field:
    wx, wy = to_lattice
    return np.ascontiguousarray(np.moveaxis(wy @ np.moveaxis(field, -1, 0) @ wx.T, 0, -1))
