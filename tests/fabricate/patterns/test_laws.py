"""The laws: same bytes for a seed, the distributions they promise, and what each one refuses."""

from __future__ import annotations

import hashlib
import math
from fractions import Fraction
from itertools import product

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deltact_fab.common import validate
from deltact_fab.common.errors import InputError
from deltact_fab.fabricate.patterns.laws import PATTERN_LAWS
from deltact_fab.fabricate.patterns.laws.octave import SumOfUniforms, block_sums
from deltact_fab.fabricate.patterns.laws.plain import inner_corners
from deltact_fab.fabricate.patterns.raster import make_pattern, pattern_albedo
from deltact_fab.fabricate.patterns.recipe import PatternRecipe, load_recipe
from deltact_fab.sensor.shapes.sensor import SensorDimensions

EXTRA = {"algorithm1": {"r": 0.3}, "octave": {"scales_mm": [0.1, 0.2, 0.4]}}
VIEW_MM = SensorDimensions().optics.view_mm


def recipe(law, **more):
    data = {"law": law, "seed": 5}
    if PATTERN_LAWS[law].has_patches:
        data |= {"patch_mm": 0.1, "size_mm": 4.0}
    if "dots" in PATTERN_LAWS[law].needs:
        data |= {"dots": {"colour": "#000000"}}
    return validate(PatternRecipe, data | EXTRA.get(law, {}) | more, "here")


def named(law, n, **more):
    """A recipe of n x n patches of 0.05 mm; the scales are 1, 2, 4 and 8 patches."""
    scales = {"scales_mm": [0.05, 0.1, 0.2, 0.4]} if law == "octave" else {}
    return recipe(law, **({"patch_mm": 0.05, "size_mm": n * 0.05} | scales | more))


@pytest.mark.parametrize(
    ("law", "more", "digits"),
    [
        ("algorithm1", {}, "e52bc0479b7f9000"),
        ("algorithm1", {"channels": 1}, "e635871f963db6d4"),
        ("iid", {}, "307f2921adac4bbd"),
        ("iid", {"channels": 1}, "d476452811686d05"),
        ("binary", {}, "cf23f4d8a6883491"),
        ("binary", {"channels": 1}, "0c1918519f77ec11"),
        ("octave", {}, "f354428fa0e03397"),
        ("octave", {"channels": 1, "weights": [1, 2, 0.3]}, "e8774d7669c64535"),
        ("chessboard", {}, "d03199c3d481e4a6"),
        ("dot-matrix", {}, "5ae7e6a42304dc6e"),
        ("transparent", {}, "5ae7e6a42304dc6e"),
    ],
)
def test_bytes_of_a_seed_are_pinned(law, more, digits):
    """A seed names a sticker that was printed: another draw needs another law's name."""
    drawn = recipe(law, **more).patches()
    assert drawn.dtype == np.uint8
    assert hashlib.sha256(drawn.tobytes()).hexdigest().startswith(digits)


@pytest.mark.parametrize("law", ["algorithm1", "iid", "binary", "octave"])
def test_seed_and_channels(law):
    grey = recipe(law, channels=1).patches()
    assert (grey == grey[..., :1]).all()
    colour = recipe(law).patches()
    assert (colour[..., 0] != colour[..., 1]).any()
    assert not np.array_equal(colour, recipe(law, seed=6).patches())


def test_iid_equals_algorithm1_at_r_0():
    assert np.array_equal(recipe("iid").patches(), recipe("algorithm1", r=0.0).patches())


def test_binary_is_a_fair_coin():
    drawn = named("binary", 700).patches()
    assert set(np.unique(drawn)) == {0, 255}
    share = (drawn == 255).mean((0, 1))
    assert (np.abs(share - 0.5) < 4 * 0.5 / 700).all()


