"""Compressible neo-Hooke, split so that near incompressibility neither locks nor inverts.

Per cell of reference volume V the energy is
    sum over points w [mu/2 (F:F - 3) - mu ln J + b/4 ln(J)^4]  +  V U(Jbar),
    Jbar = sum w J / V,   U(J) = lambda/2 ln(J)^2 - b/4 ln(J)^4,
the mean dilatation of Nagtegaal, Parks and Rice (1974), for finite strain by Simo, Taylor and
Pister (1985), with one pressure per cell (Q1P0). mu and lambda are Lame's constants, so that
small strains are Hooke's law and a homogeneous state is the usual compressible neo-Hooke (Bonet
and Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, 6.4).

Locking: only U grows with nu, and it depends on one number per cell, so a brick can still bend at
nu = 0.4999; with J at each of the 2 x 2 x 2 points it would lock. The pressure of Q1P0 may
alternate from cell to cell; contact on a bonded block does not excite that, and forces are not
affected. The part -mu ln J stays local: with Jbar alone a brick can invert at one point. Squeezed
to a third under a sharp tip it would still fold into an hourglass, whose points lose and gain
volume at a constant mean. The part with b = LOCAL_RATIO mu, at most lambda/8, prevents that; being
of fourth order it vanishes at small strains (no locking), and in homogeneous states.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from deltact_fab.common import Field, InputError
from deltact_fab.sensor import GelMaterial

LOCAL_RATIO = 8.0  # b over mu; by hand: less lets cells fold, more stiffens sheared ones
MAX_FINITE_POISSON = 0.49999  # by hand: above, rounding in U' spoils the residual


@dataclass(frozen=True)
class NeoHooke:
    """Lame's constants of the energy above, in MPa."""

    mu_mpa: float
    lambda_mpa: float

    @classmethod
    def from_material(cls, material: GelMaterial) -> NeoHooke:
        """Convert modulus and Poisson's ratio. Raises InputError above MAX_FINITE_POISSON."""
        nu, e = material.poisson, material.modulus_mpa
        if nu > MAX_FINITE_POISSON:
            raise InputError(
                f"hyperelastic: poisson must be <= {MAX_FINITE_POISSON} (got {nu}); 0.499 gives "
                "the force of 0.4999 within 0.5 %"
            )
        return cls(e / (2 * (1 + nu)), e * nu / ((1 + nu) * (1 - 2 * nu)))

    @property
    def local_mpa(self) -> float:
        return min(LOCAL_RATIO * self.mu_mpa, self.lambda_mpa / 8)

    def volumetric(self, jbar: Field) -> tuple[Field, Field, Field]:
        """Return U, U' (MPa, tension positive) and U'' at mean dilatations (m,)."""
        k, b, log = self.lambda_mpa, self.local_mpa, np.log(jbar)
        slope = k * log - b * log**3
        return (
            k / 2 * log**2 - b / 4 * log**4,
            slope / jbar,
            (k - 3 * b * log**2 - slope) / jbar**2,
        )


# Order of a symmetric tensor's six components: definition.
_TENSOR_ROWS, _TENSOR_COLS = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)


class Memory(NamedTuple):
    """Effect of the past on one increment.

    scale: factor of the local energy. stress_mpa (m, 8, 6): h; xx, yy, zz, xy, xz, yz.
    parts_mpa (k, m, 8, 6): its terms, one per branch. gains (k,): g a, each branch's factor of S'.
    """

    scale: float
    stress_mpa: Field
    parts_mpa: Field
    gains: Field


