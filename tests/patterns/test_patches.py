"""Algorithm 1: the law in the file itself, the two implementations, the printed algorithm."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from PIL import Image
from scipy import stats

from deltact_fab.patterns import draw_patches, make, recipe_from, recipe_from_options
from deltact_fab.patterns.laws import algorithm1 as patches


@pytest.mark.parametrize("r", [0.0, 0.2, 0.26, 0.6, 0.97, 0.9999])
def test_the_law_holds_in_the_file_without_any_tolerance(tmp_path, r):
    path = tmp_path / "p.png"
    make(recipe_from_options(None, 0.35, r, seed=3), path)
    with Image.open(path) as image:
        pixels = np.asarray(image).astype(np.int64)
    assert pixels.shape == (100, 100, 3)
    for axis in (0, 1):
        # In integers: (difference / 255)^2 >= r for every neighbour pair and every channel
        assert ((np.diff(pixels, axis=axis) ** 2).min() >= r * 255**2).all()
    assert pixels.std() > 50  # it is a pattern, and not one colour


def test_a_broken_pair_is_noticed():
    u = np.random.default_rng(0).random((20, 20, 3))
    drawn = patches.fill(u, 0.3)
    assert patches.least_difference(drawn) >= patches.step_levels(0.3)
    drawn[7, 8, 1] = drawn[7, 7, 1]
    assert patches.least_difference(drawn) == 0


@pytest.mark.parametrize(
    ("r", "levels"),
    # 0.04 * 255^2 is 51^2 and must not become 52 by the rounding of a float
    [(0.0, 0), (1e-12, 1), (0.04, 51), (0.25, 128), (0.64, 204), (0.9999999, 255)],
)
def test_step_is_the_least_whole_number_of_levels(r, levels):
    assert patches.step_levels(r) == levels


UNIT = st.floats(0, 1, exclude_max=True)


@settings(max_examples=80, deadline=None)
@given(
    uniforms=arrays.arrays(
        np.float64,
        st.tuples(st.integers(1, 9), st.integers(1, 9), st.sampled_from([1, 3])),
        elements=UNIT,
    ),
    r=st.floats(0, 1, exclude_max=True),
)
def test_wavefront_and_row_major_agree_in_every_bit(uniforms, r):
    fast = patches.fill(uniforms, r)
    slow = patches.fill_row_major(uniforms, r)
    assert fast.dtype == slow.dtype
    assert np.array_equal(fast, slow)
    assert patches.least_difference(fast) >= patches.step_levels(r)
    assert fast.min() >= 0
    assert fast.max() <= 255


@pytest.mark.parametrize(
    ("r", "repeats"),
    # Towards 1/4 the tries grow without bound: a first value near 1/2 leaves next to no second one
    [(0.0, 700), (0.02, 700), (0.1, 700), (0.2, 500), (0.24, 300)],
)
def test_same_law_as_drawing_again_and_again(r, repeats):
    """Kolmogorov-Smirnov, two samples, on independent small patterns; 2^16 levels: the continuum.

    Patches with no, one and two neighbours, and the differences to every neighbour, which show the
    joint law; a channel is a sample of its own.
    """
    rng = np.random.default_rng(11)
    naive = [patches.fill_by_rejection(rng, 3, 3, r, 10**7) for _ in range(repeats)]
    assert not any(found.hung for found in naive)
    printed = np.array([found.values for found in naive])
    levels = 2**16
    exact = np.array(
        [patches.fill(rng.random((3, 3, 3)), r, levels) / (levels - 1) for _ in range(repeats)]
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
        # 45 tests in all: one of them falls below 0.001 once in twenty draws of a right sampler
        assert test.pvalue > 0.001, (name, test)


def test_the_comparison_can_tell_another_law():
    """The same test at r = 0.1 against r = 0.14: it sees so small a difference."""
    rng, levels = np.random.default_rng(11), 2**16
    difference = [
        np.array(
            [
                np.subtract(*patches.fill(rng.random((3, 3, 3)), r, levels)[2, 2:0:-1] / levels)
                for _ in range(700)
            ]
        ).ravel()
        for r in (0.1, 0.14)
    ]
    assert stats.ks_2samp(*difference).pvalue < 0.01


@pytest.mark.parametrize("r", [0.2, 0.3, 0.5, 0.8])
def test_how_often_the_printed_algorithm_hangs(r):
    rng, repeats = np.random.default_rng(5), 300
    runs = [patches.fill_by_rejection(rng, 1, 2, r, 4000) for _ in range(repeats)]
    s = np.sqrt(r)
    stuck = [bool(((run.values[0, 0] > 1 - s) & (run.values[0, 0] < s)).any()) for run in runs]
    p = 1 - (2 * (1 - s)) ** 3 if s > 0.5 else 0.0
    assert abs(np.mean(stuck) - p) <= 4 * np.sqrt(p * (1 - p) / repeats)
    for run, is_stuck in zip(runs, stuck, strict=True):
        if is_stuck:
            assert run.hung
            assert run.hung_at == (0, 1)
            assert run.tries[0, 1] == 4000


def test_the_papers_size_is_drawn_quickly():
    uniforms = np.random.default_rng(0).random((466, 466, 3))
    best_s = np.inf
    for _ in range(3):
        start_s = time.process_time()
        patches.fill(uniforms, 0.6)
        best_s = min(best_s, time.process_time() - start_s)
    assert best_s < 0.2


def test_one_channel_is_grey_and_seeds_differ():
    def drawn(**more):
        data = {"law": "algorithm1", "seed": 1, "patch_mm": 1.0, "r": 0.2} | more
        return draw_patches(recipe_from(data, "here"))

    grey = drawn(channels=1)
    assert (grey == grey[..., :1]).all()
    assert np.array_equal(drawn(), drawn())
    assert not np.array_equal(drawn(), drawn(seed=2))
