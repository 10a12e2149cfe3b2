"""The levels behind the interface of `level`: lattice fields, whole wrenches, flags."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..shapes import Indenter, SkinDimensions
from .contact import ContactState, LayerContact
from .finite.field import FaceLattice, hermite, tractions_mpa, whole_wrench
from .finite.mesh import block_mesh
from .finite.press import FinitePress
from .finite.state import PENETRATION_LIMIT, FiniteState
from .layer import FaceOperator
from .level import Diagnostics, Level, Point
from .material import GelMaterial

if TYPE_CHECKING:
    from .choose import Choice

Field = NDArray[np.float64]

# Up to about here neo-Hooke follows rubber in tension within a third (Treloar, Trans. Faraday Soc.
# 40, 1944); soft silicones tear at 3 to 5.
STRETCH_LIMIT = 3.0


@dataclass(frozen=True, eq=False)
class LinearState:
    """A state of the layer or the block; see `level.State`. inner: as the level has it."""

    inner: ContactState
    diagnostics: Diagnostics
    _to_lattice: tuple[Field, Field]

    @property
    def tip_mm(self) -> Point:
        """(x, y, depth) of the indenter's lowest point."""
        return self.inner.tip_mm

    @property
    def force_n(self) -> Point:
        """On the sensor."""
        return self.inner.force_n

    @property
    def torque_nmm(self) -> Point:
        """On the sensor, about the centre of the resting face."""
        return self.inner.torque_nmm

    @property
    def contact_area_mm2(self) -> float:
        """Of the nodes under pressure."""
        return self.inner.contact_area_mm2

    @cached_property
    def displacement_mm(self) -> Field:
        """(ny, nx, 3) on the lattice."""
        return self._laid(self.inner.displacement_mm)

    @cached_property
    def pressure_mpa(self) -> Field:
        """(ny, nx) on the lattice; interpolated, so it may undershoot 0 at the contact's edge."""
        return self._laid(self.inner.pressure_mpa[..., None])[..., 0]

    @cached_property
    def traction_mpa(self) -> Field:
        """(ny, nx, 3) on the lattice; linear, so pressure acts along -z."""
        return np.concatenate(
            [self._laid(self.inner.shear_mpa), -self.pressure_mpa[..., None]], axis=-1
        )

    def _laid(self, field: Field) -> Field:
        wx, wy = self._to_lattice
        found = np.moveaxis(wy @ np.moveaxis(field, -1, 0) @ wx.T, 0, -1)
        return np.ascontiguousarray(found)


class LinearGel:
    """`level.GelContact` of the bonded layer or the free block."""

    def __init__(
        self,
        skin: SkinDimensions,
        material: GelMaterial,
        indenter: Indenter,
        choice: Choice,
        x_mm: Field,
        y_mm: Field,
    ) -> None:
        self.level: Level = choice.level
        self.choice, self.x_mm, self.y_mm = choice, x_mm, y_mm
        face = _face(skin, material, choice)
        self.dofs = 3 * face.shape[0] * face.shape[1]
        self.contact = LayerContact(
            face, indenter, friction=choice.friction, observe_shear=choice.friction > 0
        )
        self._to_lattice = hermite(face.x_mm, x_mm), hermite(face.y_mm, y_mm)

    def rest(self, tip_mm: Point = (0.0, 0.0, 0.0)) -> LinearState:
        """Without contact."""
        return self._state(self.contact.rest(tip_mm))

    def solve(self, previous: LinearState, tip_mm: Point, seconds: float = 0.0) -> LinearState:
        """One increment; `seconds` makes no difference at a linear level."""
        return self._state(self.contact.solve(previous.inner, tip_mm))

    def path(
        self,
        previous: LinearState,
        tip_mm: Point,
        max_step_mm: float | None = None,
        seconds: float = 0.0,
    ) -> Iterator[LinearState]:
        """The straight way in equal increments."""
        step = self.choice.step_mm if max_step_mm is None else max_step_mm
        for state in self.contact.path(previous.inner, tip_mm, step):
            yield self._state(state)

    def _state(self, inner: ContactState) -> LinearState:
        flags: tuple[str, ...] = ()
        if inner.beyond_small_strain:
            flags = (
                f"small strain: depth {inner.tip_mm[2]:g} mm is over 10 % of the thickness; "
                f"the in-plane field of the level {self.level} is not to be trusted there",
            )
        diagnostics = Diagnostics(
            iterations=inner.iterations,
            residual=inner.residual,
            penetration_mm=inner.residual * max(inner.tip_mm[2], 0.0),
            least_j=inner.least_det,
            flags=flags,
        )
        return LinearState(inner, diagnostics, self._to_lattice)


def _face(skin: SkinDimensions, material: GelMaterial, choice: Choice) -> FaceOperator:
    if choice.level == "layer":
        from .layer import BondedLayer

        return BondedLayer.for_skin(skin, material, spacing_mm=choice.spacing_mm)
    from .block import FreeBlock

    return FreeBlock.for_skin(skin, material, spacing_mm=choice.spacing_mm)


