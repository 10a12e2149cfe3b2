"""Algorithm 1 of the paper (Pattern Generation) for every 0 <= r < 1.

The printed algorithm redraws a patch until each channel differs from the left and upper neighbours
by at least s = sqrt(r). It never ends when a channel of the first patch lies in (1 - s, s), where
no neighbour can differ enough: for r > 0.25 with probability 1 - (2 (1 - s))^3. Here the first
patch is drawn from [0, 1 - s] u [s, 1]. Every later patch then has at least one allowed value, that
of its diagonal neighbour, which differs by s from both the left and the upper one.

Because the condition holds per channel, no redrawing is needed: the allowed values are the range
without the open intervals (v - s, v + s) around the neighbours, and one uniform draw picks among
them. This is the same distribution at a fixed cost.

Values are drawn from the levels that the file can hold, so the condition holds exactly in the file:
two neighbours differ by at least K levels, K the smallest integer with (K / (levels - 1))^2 >= r.
After the uniform draws all arithmetic is on integers, so the result is the same on every machine.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .law import Law, Patches, PatchRecipe, uniforms

Levels = NDArray[Any]
Uniforms = NDArray[np.float64]

FILE_LEVELS = 256  # of an 8-bit channel, by the PNG format


@dataclass(frozen=True)
class Algorithm1:
    """Algorithm 1 at a factor r, on the given number of levels of a channel."""

    r: float
    levels: int = FILE_LEVELS

    @property
    def step_levels(self) -> int:
        """Least difference K of neighbours in levels: least K with (K / (levels-1))^2 >= r.

        r is taken as the written decimal, so r = 0.04 asks for exactly 51 of 255.
        """
        squared = math.ceil(Fraction(repr(float(self.r))) * (self.levels - 1) ** 2)
        return math.isqrt(squared - 1) + 1 if squared > 0 else 0

    def fill(self, uniforms: Uniforms) -> Levels:
        """Draw the patches, by anti-diagonals.

        uniforms: (rows, columns, channels) in [0, 1), one draw per patch and channel.
        Returns levels 0..levels-1 of the same shape as int32.

        Patches of one anti-diagonal depend on the previous one alone: each is one array operation.
        """
        rows, columns, channels = uniforms.shape
        step, levels = self.step_levels, self.levels
        out = np.empty((rows * columns, channels), np.int32)
        flat = uniforms.reshape(rows * columns, channels)
        # The previous anti-diagonal by row, one slot ahead: before[i] is row i - 1
        previous = np.zeros((rows + 1, channels), np.int32)
        for diagonal in range(rows + columns - 1):
            first, last = max(0, diagonal - columns + 1), min(rows - 1, diagonal)
            start = first * columns + diagonal - first
            # From row to row the flat index grows by a row less a column
            stride = max(columns - 1, 1)
            members = slice(start, start + (last - first) * stride + 1, stride)
            if diagonal == 0:
                values = _pick_first(flat[members], step, levels)
            else:
                up_values = previous[first : last + 1]
                left_values = previous[first + 1 : last + 2]
                low, high = np.minimum(up_values, left_values), np.maximum(up_values, left_values)
                if first == 0:
                    low[0] = high[0] = left_values[0]
                if last == diagonal:
                    low[-1] = high[-1] = up_values[-1]
                values = _pick(flat[members], low, high, step, levels)
            out[members] = values
            previous[first + 1 : last + 2] = values
        return out.reshape(rows, columns, channels)

    def fill_by_rejection(
        self, rng: np.random.Generator, rows: int, columns: int, max_tries: int
    ) -> NDArray[np.float64]:
        """Draw the patches as printed (lines 5-8), with a bound on the tries of each: a reference.

        Returns (rows, columns, 3), nan from the first patch without a colour after max_tries.
        """
        values = np.full((rows, columns, 3), np.nan)
        for i in range(rows):
            for j in range(columns):
                neighbours = [values[i - 1, j]] * (i > 0) + [values[i, j - 1]] * (j > 0)
                for attempt in range(0, max_tries, 64):  # in blocks; the first good one counts
                    block = rng.random((min(64, max_tries - attempt), 3))
                    allowed = np.ones(len(block), bool)
                    for neighbour in neighbours:
                        allowed &= ~(((block - neighbour) ** 2).min(axis=1) < self.r)
                    if allowed.any():
                        values[i, j] = block[allowed.argmax()]
                        break
                else:
                    return values
        return values


def _pick_first(uniforms: Uniforms, step: int, levels: int) -> Levels:
    """Pick the first patch; middle levels are forbidden: no neighbour could differ enough."""
    start, stop = levels - step, max(step, levels - step)
    picked = (uniforms * (levels - (stop - start))).astype(np.int32)
    return picked + (picked >= start) * np.int32(stop - start)


def _pick(uniforms: Uniforms, low: Levels, high: Levels, step: int, levels: int) -> Levels:
    """Pick one allowed level each, given the lower and the higher of two neighbours.

    The two forbidden runs [start, stop) are made disjoint; the k-th allowed level is k plus the
    length of every run that begins at or below it.
    """
    start_a = np.maximum(low - step + 1, 0)
    stop_a = np.maximum(np.minimum(low + step, levels), start_a)
    start_b = np.maximum(high - step + 1, stop_a)
    stop_b = np.maximum(np.minimum(high + step, levels), start_b)
    run_a, run_b = stop_a - start_a, stop_b - start_b
    picked = (uniforms * (levels - run_a - run_b)).astype(np.int32)
    picked += (picked >= start_a) * run_a
    picked += (picked >= start_b) * run_b
    return picked


def _draw(recipe: PatchRecipe) -> Patches:
    return Algorithm1(recipe.r).fill(uniforms(recipe)).astype(np.uint8)


LAWS = {
    "algorithm1": Law(
        "Algorithm 1 of the paper: neighbours differ by at least sqrt(r) in every channel",
        _draw,
        needs=("patch_mm", "r"),
        may=("channels", "dots"),
    )
}
