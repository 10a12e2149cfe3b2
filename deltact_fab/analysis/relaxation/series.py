"""A gel that relaxes after a Prony series, in closed form: what a force still has over its rest.

With the shear modulus G(t) = G (1 + sum g exp(-t / tau)) and everything else fixed by the way of
the tip, the force is the steady one and, for each branch, g q, where q' + q / tau = dF/dt and F is
what the slow gel would give on the same way (the Boltzmann integral; Christensen, Theory of
Viscoelasticity, 1982, 1.2). A way that is straight in time over s seconds leaves of it
    q = F (1 - exp(-s / tau)) tau / s,
which fades with tau when the tip rests: long ramps leave less than short ones. Exact where the
contact does not change while the force fades, as with an incompressible gel that sticks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...aliases import Field
from ...errors import InputError


@dataclass(frozen=True)
class Series:
    """Shares (k,) of the steady force that fade, and the times_s (k,) in which they do.

    As `[specimen] prony`. Raises InputError for numbers that make no series.
    """

    shares: tuple[float, ...]
    times_s: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.shares) != len(self.times_s) or not self.shares:
            raise InputError(
                f"relaxation: as many g as tau_s are needed, at least one: {len(self.shares)} and "
                f"{len(self.times_s)}"
            )
        for name, values in (("g", self.shares), ("tau_s", self.times_s)):
            for value in values:
                if not (math.isfinite(value) and value > 0):
                    raise InputError(f"relaxation: {name} > 0 and finite: {value} fails")

    @property
    def pairs(self) -> tuple[tuple[float, float], ...]:
        """(g, tau_s), as a protocol writes them."""
        return tuple(zip(self.shares, self.times_s, strict=True))

    def left(self, t_s: ArrayLike, steady_n: ArrayLike) -> Field:
        """q (n, k, ...) at times t_s (n,), rising, of forces steady_n (n, ...), straight between.

        Nothing is left at the first time. g q, summed over k, is what the force has too much.
        """
        t, steady = np.asarray(t_s, float), np.asarray(steady_n, float)
        taus = np.array(self.times_s)
        found = np.zeros((len(t), len(taus), *steady.shape[1:]))
        wide = (slice(None), *[None] * (steady.ndim - 1))
        for n in range(1, len(t)):
            x = (t[n] - t[n - 1]) / taus
            gain = np.divide(-np.expm1(-x), x, out=np.ones_like(x), where=x > 0)
            step = np.multiply.outer(gain, steady[n] - steady[n - 1])
            found[n] = found[n - 1] * np.exp(-x)[wide] + step
        return found

    def excess(self, t_s: ArrayLike, steady_n: ArrayLike) -> Field:
        """(n, ...): what the force has over steady_n at each time. As `left`."""
        return np.asarray(np.tensordot(self.left(t_s, steady_n), self.shares, axes=(1, 0)), float)

    def after_ramp(self, ramp_s: float, wait_s: ArrayLike) -> Field:
        """Share (n,) of the steady force that is still too much, wait_s (n,) after a ramp."""
        wait = np.asarray(wait_s, float)[:, None]
        taus, shares = np.array(self.times_s), np.array(self.shares)
        x = ramp_s / taus
        gain = np.divide(-np.expm1(-x), x, out=np.ones_like(x), where=x > 0)
        return np.asarray((shares * gain * np.exp(-wait / taus)).sum(axis=1))


def time_to(wait_s: ArrayLike, error: ArrayLike, bound: float) -> float:
    """The first of wait_s (n,) from which on |error| (n,) is within bound; nan: never.

    Between two of them the error is taken as straight in the logarithm of error and linear in time,
    as it is where it fades.
    """
    wait, off = np.asarray(wait_s, float), np.abs(np.asarray(error, float))
    over = np.flatnonzero(off > bound)
    if not len(over):
        return float(wait[0])
    last = int(over[-1])
    if last + 1 == len(wait):
        return math.nan
    a, b = math.log(off[last]), math.log(max(off[last + 1], bound * 1e-6))
    share = (a - math.log(bound)) / (a - b)
    return float(wait[last] + share * (wait[last + 1] - wait[last]))