@dataclass(frozen=True, eq=False)
class HyperelasticState:
    """A state at finite strain; see `level.State`. inner: of the mesh, which may be a part."""

    inner: FiniteState
    force_n: Point
    torque_nmm: Point
    diagnostics: Diagnostics
    _press: FinitePress
    _lattice: FaceLattice

    @property
    def tip_mm(self) -> Point:
        """(x, y, depth) of the indenter's lowest point."""
        return self.inner.tip_mm

    @property
    def contact_area_mm2(self) -> float:
        """Of the deformed face under pressure."""
        return self.inner.contact_area_mm2 * self._press.mesh.copies

    @cached_property
    def displacement_mm(self) -> Field:
        """(ny, nx, 3) on the lattice of material points at rest."""
        return self._lattice.displacement_mm(self.inner.displacement_mm)

    @cached_property
    def pressure_mpa(self) -> Field:
        """(ny, nx) on the lattice, constant over the quarters of faces."""
        return self._lattice.of_points(self.inner.pressure_mpa)

    @cached_property
    def traction_mpa(self) -> Field:
        """(ny, nx, 3) on the lattice, constant over the quarters of faces."""
        return self._lattice.of_points(tractions_mpa(self._press, self.inner))


class FiniteGel:
    """`level.GelContact` of the finite-strain block."""

    level: Level = "hyperelastic"

    def __init__(
        self,
        skin: SkinDimensions,
        material: GelMaterial,
        indenter: Indenter,
        choice: Choice,
        x_mm: Field,
        y_mm: Field,
    ) -> None:
        self.choice, self.x_mm, self.y_mm = choice, x_mm, y_mm
        self._skin = skin
        mesh = block_mesh(skin, choice.spacing_mm, choice.focus, choice.mirrors)
        self.dofs = mesh.free_dofs
        self.press = FinitePress(mesh, material, indenter, friction=choice.friction)
        self._lattice = FaceLattice(mesh, x_mm, y_mm)

    def rest(self, tip_mm: Point = (0.0, 0.0, 0.0)) -> HyperelasticState:
        """Without contact."""
        return self._state(self.press.rest(tip_mm))

    def solve(
        self, previous: HyperelasticState, tip_mm: Point, seconds: float = 0.0
    ) -> HyperelasticState:
        """One increment, halved where it does not converge.

        Raises InputError for a tip off the face, off the mesh's mirror or at the gel's base;
        SolverError as `FinitePress.solve` does.
        """
        self._refuse(tip_mm)
        return self._state(self.press.solve(previous.inner, tip_mm, seconds))

    def path(
        self,
        previous: HyperelasticState,
        tip_mm: Point,
        max_step_mm: float | None = None,
        seconds: float = 0.0,
    ) -> Iterator[HyperelasticState]:
        """The straight way in equal increments from first touch on."""
        self._refuse(tip_mm)
        step = self.choice.step_mm if max_step_mm is None else max_step_mm
        inner = previous.inner
        start, end = np.array(inner.tip_mm), np.array(tip_mm, dtype=np.float64)
        if end[2] <= 0:
            yield self.solve(previous, tip_mm, seconds)
            return
        left = 1.0
        if start[2] < 0:
            left = float(end[2] / (end[2] - start[2]))
            at = end + (start - end) * left
            touch = (float(at[0]), float(at[1]), 0.0)
            inner = self.press.solve(inner, touch, seconds * (1 - left))
        for state in self.press.path(inner, tip_mm, step, seconds * left):
            yield self._state(state)

    def _refuse(self, tip_mm: Point) -> None:
        x, y, depth = tip_mm
        if depth >= self._skin.thickness_mm:
            raise InputError(
                f"gel: depth {depth:g} mm is not below the gel's thickness of "
                f"{self._skin.thickness_mm:g} mm"
            )
        half = self._skin.opening_half_mm
        if abs(x) > half[0] or abs(y) > half[1]:
            raise InputError(
                f"gel: tip at ({x:g}, {y:g}) mm is off the face of +-{half[0]:g} x +-{half[1]:g} mm"
            )
        for name, at, mirror in zip("xy", (x, y), self.choice.mirrors, strict=True):
            if mirror and abs(at) > 1e-9:
                raise InputError(
                    f"gel: the mesh ends at its mirror {name} = 0 and a tip at {name} = {at:g} mm "
                    "is asked; the reach has to hold every tip"
                )

    def _state(self, inner: FiniteState) -> HyperelasticState:
        d = inner.diagnostics
        depth = max(inner.tip_mm[2], 0.0)
        flags = []
        coarse = self.choice.spacing_mm / self.choice.asked_mm if self.choice.asked_mm else 1.0
        if coarse > 1:
            flags.append(
                f"mesh: cells of {self.choice.spacing_mm:g} mm where the tolerance asks for "
                f"{self.choice.asked_mm:g} mm: errors may be {coarse**2:.1f} times as large"
            )
        if d.penetration_mm > PENETRATION_LIMIT * depth:
            flags.append(
                f"penetration: the indenter is {d.penetration_mm:.2g} mm inside the gel, over "
                f"{PENETRATION_LIMIT:.0%} of the depth {depth:g} mm; a spacing below "
                f"{self.choice.spacing_mm:g} mm is needed"
            )
        if d.most_stretch > STRETCH_LIMIT:
            flags.append(
                f"stretch: {d.most_stretch:.2f}, past {STRETCH_LIMIT:g}: neo-Hooke is off by a "
                "third there and soft silicones may tear"
            )
        if d.lagged:
            flags.append(
                "friction: the gel jumped, and friction is bounded by the pressures before the "
                "jump: no rest was found with those after it"
            )
        force, torque = whole_wrench(self.press.mesh, inner)
        return HyperelasticState(
            inner,
            (float(force[0]), float(force[1]), float(force[2])),
            (float(torque[0]), float(torque[1]), float(torque[2])),
            Diagnostics(
                d.iterations, d.cuts, d.residual, d.penetration_mm, d.least_j, d.most_stretch,
                tuple(flags),
            ),
            self.press,
            self._lattice,
        )  # fmt: skip
