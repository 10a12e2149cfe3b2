"""An elastic foundation (Winkler): every point of the face is a spring of its own.

The simplest contact there is: a spring for the gel's thickness, held sideways by nothing but what
stands around it, M = E (1 - nu) / ((1 + nu)(1 - 2 nu)), and G in shear (Johnson, Contact Mechanics,
4.3). A face that knows no neighbours does not bulge beside the tip.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .linear import Errors, LinearLevel, PressScales

if TYPE_CHECKING:
    from ..elasticity.face import FaceOperator, Field
    from ..elasticity.material import GelMaterial
    from ..shapes import SkinDimensions


class Springs:
    """Both `elasticity.face.FaceOperator` and, for a patch, its `PatchOperator`."""

    def __init__(self, skin: SkinDimensions, material: GelMaterial, spacing_mm: float) -> None:
        nu, g = material.poisson, material.shear_modulus_mpa
        self.material, self.thickness_mm = material, skin.thickness_mm
        self.face_half_mm = skin.opening_half_mm
        self.x_mm, self.y_mm = (_nodes(half, spacing_mm) for half in self.face_half_mm)
        self.shape = len(self.y_mm), len(self.x_mm)
        self.spacing_mm = (spacing_mm, spacing_mm)
        self.cell_mm2 = spacing_mm**2
        self._normal = skin.thickness_mm * (1 - 2 * nu) / (2 * g * (1 - nu))  # mm/MPa
        self._shear = skin.thickness_mm / g

    def apply(self, tractions_mpa: Field) -> Field:
        """Displacement (ny, nx, 3) in mm of tractions (ny, nx, 3) in MPa."""
        return tractions_mpa * np.array([self._shear, self._shear, self._normal])

    def apply_patch(self, tractions_mpa: Field, row: int, column: int) -> Field:
        """The same of tractions (3, my, mx) that are zero outside a patch."""
        _, my, mx = tractions_mpa.shape
        whole = np.zeros((*self.shape, 3))
        whole[row : row + my, column : column + mx] = np.moveaxis(tractions_mpa, 0, -1)
        return self.apply(whole)

    def window(self, my: int, mx: int, row: int = 0, column: int = 0) -> Patch:
        """The springs of one patch."""
        return Patch((my, mx), self._normal, self._shear)


class Patch:
    """What a contact solves with: fields (my, mx), in-plane vectors (2, my, mx)."""

    def __init__(self, shape: tuple[int, int], normal: float, shear: float) -> None:
        self.shape, self._normal, self._shear = shape, normal, shear

    def normal_of_pressure(self, pressure: Field) -> Field:
        """Depth (mm, into the gel) that a pressure (MPa) gives."""
        return self._normal * pressure

    def shear_of_shear(self, traction: Field) -> Field:
        """Motion in plane of a traction in plane."""
        return self._shear * traction

    def shear_of_pressure(self, pressure: Field) -> Field:
        """None: the springs do not couple."""
        return np.zeros((2, *pressure.shape))

    def normal_of_shear(self, traction: Field) -> Field:
        """None either."""
        return np.zeros(traction.shape[1:])


def _nodes(half_mm: float, spacing_mm: float) -> Field:
    n = int(half_mm / spacing_mm)
    return (np.arange(2 * n) - n + 0.5) * spacing_mm


def _face(skin: SkinDimensions, material: GelMaterial, spacing_mm: float) -> FaceOperator:
    return Springs(skin, material, spacing_mm)


def _errors(touch: PressScales) -> Errors:
    return 1.0, touch.depth_mm  # it may be off by all that there is


def _refusal(material: GelMaterial) -> str | None:
    if material.poisson > 0.499:
        return f"poisson <= .499 is needed, or springs are rigid: {material.poisson:g} fails"
    return None


ABOUT = "the foundation level is springs side by side: forces and motion in plane are rough guesses"
LEVELS = {"foundation": LinearLevel(ABOUT, _face, _errors, _refusal)}
