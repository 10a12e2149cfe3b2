"""The text of a sheet's QR code: back to the identical recipe, or one clear line."""

from __future__ import annotations

import hashlib
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deltact_fab.common import catalog, validate
from deltact_fab.common.errors import InputError
from deltact_fab.fabricate.patterns.code import decode_recipe, encode
from deltact_fab.fabricate.patterns.recipe import PatternRecipe, choose_recipe, load_recipe

SMALL = choose_recipe(None, 0.5, 0.1, size_mm=5.0)
CODE = encode(SMALL)


def signed(body: str, drawn: str) -> str:
    """A text with right check digits."""
    return f"{body}/{drawn}-{hashlib.sha256(body.lower().encode()).hexdigest()[:6]}".upper()


@pytest.mark.parametrize("name", catalog.catalogue_names("patterns"))
def test_shipped_recipes_round_trip(name):
    recipe = load_recipe(name)
    text = encode(recipe)
    back = decode_recipe(text)
    assert back == recipe
    assert np.array_equal(back.patches(), recipe.patches())
    # The QR code's dense set, and short enough for a symbol of 17 mm
    assert re.fullmatch(r"[0-9A-Z $%*+\-./:]+", text)
    assert len(text) <= 221  # version 8, level M


@settings(max_examples=30, deadline=None)
@given(
    patch_mm=st.floats(0.3, 5.0),
    r=st.floats(0, 1, exclude_max=True),
    seed=st.integers(0, 2**63 - 1),
    size_mm=st.floats(5.0, 20.0),
    channels=st.sampled_from([1, 3]),
    diameter_mm=st.none() | st.floats(1e-3, 0.9),
)
def test_any_recipe_round_trips_exactly(patch_mm, r, seed, size_mm, channels, diameter_mm):
    data = {
        "law": "algorithm1",
        "seed": seed,
        "size_mm": size_mm,
        "patch_mm": patch_mm,
        "r": r,
        "channels": channels,
    }
    if diameter_mm is not None:
        data["dots"] = {
            "columns": 2,
            "rows": 3,
            "pitch_x_mm": 1.0,
            "pitch_y_mm": 0.95,
            "diameter_mm": diameter_mm,
            "colour": "#0123ef",
        }
        if max(1.0 + diameter_mm, 1.9 + diameter_mm) > size_mm // patch_mm * patch_mm:
            del data["dots"]
    recipe = validate(PatternRecipe, data, "test")
    assert decode_recipe(encode(recipe)) == recipe


def test_code_of_older_version_decodes():
    text = (
        "DELTACT1/LAW:ALGORITHM1/SEED:7/SIZE-MM:35/PATCH-MM:0.075/R:0.6/CHANNELS:3/"
        "1EF08C35F591-24EABE"
    )
    assert decode_recipe(text) == load_recipe("dense")
    assert decode_recipe(text.lower().replace("/", "/\n ")) == load_recipe("dense")


def test_every_single_error_is_detected():
    for k, old in enumerate(CODE):
        for new in ("0", "1", "A", "-", ":"):
            if new == old:
                continue
            with pytest.raises(InputError) as why:
                decode_recipe(CODE[:k] + new + CODE[k + 1 :])
            assert "\n" not in str(why.value)
            assert len(str(why.value)) < 300
    for k in range(len(CODE)):
        with pytest.raises(InputError):
            decode_recipe(CODE[:k])
        with pytest.raises(InputError):
            decode_recipe(CODE[:k] + CODE[k + 1 :])


BODY, DRAWN = CODE.rsplit("/", 1)[0], CODE.rsplit("/", 1)[1].split("-")[0]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "begins with DELTACT1/"),
        ("DELTACT1/", "truncated"),
        (CODE.replace("R:0.1", "R:0.2"), "damaged or mistyped"),
        (signed(BODY.replace("R:0.1", "R:0.2"), DRAWN), "another version"),
        (signed(BODY.replace("R:0.1", "R:1E999"), DRAWN), "r"),
        (signed(BODY.replace("R:0.1", "R"), DRAWN), "KEY:VALUE"),
        (signed(BODY.replace("/R:0.1", "/R:0.1/R:0.1"), DRAWN), "twice"),
    ],
)
def test_wrong_text_gives_one_line(text, says):
    with pytest.raises(InputError, match=re.escape(says)) as why:
        decode_recipe(text)
    assert "\n" not in str(why.value)