@dataclass(frozen=True)
class Viscosity:
    """Relaxation of a gel: shares (k,) of mu and their relaxation times_s (k,).

    A Prony series on the local stress, exact in time for a straight increment. Each branch (g, tau)
    carries an overstress H (second Piola, reference axes, so turning the gel does not change it)
    with  dH/dt + H / tau = g dS/dt,  S(C) = mu (I - C^-1)  the local elastic stress. The stress is
    S + sum H + what the mean dilatation gives: mu relaxes, lambda does not. (The bulk modulus
    lambda + 2 mu / 3 relaxes that little; near incompressibility it does not matter.)

    Over an increment of t seconds, with S changing evenly,
        H' = e H + g a (S' - S),   e = exp(-t / tau),   a = (1 - e) / (t / tau)
    is exact (Simo and Hughes, Computational Inelasticity, 10.3; Holzapfel, Nonlinear Solid
    Mechanics, 6.10, has the midpoint form). It is linear in S', so the increment keeps a potential:
        (1 + sum g a) x the local energy  +  h : (C - I) / 2,   h = sum (e H - g a S).
    With a <= 1 and e <= a the tensor (1 + sum g a) mu I + h stays positive, at least mu I, whatever
    the history and the steps: summed by parts, H is a sum of C^-1 of the past with weights >= 0 but
    for the last, and g a S gives that one back. So the potential is as well behaved as the elastic
    one, at t = 0 (a sudden press, e = a = 1) as at infinity (long rest, e = a = 0).

    Linear in S: relaxation times do not depend on the stretch, and there is no softening.
    """

    mu_mpa: float
    shares: tuple[float, ...]
    times_s: tuple[float, ...]

    @classmethod
    def from_material(cls, material: GelMaterial, law: NeoHooke) -> Viscosity | None:
        """Take a material's Prony series; return None where it has none."""
        pairs = [(g, tau) for g, tau in material.prony if g > 0]
        if not pairs:
            return None
        return cls(law.mu_mpa, tuple(g for g, _ in pairs), tuple(tau for _, tau in pairs))

    def weights(self, seconds: float) -> tuple[Field, Field]:
        """Return decay factors e (k,) of an overstress and a (k,) of a stress change on the way.

        Raises InputError for a time that is negative or not a number; infinity is long rest.
        """
        if not seconds >= 0:
            raise InputError(f"viscosity: seconds must be >= 0 (got {seconds})")
        with np.errstate(over="ignore", under="ignore"):
            x = seconds / np.array(self.times_s)
            # expm1 keeps all digits for short times; at 0 the limit is needed.
            a = np.divide(-np.expm1(-x), x, out=np.ones_like(x), where=x > 0)
            return np.exp(-x), a

    def local_stress(self, f: Field) -> Field:
        """Return S = mu (I - C^-1) in MPa, (..., 6), at deformation gradients (..., 3, 3)."""
        pairs = zip(_TENSOR_ROWS, _TENSOR_COLS, strict=True)
        c = [(f[..., :, i] * f[..., :, j]).sum(axis=-1) for i, j in pairs]
        xx, yy, zz, xy, xz, yz = c
        s = np.empty((*f.shape[:-2], 6))
        s[..., 0], s[..., 1], s[..., 2] = yy * zz - yz**2, xx * zz - xz**2, xx * yy - xy**2
        s[..., 3], s[..., 4], s[..., 5] = xz * yz - zz * xy, xy * yz - yy * xz, xy * xz - xx * yz
        det = xx * s[..., 0] + xy * s[..., 3] + xz * s[..., 4]
        s *= (-self.mu_mpa / det)[..., None]
        s[..., :3] += self.mu_mpa
        return s

    def memory(self, f: Field, overstress_mpa: Field | None, seconds: float) -> Memory:
        """Memory of an increment that starts at gradients f (m, 8, 3, 3).

        overstress_mpa (k, m, 8, 6); None: relaxed. seconds: duration of the increment.
        """
        decay, a = self.weights(seconds)
        gains = np.array(self.shares) * a
        parts = np.multiply.outer(-gains, self.local_stress(f))
        if overstress_mpa is not None:
            parts += decay[:, None, None, None] * overstress_mpa
        return Memory(1.0 + math.fsum(gains), parts.sum(axis=0), parts, gains)

    def overstress(self, f: Field, memory: Memory) -> Field:
        """Return H' (k, m, 8, 6) in MPa at the end of the increment, gradients f (m, 8, 3, 3)."""
        return memory.parts_mpa + np.multiply.outer(memory.gains, self.local_stress(f))
