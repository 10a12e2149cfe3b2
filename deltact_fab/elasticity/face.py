"""What a linear level must tell of its face: displacement of tractions, whole and in a window."""

from __future__ import annotations

from typing import Protocol

from ..aliases import Field
from .material import GelMaterial


class PatchOperator(Protocol):
    """What a contact solves with on one patch; fields are as `WindowOperator` tells."""

    shape: tuple[int, int]

    def normal_of_pressure(self, pressure: Field) -> Field: ...

    def shear_of_pressure(self, pressure: Field) -> Field: ...

    def shear_of_shear(self, traction: Field) -> Field: ...

    def normal_of_shear(self, traction: Field) -> Field: ...


class FaceOperator(Protocol):
    """What a contact needs of a gel: its face as a grid, and displacements of tractions on it.

    Attributes and methods are those of `BondedLayer`. Off the grid there is no gel.
    """

    material: GelMaterial
    thickness_mm: float
    shape: tuple[int, int]
    spacing_mm: tuple[float, float]
    cell_mm2: float
    x_mm: Field
    y_mm: Field
    face_half_mm: tuple[float, float]

    def apply(self, tractions_mpa: Field) -> Field: ...

    def apply_patch(self, tractions_mpa: Field, row: int, column: int) -> Field: ...

    def window(self, my: int, mx: int, row: int = 0, column: int = 0) -> PatchOperator: ...
