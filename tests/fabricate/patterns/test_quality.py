"""Quality figures: closed forms, the facts they must show, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from deltact_fab.common import validate
from deltact_fab.common.errors import InputError
from deltact_fab.fabricate.patterns.dots import to_px
from deltact_fab.fabricate.patterns.quality.figures import (
    SUBSET_PX,
    agreement,
    figures,
    gradient,
    grey_levels,
    sssig,
)
from deltact_fab.fabricate.patterns.quality.measure import (
    MAX_DOTS,
    MAX_FIELD_PX,
    contrast_share,
    driver_image,
    field_px,
    measure_quality,
    photograph,
)
from deltact_fab.fabricate.patterns.recipe import PatternRecipe, choose_recipe, load_recipe
from deltact_fab.physics.imaging import print_colours
from deltact_fab.sensor.shapes.imaging import ImageSensor, Printer

RNG_SEED = 4
VIEW_MM = (320 * 0.0378,) * 2


def noise(*shape):
    return np.random.default_rng(RNG_SEED).normal(128, 20, shape)


def coloured(shade):
    return np.repeat(shade[..., None], 3, axis=-1)


def dense(d, r):
    return choose_recipe(None, d, r)


@pytest.mark.parametrize(("period_px", "axis"), [(8, 0), (15, 1)])
def test_a_sine_grating(period_px, axis):
    """Central differences are A sin(2 pi / P) cos: mean |cos| of the P phases, mean square 1/2."""
    amplitude = 60.0
    wave = 128 + amplitude * np.sin(2 * np.pi * np.arange(240) / period_px)
    shade = np.tile(wave, (240, 1)) if axis == 1 else np.tile(wave[:, None], (1, 240))
    slope = amplitude * math.sin(2 * math.pi / period_px)
    found = figures(coloured(shade), 0.05)
    mean_cos = np.abs(np.cos(2 * np.pi * np.arange(period_px) / period_px)).mean()
    # 238 px are not whole periods
    assert found.mean_gradient == pytest.approx(mean_cos * slope, rel=0.02)
    # Half of it, for the other axis has none
    assert found.sssig == pytest.approx(SUBSET_PX**2 * slope**2 / 4, rel=0.02)
    assert found.peak == pytest.approx(1, abs=0.02)
    assert found.peak_mm == pytest.approx(period_px * 0.05, rel=0.01)
    assert found.contrast[0] == pytest.approx(amplitude / math.sqrt(2), rel=0.01)
    # Means of two neighbours: cos(pi / P)
    assert found.contrast[1] == pytest.approx(
        found.contrast[0] * math.cos(math.pi / period_px), rel=0.01
    )


def test_white_noise():
    found = figures(coloured(noise(256, 320)), 0.05)
    for level, contrast_ in enumerate(found.contrast):
        pixels = 256 * 320 / 4**level
        assert contrast_ == pytest.approx(20 / 2**level, rel=4 / math.sqrt(2 * pixels))
    # Central differences of unit noise: each component has variance 1/2; Rayleigh's mean
    assert found.mean_gradient == pytest.approx(20 * math.sqrt(math.pi) / 2, rel=0.01)
    assert found.sssig == pytest.approx(SUBSET_PX**2 * 20**2 / 2, rel=0.01)
    assert found.sssig_least < found.sssig
    assert (found.peak, found.peak_mm) == (0, None)


def test_poorest_subset_is_reported():
    shade = noise(200, 200)
    shade[60:77, 100:117] = 128
    assert sssig(*gradient(shade))[0] == pytest.approx(0, abs=1e-6)
    shade[60:77, 100:116] = 0  # one pixel less: the differences reach in
    assert sssig(*gradient(shade))[0] > 1


@pytest.mark.parametrize(("d", "r"), [(0.05, 0.6), (0.1, None)])
def test_nearest_copy_is_one_diagonal_away(d, r):
    """1.3 to 2.6 camera pixels a patch: its nearest copy, at (d, d), is between two pixels."""
    board = {"law": "chessboard", "seed": 0, "patch_mm": d}
    recipe = validate(PatternRecipe, board, "x") if r is None else dense(d, r)
    found = measure_quality(recipe, mm_per_px=0.0378, view_mm=VIEW_MM)
    assert found.designed.peak_mm == pytest.approx(d * math.sqrt(2), rel=0.03)
    assert found.designed.peak > 0.84


def test_agreement_tolerates_subpixel_shifts_only():
    """A smooth field, sampled again 0.375 px away; then one that has nothing in common."""
    i, j = np.mgrid[:128, :128] * 2 * np.pi / 128

    def field(shift_px):
        a, b = i + shift_px * 2 * np.pi / 128, j - shift_px * 2 * np.pi / 128
        return np.sin(9 * a) * np.cos(11 * b) + np.sin(20 * a - 13 * b)

    assert agreement(field(0.375), field(0)) == pytest.approx(1, abs=1e-9)
    assert agreement(-field(0.375), field(0)) == pytest.approx(-1, abs=1e-9)
    assert abs(agreement(field(5.0), field(0))) < 0.9
    assert abs(agreement(noise(128, 128), field(0))) < 0.1
    assert agreement(np.ones((9, 9)), noise(9, 9)) == 0


def test_noise_is_not_kept_contrast():
    original = coloured(noise(300, 300))
    rest = np.random.default_rng(9).normal(0, 30, original.shape)
    assert contrast_share(0.3 * original + rest, original, original) == pytest.approx(0.3, abs=0.02)
    assert contrast_share(rest, original, original) < 0.03
    assert contrast_share(original, original, np.ones((5, 5, 3))) is None


@pytest.mark.slow
def test_fine_patches_lose_contrast():
    """d = 0.05 at 1200 dpi is 2.4 printer dots and 1.3 camera pixels a patch."""
    by_d = {d: measure_quality(dense(d, 0.3), view_mm=VIEW_MM) for d in (0.05, 0.1, 0.15)}
    fine, coarse = by_d[0.05], by_d[0.15]
    assert fine.dots_a_patch == pytest.approx(0.05 / 25.4 * 1200)
    assert fine.px_a_patch == pytest.approx(0.05 / 0.0378)
    assert (fine.printable, fine.seen) == (False, False)
    assert (coarse.printable, coarse.seen) == (True, True)
    for share in ("print_contrast", "camera_contrast"):
        values = [getattr(found, share) for found in by_d.values()]
        assert values == sorted(values)
    gradients = [found.photographed.mean_gradient for found in by_d.values()]
    assert gradients == sorted(gradients)  # the rank that the camera gives the five
    assert fine.photographed.contrast[0] < 0.25 * fine.designed.contrast[0]


def test_photograph_keeps_dot_positions():
    """Centroids of 169 dots, printed and photographed without noise, against their places."""
    recipe = load_recipe("dots")
    printer = Printer(misregistration_um=0.0)
    sensor = ImageSensor(shading=0.0, full_well_electrons=1e9, read_noise_electrons=0.0)
    size_px, mm_per_px = (586, 798), 0.0378
    rng = np.random.default_rng(0)
    image = driver_image(recipe, printer.dpi, (size_px[1] * mm_per_px, size_px[0] * mm_per_px))
    printed = print_colours(printer, image.astype(np.float32) / 255, rng)
    ink = 255 - grey_levels(
        photograph(printed, printer.mm_per_dot, sensor, mm_per_px, size_px, rng)
    )
    ink -= np.median(ink)
    assert recipe.dots is not None
    for x_px, y_px in to_px(recipe.dots.centres_mm(), mm_per_px, size_px):
        left, top = round(x_px) - 14, round(y_px) - 14
        part = ink[top : top + 29, left : left + 29]
        rows, columns = np.mgrid[top : top + part.shape[0], left : left + part.shape[1]]
        assert (columns * part).sum() / part.sum() == pytest.approx(x_px, abs=0.1)
        assert (rows * part).sum() / part.sum() == pytest.approx(y_px, abs=0.1)


def test_extreme_patterns_are_measured():
    tiny = measure_quality(choose_recipe(None, 0.02, 0.1, size_mm=6.0))  # below a printer dot
    assert tiny.dots_a_patch < 1
    assert not tiny.printable
    assert tiny.print_contrast < 0.4
    film = measure_quality(load_recipe("transparent"), view_mm=VIEW_MM)
    assert (film.print_contrast, film.camera_contrast, film.dots_a_patch) == (None, None, None)
    assert (film.printable, film.seen) == (True, False)
    assert film.photographed.contrast[0] < 2


def test_field_is_limited_by_memory():
    recipe = dense(0.1, 0.1)
    assert field_px(recipe, 25.4 / 1200, 0.0378, None) == (586, 798)
    rows, columns = field_px(recipe, 25.4 / 9600, 0.0378, None)
    dots = rows * columns * (0.0378 * 9600 / 25.4) ** 2
    assert 0.9 * MAX_DOTS < dots <= MAX_DOTS
    assert columns / rows == pytest.approx(798 / 586, rel=0.01)
    rows, columns = field_px(recipe, 25.4 / 1200, 0.005, None)
    assert 0.9 * MAX_FIELD_PX < rows * columns <= MAX_FIELD_PX
    assert field_px(recipe, 25.4 / 1200, 0.0378, (100.0, 5.0)) == (132, 925)  # 35 mm wide


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"mm_per_px": math.nan}, "mm_per_px nan and dpi 1200 must be above 0"),
        ({"printer": Printer(dpi=0)}, "dpi 0 must be above 0"),
        ({"seed": -1}, "seed -1 0 or above"),
        ({"mm_per_px": 0.5}, "field is 60 x 44 px of 0.5 mm .* at least 64 px per side"),
        ({"printer": Printer(dpi=10**8)}, "field is 0 x 0 px .* million dots at 100000000 dpi"),
    ],
)
def test_bad_scales_give_one_line(more, said):
    with pytest.raises(InputError, match=said):
        measure_quality(dense(0.15, 0.1), **more)
