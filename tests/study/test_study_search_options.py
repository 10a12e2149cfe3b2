"""What may be asked of a pattern search, and which candidates come of it."""

from __future__ import annotations

from typing import Any

import pytest

from deltact_fab.errors import InputError
from deltact_fab.patterns.raster import checked_mm_per_px
from deltact_fab.patterns.recipe import RECOMMENDED, load_recipe
from deltact_fab.protocols import plan
from deltact_fab.study.search.candidates import (
    MAX_PX,
    MIN_DOTS,
    PAPER,
    candidates,
    name_of,
    shortened,
    thinned,
)
from deltact_fab.study.search.imager import bench_of


def test_the_rig_file_is_the_default_and_options_win() -> None:
    (rig, sensor), (other, seen) = bench_of("virtual"), bench_of("virtual", 600, 0.05)
    assert (rig.virtual.printer.dpi, sensor.optics.mm_per_px) == (1200, 0.0378)
    assert (other.virtual.printer.dpi, seen.optics.mm_per_px) == (600, 0.05)
    assert other.virtual.printer.levels == rig.virtual.printer.levels
    assert (rig.virtual.lens, rig.camera) == (None, None)


@pytest.mark.parametrize("more", [{"dpi": 10}, {"mm_per_px": 1.0}, {"mm_per_px": float("nan")}])
def test_nonsense_is_refused_by_name(more: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=next(iter(more))) as why:
        bench_of("virtual", **more)
    assert "\n" not in str(why.value)


@pytest.mark.parametrize(
    ("dpi", "mm_per_px"), [(1200, 0.0378), (600, 0.0378), (2400, 0.02), (300, 0.08)]
)
def test_candidates_can_be_printed_and_seen(dpi: int, mm_per_px: float) -> None:
    mm_per_dot = 25.4 / dpi
    found = candidates(mm_per_dot, mm_per_px)
    assert name_of(found[PAPER]) == PAPER
    for name, recipe in found.items():
        if name != PAPER:
            assert recipe.patch_mm is not None
            assert (
                MIN_DOTS * mm_per_dot <= recipe.patch_mm * (1 + 1e-9) <= 1.01 * MAX_PX * mm_per_px
            )
            checked_mm_per_px(recipe, dpi, whole=False)
        assert recipe.dots is None


def test_fewer_candidates_still_hold_the_papers_and_the_recommended() -> None:
    whole = candidates(25.4 / 1200, 0.0378)
    kept = (PAPER, name_of(load_recipe(RECOMMENDED)))
    for count in (10, 20, len(whole)):
        among = thinned(whole, count, kept)
        assert len(among) == count
        assert set(kept) <= set(among)
        assert {one.law for one in among.values()} == {one.law for one in whole.values()}


def test_a_shorter_drag_keeps_the_step_between_frames() -> None:
    whole = plan.load("pattern-search")[0]
    short = shortened(whole, 0.02)
    assert short.shear is not None
    assert short.shear.amplitude_mm == pytest.approx(0.2)
    assert shortened(whole, 1.0) == whole
