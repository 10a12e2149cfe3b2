"""Recipes: the shipped ones, what they reject and in which words."""

from __future__ import annotations

import pytest

from deltact_fab.common import catalog, validate
from deltact_fab.common.errors import InputError
from deltact_fab.fabricate.patterns.recipe import PatternRecipe, choose_recipe, load_recipe

GOOD = {"law": "algorithm1", "seed": 1, "patch_mm": 0.1, "r": 0.2}


def test_shipped_recipes_include_the_papers():
    recipes = {name: load_recipe(name) for name in catalog.catalogue_names("patterns")}
    assert {"dense", "dense-with-dots", "dots", "transparent"} <= set(recipes)
    dense = recipes["dense"]
    assert (dense.patch_mm, dense.r, dense.size_mm) == (0.075, 0.6, 35.0)
    assert (dense.n, dense.printed_mm) == (466, 34.95)
    marked = recipes["dense-with-dots"].dots
    assert marked is not None
    assert marked.columns * marked.rows == 169


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"r": 1.0}, "p.toml: r: 1.0; expected 0 <= r < 1"),
        ({"r": float("nan")}, "p.toml: r: "),
        ({"patch_mm": 0.0}, "p.toml: patch_mm: 0.0; expected 0 < patch_mm <= 300"),
        ({"patch_mm": 36.0}, "p.toml: patch_mm: the patch size d must be at most the side, 35 mm"),
        ({"patch_mm": 0.001}, "p.toml: patch_mm: makes 3.5e+04 patches per side; at most 2000"),
        ({"size_mm": float("nan")}, "p.toml: size_mm: nan; expected 1 <= size_mm <= 300"),
        ({"seed": 1.5}, "p.toml: seed: "),
        ({"sede": 1}, "p.toml: sede: unknown key; did you mean 'seed'?"),
        ({"channels": 2}, "p.toml: channels: "),
        ({"dots": {"diameter_mm": 1.7}}, "p.toml: dots: diameter_mm must be below the pitch"),
        ({"dots": {"colour": "red"}}, "p.toml: dots.colour: "),
        (
            {"dots": {"offset_x_mm": -4.01}},
            "p.toml: dots: the grid covers 27 x 19.8 mm about (-4.01, 0) mm and must fit",
        ),
    ],
)
def test_bad_recipe_names_file_and_key(change, said):
    with pytest.raises(InputError) as caught:
        validate(PatternRecipe, GOOD | change, "p.toml")
    assert str(caught.value).startswith(said)
    assert "\n" not in str(caught.value)
    assert " | " not in str(caught.value)  # one fault is reported once


def test_options_override_a_named_recipe():
    recipe = choose_recipe("dense", seed=99, size_mm=30.0, with_dots=True)
    assert (recipe.seed, recipe.size_mm, recipe.patch_mm) == (99, 30.0, 0.075)
    assert recipe.dots is not None
    kept = choose_recipe("dots", with_dots=True)
    assert kept.dots == load_recipe("dots").dots
