"""Files and images: size, edges, dots, orientation, bytes."""

from __future__ import annotations

import csv
import hashlib
import io

import numpy as np
import pytest
from PIL import Image

from deltact_fab.common import validate
from deltact_fab.common.errors import InputError
from deltact_fab.fabricate.patterns.dots import check_inside
from deltact_fab.fabricate.patterns.metadata import read_recipe
from deltact_fab.fabricate.patterns.raster import make_pattern, pattern_albedo, raster
from deltact_fab.fabricate.patterns.recipe import DotGrid, PatternRecipe, choose_recipe, load_recipe
from deltact_fab.sensor.shapes.sensor import SensorDimensions

PLAIN = choose_recipe(None, 0.15, 0.1, size_mm=9.0)
MARKED = validate(
    PatternRecipe,
    PLAIN.model_dump(exclude_none=True) | {"dots": {"columns": 3, "rows": 2}},
    "marked",
)


def physical_mm(path):
    """Side of a PNG in mm, from the raw pHYs chunk and the header."""
    data = path.read_bytes()
    at = data.index(b"pHYs") + 4
    across, down = (int.from_bytes(data[at + k : at + k + 4], "big") for k in (0, 4))
    assert (across, data[at + 8]) == (down, 1)  # 1: the unit is the metre
    return int.from_bytes(data[16:20], "big") / across * 1000


@pytest.mark.parametrize("dpi", [None, 1200])
def test_physical_size(tmp_path, dpi):
    made = make_pattern(PLAIN, tmp_path / "p.png", dpi)
    half_dot_mm = 0 if dpi is None else made.mm_per_px / 2
    # pHYs counts whole pixels per metre
    rounding_mm = 9.0 * 0.5 / (1000 / made.mm_per_px)
    assert abs(physical_mm(made.image) - 9.0) <= half_dot_mm + rounding_mm


def test_papers_pattern_is_exact_in_dots(tmp_path):
    made = make_pattern(load_recipe("dense"), tmp_path / "d.png")
    assert (made.side_px, made.as_dict()["size_mm"]) == (466, 34.95)
    assert abs(physical_mm(made.image) - 34.95) < 0.001
    printed = make_pattern(load_recipe("dots"), tmp_path / "q.png")
    with Image.open(printed.image) as image:
        assert image.info["dpi"][0] == pytest.approx(1200, abs=0.01)


@pytest.mark.parametrize(("patch_mm", "dpi"), [(0.075, 1200), (0.15, 600), (0.1, 1439.5)])
def test_no_edge_drifts(patch_mm, dpi):
    recipe = choose_recipe(None, patch_mm, 0.6, size_mm=20.0)
    image = raster(recipe, dpi).astype(int)
    mm_per_px = 25.4 / dpi
    side_px = image.shape[0]
    # At r = 0.6 every neighbour differs, so the edges can be read off the first row
    edges_px = np.flatnonzero(np.abs(np.diff(image[0, :, 0]))) + 1
    found_mm = (edges_px - side_px / 2) * mm_per_px
    true_mm = (np.arange(1, recipe.n) - recipe.n / 2) * patch_mm
    assert len(found_mm) == recipe.n - 1
    assert np.abs(found_mm - true_mm).max() <= mm_per_px / 2 + 1e-9


def test_first_pixel_is_minus_x_y():
    seen = pattern_albedo(PLAIN, 0.15)
    assert seen.shape == (60, 60, 3)
    assert np.allclose(seen * 255, PLAIN.patches(), atol=1e-4)
    # Two dots in one row lie along x, which is the image's columns
    grid = {"columns": 2, "rows": 1, "colour": "#000000"}
    lone = validate(PatternRecipe, {"law": "dot-matrix", "seed": 0, "dots": grid}, "x")
    dark = np.argwhere(raster(lone, 300)[..., 0] == 0)
    side = raster(lone, 300).shape[0]
    x_mm = (dark[:, 1] - (side - 1) / 2) * 25.4 / 300
    y_mm = (dark[:, 0] - (side - 1) / 2) * 25.4 / 300
    assert np.abs(np.abs(x_mm) - 1.1).max() <= 0.3
    assert np.abs(y_mm).max() <= 0.3


def test_dots_outside_view_are_refused(tmp_path):
    view_mm = SensorDimensions().optics.view_mm
    for inside in ({}, {"pitch_x_mm": 2.46}, {"pitch_y_mm": 1.79}, {"offset_x_mm": 1.58}):
        check_inside(DotGrid(**inside), view_mm)
    for outside, said in (
        ({"pitch_x_mm": 2.5}, "x they reach 15.3 mm .* sees 15.08 mm; reduce columns, pitch_x_mm"),
        ({"pitch_y_mm": 1.8}, "y they reach 11.1 mm .* 11.07 mm; reduce rows, pitch_y_mm"),
        ({"columns": 1, "rows": 1, "diameter_mm": 25.0}, "y they reach 12.5 mm"),
        ({"offset_x_mm": -1.59}, "x they reach 15.09 mm .* offset_x_mm"),
    ):
        with pytest.raises(InputError, match=said):
            check_inside(DotGrid(**outside), view_mm)
    wide = {"law": "dot-matrix", "seed": 0, "dots": {"pitch_x_mm": 2.6, "colour": "#000000"}}
    with pytest.raises(InputError, match="reduce columns"):
        make_pattern(validate(PatternRecipe, wide, "x"), tmp_path / "w.png")
    assert list(tmp_path.iterdir()) == []


