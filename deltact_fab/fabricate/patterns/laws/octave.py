"""Octave noise: independent uniform blocks of several sizes, added, with their contrast restored.

A sum of uniform values is concentrated around its mean, so it would print as grey. Each value is
therefore replaced by its cumulative probability, which is uniform on 0..1 for any weights: every
level is equally frequent again, and the order of the values is kept.

The distribution of w1 U1 + ... + wk Uk is computed exactly. It is a piecewise polynomial of degree
k with a knot at the sum of every subset of the weights (inclusion and exclusion of the half spaces
U < 1; the density is a box spline). Evaluating the alternating sum directly loses all digits to
cancellation when weights are unequal, so each piece is expanded about its own knot in fractions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from functools import cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Field

from .algorithm1 import FILE_LEVELS
from .law import Law, Patches, PatchRecipe

MAX_SCALES = 6
"""By hand: k scales make 2^k pieces of 2^k fractions, at k = 6 some hundredths of a second."""
# By hand: weights beyond have no visible effect; more rows per strip cost memory.
WEIGHT_RANGE, OCTAVE_STRIP_ROWS = (0.01, 100.0), 128


def draw(
    rng: np.random.Generator, n: int, channels: int, blocks: Sequence[int], weights: Sequence[float]
) -> NDArray[np.uint8]:
    """Draw patches (n, n, channels), every level equally likely; blocks: sides in patches."""
    layers = [rng.random((-(-n // side), -(-n // side), channels)) for side in blocks]
    share = SumOfUniforms.cached(tuple(weights))
    out = np.empty((n, n, channels), np.uint8)
    for first in range(0, n, OCTAVE_STRIP_ROWS):  # bounds the memory of the float intermediates
        rows = np.arange(first, min(first + OCTAVE_STRIP_ROWS, n))
        total = block_sums(layers, blocks, weights, rows, n)
        out[rows] = np.minimum(share(total) * FILE_LEVELS, FILE_LEVELS - 1).astype(np.uint8)
    return out


def block_sums(
    layers: Sequence[Field],
    blocks: Sequence[int],
    weights: Sequence[float],
    rows: NDArray[np.int64],
    n: int,
) -> Field:
    """Weighted sum of the layers at the given rows of patches, (len(rows), n, channels)."""
    total = np.zeros((len(rows), n, layers[0].shape[2]))
    columns = np.arange(n)
    for layer, side, weight in zip(layers, blocks, weights, strict=True):
        total += (layer * weight)[rows // side][:, columns // side]
    return total


class SumOfUniforms:
    """Distribution function of w1 U1 + ... + wk Uk, U independent and uniform on 0..1.

    knots: (m + 1,). coefficients: (m, k + 1) of each piece, rising powers of (x - knot).
    """

    def __init__(self, weights: tuple[float, ...]) -> None:
        # Decimals as written, so that 0.1 + 0.2 and 0.3 are the same knot
        exact = [Fraction(repr(float(w))) for w in weights]
        degree = len(exact)
        terms: dict[Fraction, int] = {}
        for subset in product((0, 1), repeat=degree):
            knot = sum((w for w, chosen in zip(exact, subset, strict=True) if chosen), Fraction(0))
            terms[knot] = terms.get(knot, 0) + (-1) ** sum(subset)
        knots = sorted(terms)
        scale = math.factorial(degree) * math.prod(exact)
        pieces = [
            [
                math.comb(degree, power)
                * sum(terms[k] * (start - k) ** (degree - power) for k in knots[: i + 1])
                / scale
                for power in range(degree + 1)
            ]
            for i, start in enumerate(knots[:-1])
        ]
        self.knots = np.array([float(k) for k in knots])
        self.coefficients = np.array([[float(c) for c in piece] for piece in pieces])

    @staticmethod
    @cache
    def cached(weights: tuple[float, ...]) -> SumOfUniforms:
        """Return a cached instance; the fractions cost more than drawing a small pattern."""
        return SumOfUniforms(weights)

    def __call__(self, x: Field) -> Field:
        """Probability, 0..1, that a sum is below x (any shape)."""
        piece = np.clip(np.searchsorted(self.knots, x, "right") - 1, 0, len(self.knots) - 2)
        t = np.clip(x, self.knots[0], self.knots[-1]) - self.knots[piece]
        value = np.zeros_like(t)
        for power in reversed(range(self.coefficients.shape[1])):
            # Multiplied and added separately: a fused operation would change the last bit
            value *= t
            value += self.coefficients[:, power][piece]
        return np.clip(value, 0.0, 1.0)


def _draw(recipe: PatchRecipe) -> Patches:
    blocks = [round(scale_mm / recipe.patch_mm) for scale_mm in recipe.scales_mm]
    rng = np.random.Generator(np.random.PCG64(recipe.seed))
    weights = recipe.weights or (1.0,) * len(blocks)
    return draw(rng, recipe.n, recipe.channels, blocks, weights)


LAWS = {
    "octave": Law(
        "independent blocks of several sizes, added and spread over all levels",
        _draw,
        needs=("patch_mm", "scales_mm"),
        may=("weights", "channels", "dots"),
    )
}
