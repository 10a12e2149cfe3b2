"""Compressible neo-Hooke, split so that near incompressibility neither locks nor inverts.

Per cell of reference volume V the energy is
    sum over points w [mu/2 (F:F - 3) - mu ln J + b/4 ln(J)^4]  +  V U(Jbar),
    Jbar = sum w J / V,   U(J) = lambda/2 ln(J)^2 - b/4 ln(J)^4,
the mean dilatation of Nagtegaal, Parks and Rice (1974) as Simo, Taylor and Pister (1985) put it
for finite strain, one constant pressure a cell (Q1P0). mu and lambda are Lame's constants, so that
small strains are Hooke's law and a homogeneous state is the usual compressible neo-Hooke (Bonet
and Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, 6.4).

Locking: only U grows with nu, and it sees one number a cell, so a brick keeps enough freedom to
bend at nu = .4999; with J at each of the 2 x 2 x 2 points it would lock. The pressure of Q1P0 may
alternate from cell to cell; contact on a bonded block does not excite that, forces are free of it.
The part -mu ln J stays local: with Jbar alone a brick can turn inside out at one point. Squeezed
to a third under a sharp tip it would still fold into an hourglass, whose points lose and gain
volume while its mean keeps it. The part with b = LOCAL mu, at most lambda/8, stands against that;
to fourth order it is no part of small strains, so it locks nothing, and a homogeneous state does
not feel it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...aliases import Field
from ...elasticity.material import GelMaterial
from ...errors import InputError

LOCAL = 8.0  # b over mu
MAX_POISSON = 0.49999  # beyond, rounding in U' spoils the residual


@dataclass(frozen=True)
class NeoHooke:
    """Lame's constants of the energy above, in MPa."""

    mu_mpa: float
    lambda_mpa: float

    @classmethod
    def of(cls, material: GelMaterial) -> NeoHooke:
        """From modulus and Poisson's ratio; InputError beyond MAX_POISSON."""
        nu, e = material.poisson, material.modulus_mpa
        if nu > MAX_POISSON:
            raise InputError(
                f"hyperelastic: poisson <= {MAX_POISSON} is needed: {nu} fails; .499 gives the "
                "force of .4999 within .5 %"
            )
        return cls(e / (2 * (1 + nu)), e * nu / ((1 + nu) * (1 - 2 * nu)))

    @property
    def local_mpa(self) -> float:
        return min(LOCAL * self.mu_mpa, self.lambda_mpa / 8)

    def volumetric(self, jbar: Field) -> tuple[Field, Field, Field]:
        """U, U' (MPa, tension positive) and U'' at mean dilatations (m,)."""
        k, b, log = self.lambda_mpa, self.local_mpa, np.log(jbar)
        slope = k * log - b * log**3
        return (
            k / 2 * log**2 - b / 4 * log**4,
            slope / jbar,
            (k - 3 * b * log**2 - slope) / jbar**2,
        )