SET_OFF = {
    "columns": 5,
    "rows": 2,
    "pitch_x_mm": 1.7,
    "pitch_y_mm": 2.3,
    "diameter_mm": 0.5,
    "offset_x_mm": 0.83,
    "offset_y_mm": -0.41,
    "colour": "#000000",
}


@pytest.mark.parametrize("dpi", [600, 1437.7])
def test_png_contains_dot_positions(tmp_path, dpi):
    """Centres in px and mm, against the centroids of its black pixels and the table beside it."""
    plain = {"law": "dot-matrix", "seed": 0, "size_mm": 12.0, "dots": SET_OFF}
    made = make_pattern(validate(PatternRecipe, plain, "x"), tmp_path / "q.png", dpi)
    with Image.open(made.image) as image:
        dark = np.asarray(image)[..., 0] == 0
        table = list(csv.DictReader(io.StringIO(image.text["dots_csv"])))
        mm_per_px = float(image.text["mm_per_px"])
    assert table == list(csv.DictReader(io.StringIO(made.dots_csv.read_text())))
    at_mm, listed_px = (
        np.array([[float(row[f"{axis}_{unit}"]) for axis in "xy"] for row in table])
        for unit in ("mm", "px")
    )
    assert np.abs(at_mm - read_recipe(made.image).dots.centres_mm()).max() <= 0.5e-6 * (1 + 1e-6)
    at_px = np.argwhere(dark)[:, ::-1]
    nearest = np.argmin(((at_px[:, None] - listed_px) ** 2).sum(-1), axis=1)
    for index, centre_px in enumerate(listed_px):
        own = at_px[nearest == index]
        assert np.abs(own.mean(0) - centre_px).max() < 0.15
        assert len(own) == pytest.approx(np.pi * (0.25 / mm_per_px) ** 2, rel=0.04)


def test_equal_recipes_give_equal_bytes(tmp_path):
    one, two = (make_pattern(MARKED, tmp_path / f"{name}.png") for name in "ab")
    assert one.image.read_bytes() == two.image.read_bytes()
    assert one.image_sha256 == hashlib.sha256(one.image.read_bytes()).hexdigest()
    assert one.dots_csv is not None
    assert one.dots_sha256 == hashlib.sha256(one.dots_csv.read_bytes()).hexdigest()
    assert read_recipe(one.image) == MARKED
    again = make_pattern(read_recipe(one.image), tmp_path / "c.png")
    assert again.image_sha256 == one.image_sha256
    with Image.open(one.image) as image:
        assert image.text["dots_sha256"] == one.dots_sha256
        assert float(image.text["mm_per_px"]) == 25.4 / 1200


def test_albedo_is_exact_by_area():
    """Coarse pixels of any size hold the means of the fine picture that they cover."""
    fine = pattern_albedo(PLAIN, 0.015, (660, 660))  # ten pixels a patch, edges on pixel edges
    coarse = pattern_albedo(PLAIN, 0.06, (165, 165))
    means = fine.reshape(165, 4, 165, 4, 3).mean(axis=(1, 3), dtype=np.float64)
    assert fine.dtype == coarse.dtype == np.float32
    assert np.abs(coarse - means).max() < 1e-5
    assert coarse.min() >= 0
    assert coarse.max() <= 1


def test_albedo_outside_sticker_is_white():
    recipe = load_recipe("dots")
    seen = pattern_albedo(recipe, 0.1, (400, 380))
    assert np.allclose(seen[0, 0], 1)
    assert np.allclose(seen[200, 17 + 1], 1)
    # Covered area of 169 discs of 0.6 mm
    missing_mm2 = (1 - seen[..., 0]).sum(dtype=np.float64) * 0.1**2
    assert missing_mm2 == pytest.approx(169 * np.pi * 0.3**2, rel=1e-3)
    with pytest.raises(InputError, match="mm_per_px"):
        pattern_albedo(recipe, 0.0)


def test_centres_are_ordered_by_row():
    found = DotGrid(columns=3, rows=2, offset_x_mm=0.5, offset_y_mm=-0.1).centres_mm()
    rows = [[-1.7, y, 0.5, y, 2.7, y] for y in (-0.9, 0.7)]
    assert found == pytest.approx(np.array(rows).reshape(6, 2))