def test_octaves_correlate_like_their_blocks():
    """Before the mapping: share of places in one block, 1 - lag / side, weighted by variance."""
    n, blocks, weights = 640, [1, 2, 4, 8], [1.0, 0.5, 2.0, 1.5]
    rng = np.random.default_rng(3)
    layers = [rng.random((-(-n // side), -(-n // side), 3)) for side in blocks]
    sums = block_sums(layers, blocks, weights, np.arange(n), n)
    v = sums - sums.mean((0, 1))
    variance = sum(w * w for w in weights) / 12
    for lag in (0, 1, 2, 3, 4, 6, 8, 12):
        theory = sum(
            w * w / 12 * max(0.0, 1 - lag / side) for w, side in zip(weights, blocks, strict=True)
        )
        for moved in (v[:, lag:] * v[:, : n - lag], v[lag:] * v[: n - lag]):
            # 3 x 80^2 largest blocks: their mean product deviates by about 1 / 140
            assert moved.mean() == pytest.approx(theory, abs=4 * variance / 140)


@settings(max_examples=20, deadline=None)
@given(
    weights=st.lists(st.integers(1, 10_000).map(lambda k: k / 100), min_size=1, max_size=4),
    shares=st.lists(st.integers(0, 1000), min_size=1, max_size=5),
)
def test_sum_of_uniforms_matches_exact_fractions(weights, shares):
    """Inclusion and exclusion in fractions, for weights as unequal as the recipe allows."""
    exact = [Fraction(repr(w)) for w in weights]
    found = SumOfUniforms(tuple(weights))
    for share in shares:
        x = sum(exact) * Fraction(share, 1000)
        total = Fraction(0)
        for subset in product((0, 1), repeat=len(exact)):
            at = sum((w for w, s in zip(exact, subset, strict=True) if s), Fraction(0))
            total += (-1) ** sum(subset) * max(x - at, Fraction(0)) ** len(exact)
        total /= math.factorial(len(exact)) * math.prod(exact)
        assert float(found(np.array([float(x)]))[0]) == pytest.approx(float(total), abs=1e-9)


def test_opencv_finds_every_chessboard_corner(tmp_path):
    board = load_recipe("chessboard")
    squares = board.patches()
    assert (squares[1:] != squares[:-1]).all()
    assert (squares[:, 1:] != squares[:, :-1]).all()
    columns, rows = inner_corners(board, VIEW_MM)
    assert (columns, rows) == (20, 14)
    seen = cv2.GaussianBlur(
        (pattern_albedo(board, 0.0378, (586, 798))[..., 0] * 255).astype(np.uint8), (0, 0), 0.8
    )
    found, at_px = cv2.findChessboardCorners(seen, (columns, rows))
    assert found
    at_mm = (at_px.reshape(-1, 2) - (np.array([798, 586]) - 1) / 2) * 0.0378
    inner_mm = (np.arange(1, board.n) - board.n / 2) * board.patch_mm
    x_mm, y_mm = (inner_mm[np.abs(inner_mm) < side / 2] for side in VIEW_MM)
    true_mm = np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2)
    nearest = np.hypot(*(at_mm[:, None] - true_mm[None]).transpose(2, 0, 1)).argmin(0)
    assert len(set(nearest.tolist())) == 280
    assert np.abs(at_mm[nearest] - true_mm).max() < 0.01
    assert make_pattern(board, tmp_path / "c.png").inner_corners == (20, 14)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"size_mm": 25.0, "patch_mm": 1.0}, "do not fill the camera's view of 30.16 x 22.15 mm"),
        ({"size_mm": 40.0, "patch_mm": 8.0}, "at least 3 x 3, so at most 5.54 mm"),
    ],
)
def test_unusable_chessboard_is_refused(tmp_path, more, said):
    with pytest.raises(InputError, match=said):
        make_pattern(recipe("chessboard", **more), tmp_path / "c.png")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("law", list(PATTERN_LAWS))
def test_all_laws_but_film_take_dots(law):
    grid = {"columns": 2, "rows": 3, "pitch_x_mm": 1, "pitch_y_mm": 0.9, "colour": "#00ff00"}
    if law == "transparent":
        with pytest.raises(InputError, match="has no dots: remove them, or use law 'dot-matrix'"):
            recipe(law, dots=grid)
        return
    marked = recipe(law, dots=grid, size_mm=4.0)
    assert marked.dots is not None
    assert len(marked.dots.centres_mm()) == 6
    seen = pattern_albedo(marked, 0.05, (80, 80))
    for x_mm, y_mm in marked.dots.centres_mm():
        assert np.allclose(seen[round(y_mm / 0.05 + 39.5), round(x_mm / 0.05 + 39.5)], (0, 1, 0))


@pytest.mark.parametrize(
    ("law", "more", "said"),
    [
        ("octav", {}, "law: no such law; did you mean 'octave'? (got 'octav')"),
        ("iid", {"r": 0.1}, "r: law 'iid' does not use this key: remove it (used: patch_mm"),
        ("iid", {"patch_mm": None}, "patch_mm: law 'iid' needs this key"),
        ("chessboard", {"channels": 1}, "channels: law 'chessboard' does not use this key"),
        ("octave", {"scales_mm": None}, "scales_mm: law 'octave' needs this key"),
        ("octave", {"scales_mm": [0.1] * 7}, "scales_mm: Tuple should have at most 6 items"),
        ("octave", {"scales_mm": [0.1, 0.25]}, "scales_mm: 0.25 mm is 2.5 patches; a whole number"),
        ("octave", {"scales_mm": [0.05, 0.1]}, "scales_mm: 0.05 mm must lie between the patch"),
        ("octave", {"scales_mm": [0.2, 0.1]}, "scales_mm: the scales must rise"),
        ("octave", {"weights": [1, 1]}, "weights: one weight per scale: 2 for 3 scales"),
        ("octave", {"weights": [1, 1, 0]}, "weights.2: 0; expected 0.01 <= weights <= 100"),
        ("dot-matrix", {"dots": None}, "dots: law 'dot-matrix' needs"),
        ("dot-matrix", {"dots": {}}, "dots: white dots are invisible"),
        ("transparent", {"patch_mm": 0.1}, "patch_mm: law 'transparent' has no patches: remove"),
        ("iid", {"dots": {"offset_x_mm": 2.0, "columns": 1, "rows": 1}},
         "dots: the grid covers 0.6 x 0.6 mm about (2, 0) mm and must fit on the printed 4 mm"),
    ],
)  # fmt: skip
def test_law_refuses_foreign_keys(law, more, said):
    base = (
        {"law": law, "seed": 5}
        if law not in PATTERN_LAWS
        else recipe(law).model_dump(exclude_none=True)
    )
    with pytest.raises(InputError) as caught:
        validate(PatternRecipe, base | more, "p.toml")
    assert str(caught.value).startswith(f"p.toml: {said}")
    assert "\n" not in str(caught.value)
