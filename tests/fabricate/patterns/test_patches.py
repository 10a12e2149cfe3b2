"""Algorithm 1: the law in the file itself, the two implementations, the printed algorithm."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from PIL import Image
from scipy import stats

from deltact_fab.fabricate.patterns.laws.algorithm1 import Algorithm1
from deltact_fab.fabricate.patterns.raster import make_pattern
from deltact_fab.fabricate.patterns.recipe import choose_recipe


@pytest.mark.parametrize("r", [0.0, 0.26, 0.6, 0.9999])
def test_law_holds_exactly_in_the_file(tmp_path, r):
    path = tmp_path / "p.png"
    make_pattern(choose_recipe(None, 0.35, r, seed=3), path)
    with Image.open(path) as image:
        pixels = np.asarray(image).astype(np.int64)
    assert pixels.shape == (100, 100, 3)
    for axis in (0, 1):
        # In integers: (difference / 255)^2 >= r for every neighbour pair and every channel
        assert ((np.diff(pixels, axis=axis) ** 2).min() >= r * 255**2).all()
    assert pixels.std() > 50  # it is a pattern, and not one colour


@pytest.mark.parametrize(
    ("r", "levels"),
    # 0.04 * 255^2 is 51^2 and must not become 52 by the rounding of a float
    [(0.0, 0), (1e-12, 1), (0.04, 51), (0.25, 128), (0.64, 204), (0.9999999, 255)],
)
def test_step_is_least_number_of_levels(r, levels):
    assert Algorithm1(r).step_levels == levels


def row_major(uniforms, r, levels=256):
    """Algorithm 1 in the order of the paper; lists the allowed levels, where `fill` computes."""
    rows, columns, channels = uniforms.shape
    step, every = Algorithm1(r, levels).step_levels, np.arange(levels)
    out = np.zeros(uniforms.shape, np.int32)
    for i, j, c in np.ndindex(rows, columns, channels):
        allowed = np.ones(levels, bool)
        if i == j == 0:
            allowed = (every + step < levels) | (every - step >= 0)
        if i > 0:
            allowed &= np.abs(every - out[i - 1, j, c]) >= step
        if j > 0:
            allowed &= np.abs(every - out[i, j - 1, c]) >= step
        values = every[allowed]
        out[i, j, c] = values[int(uniforms[i, j, c] * len(values))]
    return out


@settings(max_examples=50, deadline=None)
@given(
    uniforms=arrays.arrays(
        np.float64,
        st.tuples(st.integers(1, 9), st.integers(1, 9), st.sampled_from([1, 3])),
        elements=st.floats(0, 1, exclude_max=True),
    ),
    r=st.floats(0, 1, exclude_max=True),
)
def test_wavefront_equals_row_major_order(uniforms, r):
    fast = Algorithm1(r).fill(uniforms)
    slow = row_major(uniforms, r)
    assert fast.dtype == slow.dtype
    assert np.array_equal(fast, slow)


@pytest.mark.parametrize(
    ("r", "repeats"),
    # Towards 1/4 the tries grow without bound: a first value near 1/2 leaves next to no second one
    [(0.0, 300), (0.1, 700), (0.24, 300)],
)
def test_distribution_equals_rejection_sampling(r, repeats):
    """Kolmogorov-Smirnov, two samples, on independent small patterns; 2^16 levels: the continuum.

    Patches with no, one and two neighbours, and the differences to every neighbour, which show the
    joint law; a channel is a sample of its own.
    """
    rng = np.random.default_rng(11)
    naive = [Algorithm1(r).fill_by_rejection(rng, 3, 3, 10**7) for _ in range(repeats)]
    printed = np.array(naive)
    assert np.isfinite(printed).all()
    levels = 2**16
    exact = np.array(
        [Algorithm1(r, levels).fill(rng.random((3, 3, 3))) / (levels - 1) for _ in range(repeats)]
    )
    places = {
        "first": lambda v: v[:, 0, 0],
        "one neighbour": lambda v: v[:, 0, 2],
        "two neighbours": lambda v: v[:, 2, 2],
        "left": lambda v: v[:, 2, 2] - v[:, 2, 1],
        "up": lambda v: v[:, 2, 2] - v[:, 1, 2],
        "diagonal": lambda v: v[:, 2, 2] - v[:, 1, 1],
        "other diagonal": lambda v: v[:, 1, 2] - v[:, 2, 1],
        "first row": lambda v: v[:, 0, 1] - v[:, 0, 0],
        "first column": lambda v: v[:, 1, 0] - v[:, 0, 0],
    }
    for name, quantity in places.items():
        test = stats.ks_2samp(quantity(printed).ravel(), quantity(exact).ravel())
        # 27 tests in all: one of them falls below 0.001 once in forty draws of a right sampler
        assert test.pvalue > 0.001, (name, test)


def test_printed_algorithm_can_hang():
    rng, r = np.random.default_rng(5), 0.3
    runs = np.array([Algorithm1(r).fill_by_rejection(rng, 1, 2, 4000) for _ in range(100)])
    s = np.sqrt(r)
    stuck = ((runs[:, 0, 0] > 1 - s) & (runs[:, 0, 0] < s)).any(axis=1)
    p = 1 - (2 * (1 - s)) ** 3
    assert abs(stuck.mean() - p) <= 4 * np.sqrt(p * (1 - p) / 100)
    assert np.isnan(runs[stuck, 0, 1]).all()
