"""What the skin is made of: three numbers, validated once."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class GelMaterial:
    """An isotropic silicone gel and its dry friction against the indenter.

    modulus_mpa: Young's modulus; .56 is Gent's relation at Shore 15A, uncertain by a factor of 2.
    poisson: Poisson's ratio, 0 to .5 (.5, incompressible, is allowed).
    friction: Coulomb coefficient against the indenter.

    Raises ValueError for a number outside its range.
    """

    modulus_mpa: float = 0.56
    poisson: float = 0.49
    friction: float = 0.5

    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012 - read by catalog.validate

    def __post_init__(self) -> None:
        if not (math.isfinite(self.modulus_mpa) and self.modulus_mpa > 0):
            raise ValueError(f"modulus_mpa > 0 and finite: {self.modulus_mpa} fails")
        if not 0 <= self.poisson <= 0.5:
            raise ValueError(f"0 <= poisson <= 0.5: {self.poisson} fails")
        if not (math.isfinite(self.friction) and self.friction >= 0):
            raise ValueError(f"friction >= 0 and finite: {self.friction} fails")

    @property
    def shear_modulus_mpa(self) -> float:
        """G = E / (2 (1 + nu))."""
        return self.modulus_mpa / (2 * (1 + self.poisson))
