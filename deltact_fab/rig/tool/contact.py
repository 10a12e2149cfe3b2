"""Where a face begins: force against height, fitted by the law of the tip that met it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...aliases import Field
from ...shapes import Indenter
from ...shapes.tips import EllipsoidTip, SphereTip

CANDIDATES = 200
ROUNDS = 4


@dataclass(frozen=True)
class ContactFit:
    """Height of the face (mm), the power of the depth that the force rises with, what is left."""

    z_mm: float
    power: float
    residual_n: float


def powers_of(indenter: Indenter) -> tuple[float, ...]:
    """Powers of the depth by which the force of this indenter may rise.

    A ball's rises with 1.5 (Hertz), a flat one's with 1, and one that meets the face by an edge
    first with something in between.
    """
    if all(isinstance(tip, SphereTip | EllipsoidTip) for tip in indenter.tips):
        return (1.5,)
    return (1.0, 1.25, 1.5)


def fit(z_mm: Sequence[float], force_n: Sequence[float], powers: Sequence[float]) -> ContactFit:
    """The height from which down the force rises: b + a (z0 - z)^power below z0, b above.

    z_mm, force_n: (n,) going down, the first ones clear of the face. a and b follow from z0 by
    least squares, so that z0 alone is searched for. With a single pose below the face nothing but
    the interval above it is known, and its middle is returned.
    """
    z, force = np.asarray(z_mm, float), np.asarray(force_n, float)
    found = [_fitted(z, force, power) for power in powers]
    return min(found, key=lambda contact: contact.residual_n)


def _fitted(z: Field, force: Field, power: float) -> ContactFit:
    low, high = float(z.min()), float(z.max())
    best, residual = high, np.inf
    for _ in range(ROUNDS):
        candidates = np.linspace(low, high, CANDIDATES)
        left = _left_n2(z, force, power, candidates)
        k = int(np.argmin(left))
        # Over an interval without a pose in it the answer may be the same everywhere.
        same = np.flatnonzero(left <= left[k] * (1 + 1e-9))
        best, residual = float(candidates[same].mean()), float(left[k])
        step = candidates[1] - candidates[0]
        low, high = float(candidates[same[0]] - step), float(candidates[same[-1]] + step)
    return ContactFit(best, power, float(np.sqrt(residual / len(z))))


def _left_n2(z: Field, force: Field, power: float, candidates: Field) -> Field:
    """Sum of squares that is left, for each height (m,) of the face."""
    shape = np.maximum(candidates[:, None] - z, 0.0) ** power  # (m, n)
    shape = shape - shape.mean(axis=1, keepdims=True)
    about = force - force.mean()
    size = (shape**2).sum(axis=1)
    along = np.maximum(shape @ about, 0.0)  # pulling is no contact
    gain = np.divide(along**2, size, out=np.zeros_like(size), where=size > 0)
    return np.asarray(np.maximum((about**2).sum() - gain, 0.0))
