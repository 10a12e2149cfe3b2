"""The judges of real recordings, on what is known: none of them needs a recording."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from benchmarks import real


def test_correlation_finds_only_known_motion() -> None:
    rng = np.random.default_rng(3)
    first = ndimage.gaussian_filter(rng.normal(size=(240, 320)), 2)
    first = 128 + 40 * first / first.std()
    judge = real.Correlation(first)
    for shift in ((0.0, 0.0), (3.3, -5.6), (7.8, -9.4)):  # (x, y), within its search each time
        found = judge.update(ndimage.shift(first, shift[::-1], order=3, mode="nearest"))
        inner = ((judge.nodes > 40) & (judge.nodes < (279, 199))).all(axis=1)
        assert found[inner] == pytest.approx(np.tile(shift, (inner.sum(), 1)), abs=0.06)
    other = ndimage.gaussian_filter(rng.normal(size=first.shape), 2)
    assert np.isnan(judge.update(128 + 40 * other / other.std())).all()


def test_excluded_blocks_are_not_used() -> None:
    rng = np.random.default_rng(5)
    columns, y = rng.normal(size=(60, 2)), np.zeros(60)
    y = columns @ [2.0, -1.0] + 3.0
    assert real.left_out(columns, y) == pytest.approx(0, abs=1e-9)
    y[15:30] += 7.0  # a block unlike all others: none of the rest excuses it
    off = real.left_out(columns, y)
    assert off[15:30] == pytest.approx(-7.0)
    assert np.abs(off).max() == pytest.approx(7.0)


def test_chains_detect_swapped_identities() -> None:
    grid = np.stack(np.meshgrid(np.arange(5) * 30.0, np.arange(4) * 30.0), -1).reshape(-1, 2) + 30
    image = np.full((170, 200), 200.0)
    for x, y in grid:
        image[int(y) - 4 : int(y) + 5, int(x) - 4 : int(x) + 5] = 40
    spots = real.dark_spots(image)
    assert np.sort(spots, axis=0) == pytest.approx(np.sort(grid, axis=0), abs=0.5)
    frames = [grid[::-1] + (step, 0) for step in range(0, 31, 10)]  # the last is a pitch away
    assert real.chained(frames, grid, 14.0)[-1] == pytest.approx(grid + (30, 0))
    assert np.isnan(real.chained([grid[1:]], grid, 14.0)[0, 0]).all()
