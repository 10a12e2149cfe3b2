"""Material of the gel: elastic constants, friction and an optional Prony series."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..shapes.bounded import Bounded, bounded_number

MAX_PRONY_SUM = 100.0  # by hand: more means shares in percent or no long-term modulus


@dataclass(frozen=True)
class GelMaterial(Bounded):
    """An isotropic silicone gel and its dry friction against the indenter.

    modulus_mpa: Young's modulus; 0.56 is Gent's relation at Shore 15A, uncertain by a factor of 2.
    poisson: Poisson's ratio, 0 to 0.5 (0.5, incompressible, is allowed).
    friction: Coulomb coefficient against the indenter.
    prony: pairs (g, tau_s) of a relaxing gel; empty: elastic. modulus_mpa is the long-term modulus
    (slow press, book value), g the additional share of shear modulus that decays with tau:
    G(t) = G (1 + sum g exp(-t / tau)).
    Shares s of the *instantaneous* modulus, common elsewhere, convert as g = s / (1 - sum s).

    Raises ValueError for a number outside its range.
    """

    modulus_mpa: float = bounded_number(
        0.56, "Young's modulus of the gel; `gel fit` measures it", 0.0001, 10_000
    )
    poisson: float = bounded_number(0.49, "Poisson's ratio of the gel", 0, 0.5)
    friction: float = bounded_number(0.5, "Coefficient of friction between tip and face", 0, 100)
    prony: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        for pair in self.prony:
            if len(pair) != 2:
                raise ValueError(f"prony: pairs [g, tau_s] are needed: {pair} fails")
            g, tau = pair
            if not (math.isfinite(g) and g >= 0):
                raise ValueError(f"prony: g >= 0 and finite in each [g, tau_s]: {g} fails")
            if not (math.isfinite(tau) and tau > 0):
                raise ValueError(f"prony: tau_s > 0 and finite in each [g, tau_s]: {tau} fails")
        if not self.prony_sum <= MAX_PRONY_SUM:
            raise ValueError(f"prony: sum of g <= {MAX_PRONY_SUM:g}: {self.prony_sum} fails")

    @property
    def shear_modulus_mpa(self) -> float:
        """Long-term shear modulus G = E / (2 (1 + nu))."""
        return self.modulus_mpa / (2 * (1 + self.poisson))

    @property
    def prony_sum(self) -> float:
        """Sum of g; the instantaneous shear modulus is (1 + prony_sum) times the long-term one."""
        return sum((g for g, _ in self.prony), 0.0)
