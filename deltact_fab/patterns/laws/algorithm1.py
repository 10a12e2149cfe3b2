"""Algorithm 1 of the paper (Pattern Generation) for every 0 <= r < 1.

The printed algorithm redraws a patch until each channel differs from the left and upper neighbours
by at least s = sqrt(r). It never ends when a channel of the first patch lies in (1 - s, s), where
no second value is far enough: for r > 0.25 with probability 1 - (2 (1 - s))^3. Here the first
patch is drawn from [0, 1 - s] u [s, 1]. After that nothing can stick: the diagonal neighbour's
value is s away from both the left and the upper one, so it is always allowed.

Because the condition is per channel, the redrawing can be skipped: a channel's allowed values are
the range less the open intervals (v - s, v + s) around its neighbours, and one uniform picks among
them. That is the same law at a fixed cost.

Values are drawn from the levels that the file can hold, so the law holds in the file exactly and
not up to its rounding: two neighbours differ by at least K levels, K the smallest integer with
(K / (levels - 1))^2 >= r. All arithmetic after the uniforms is on integers, so the order of
evaluation cannot change a bit; and as the diagonal's level is among the allowed ones, the allowed
set is never empty, where intervals of floats could shrink to nothing.
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

FILE_LEVELS = 256


def step_levels(r: float, levels: int = FILE_LEVELS) -> int:
    """Least difference K of neighbours in levels: the smallest K with (K / (levels-1))^2 >= r.

    r is taken as the decimal that is written, so r = 0.04 asks for exactly 51 of 255.
    """
    squared = math.ceil(Fraction(repr(float(r))) * (levels - 1) ** 2)
    return math.isqrt(squared - 1) + 1 if squared > 0 else 0


def fill(uniforms: Uniforms, r: float, levels: int = FILE_LEVELS) -> Levels:
    """Algorithm 1, by anti-diagonals.

    uniforms: (rows, columns, channels) in [0, 1), one draw a patch and channel.
    Returns levels 0..levels-1 of the same shape as int32, bit-identical to `fill_row_major`.

    Patches of one anti-diagonal depend on the previous one alone, so each is one array operation.
    """
    rows, columns, channels = uniforms.shape
    step = step_levels(r, levels)
    out = np.empty((rows * columns, channels), np.int32)
    flat = uniforms.reshape(rows * columns, channels)
    # The previous anti-diagonal by row, one slot ahead: before[i] is row i - 1, before[i + 1] row i
    before = np.zeros((rows + 1, channels), np.int32)
    for diagonal in range(rows + columns - 1):
        first, last = max(0, diagonal - columns + 1), min(rows - 1, diagonal)
        start = first * columns + diagonal - first
        # From row to row the flat index grows by a row less a column
        stride = max(columns - 1, 1)
        members = slice(start, start + (last - first) * stride + 1, stride)
        if diagonal == 0:
            values = _pick_first(flat[members], step, levels)
        else:
            up = before[first : last + 1]
            left = before[first + 1 : last + 2]
            low, high = np.minimum(up, left), np.maximum(up, left)
            if first == 0:
                low[0] = high[0] = left[0]
            if last == diagonal:
                low[-1] = high[-1] = up[-1]
            values = _pick(flat[members], low, high, step, levels)
        out[members] = values
        before[first + 1 : last + 2] = values
    return out.reshape(rows, columns, channels)


def fill_row_major(uniforms: Uniforms, r: float, levels: int = FILE_LEVELS) -> Levels:
    """Algorithm 1 in the order of the paper, patch by patch: slow, the reference of `fill`.

    Shapes as in `fill`. Lists the allowed levels instead of computing with intervals.
    """
    rows, columns, channels = uniforms.shape
    step = step_levels(r, levels)
    out = np.zeros((rows, columns, channels), np.int32)
    every = np.arange(levels)
    for i in range(rows):
        for j in range(columns):
            for c in range(channels):
                allowed = np.ones(levels, bool)
                if i == 0 and j == 0:
                    allowed = (every + step < levels) | (every - step >= 0)
                if i > 0:
                    allowed &= np.abs(every - out[i - 1, j, c]) >= step
                if j > 0:
                    allowed &= np.abs(every - out[i, j - 1, c]) >= step
                values = every[allowed]
                out[i, j, c] = values[int(uniforms[i, j, c] * len(values))]
    return out


@dataclass(frozen=True)
class Rejection:
    """What the printed algorithm did: values (rows, columns, 3), tries and where it stopped."""

    values: NDArray[np.float64]
    tries: NDArray[np.int64]
    hung_at: tuple[int, int] | None

    @property
    def hung(self) -> bool:
        """Whether a patch used up its tries."""
        return self.hung_at is not None


def fill_by_rejection(
    rng: np.random.Generator, rows: int, columns: int, r: float, max_tries: int
) -> Rejection:
    """Algorithm 1 as printed (lines 5-8), with a bound on the tries of a patch: a reference.

    Stops at the first patch without a colour after max_tries; values from there on are NaN.
    """
    values = np.full((rows, columns, 3), np.nan)
    tries = np.zeros((rows, columns), np.int64)
    for i in range(rows):
        for j in range(columns):
            neighbours = [values[i - 1, j]] * (i > 0) + [values[i, j - 1]] * (j > 0)
            while tries[i, j] < max_tries:
                # Tries in blocks; the first good one counts
                block = rng.random((min(64, max_tries - int(tries[i, j])), 3))
                far = np.ones(len(block), bool)
                for neighbour in neighbours:
                    far &= ~(((block - neighbour) ** 2).min(axis=1) < r)
                if far.any():
                    tries[i, j] += int(far.argmax()) + 1
                    values[i, j] = block[far.argmax()]
                    break
                tries[i, j] += len(block)
            else:
                return Rejection(values, tries, (i, j))
    return Rejection(values, tries, None)


def least_difference(patches: Levels) -> int:
    """Smallest difference of any two edge neighbours in any channel; (rows, columns, channels)."""
    signed = patches.astype(np.int64)
    across = [np.abs(np.diff(signed, axis=axis)) for axis in (0, 1)]
    return int(min((d.min() for d in across if d.size), default=np.iinfo(np.int64).max))


def _pick_first(uniforms: Uniforms, step: int, levels: int) -> Levels:
    """The first patch: one forbidden run in the middle, levels that no neighbour could answer."""
    start, stop = levels - step, max(step, levels - step)
    picked = (uniforms * (levels - (stop - start))).astype(np.int32)
    return picked + (picked >= start) * np.int32(stop - start)


def _pick(uniforms: Uniforms, low: Levels, high: Levels, step: int, levels: int) -> Levels:
    """One allowed level each, given the lower and the higher of two neighbours.

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
    assert recipe.r is not None  # the recipe's own check
    return fill(uniforms(recipe), recipe.r).astype(np.uint8)


LAWS = {
    "algorithm1": Law(
        "Algorithm 1 of the paper: neighbours differ by at least sqrt(r) in every channel",
        _draw,
        needs=("patch_mm", "r"),
        may=("channels", "dots"),
    )
}
