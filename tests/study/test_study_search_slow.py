"""A pattern search from its name to its recipe, on a coarse gel and few candidates."""

from __future__ import annotations

import json
import tomllib

import numpy as np
import pytest

from deltact_fab.patterns.recipe import recipe_from
from deltact_fab.study.registry import run
from deltact_fab.study.request import StudyRequest

pytestmark = pytest.mark.slow


def test_a_small_search_finds_a_better_pattern_than_the_papers() -> None:
    found = run("pattern-search", StudyRequest(scale=0.02, rig="virtual-coarse", seed=1))
    data = json.loads(json.dumps(found.data, allow_nan=False))
    error, share, *_ = found.headlines
    assert 0 < error.value < 50  # um
    assert share.value < 1 / 3
    assert share.state == "undecided"  # two seeds show nothing
    assert len(" ".join(found.verdict).split()) <= 80
    assert found.verdict[0].startswith(f"Print {data['best']['pattern']}")
    recipe = recipe_from(tomllib.loads(found.files["best-pattern.toml"]), "best")
    assert recipe.model_dump(mode="json", exclude_none=True) == data["best"]["recipe"]
    rows = data["tables"]["confirmed"]
    assert {row["pattern"] for row in rows} >= {"algorithm1 d 0.075 r 0.6"}
    assert all(0 < row["mean_error_mm"] < 0.05 for row in rows)
    for drawn in found.figures:
        figure = drawn.draw()
        figure.draw_without_rendering()
        assert np.all(figure.get_size_inches() > 1)
