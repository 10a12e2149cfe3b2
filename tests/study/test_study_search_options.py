"""What may be asked of a pattern search, and which candidates come of it."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import pytest

from deltact_fab.errors import InputError
from deltact_fab.patterns.raster import checked_mm_per_px
from deltact_fab.protocols import plan
from deltact_fab.study.search.candidates import (
    MAX_PX,
    MIN_DOTS,
    candidates,
    shortened,
    size_of,
    thinned,
)
from deltact_fab.study.search.imager import PatternImager, bench_of


def test_the_rig_file_is_the_default_and_options_win() -> None:
    plain, asked = (
        bench_of("virtual", {"dpi": None}),
        bench_of("virtual", {"dpi": 600, "blur_px": 1.1}),
    )
    assert (plain.printer.dpi, plain.sensor.blur_px, plain.mm_per_px) == (1200, 0.6, 0.0378)
    assert (asked.printer.dpi, asked.sensor.blur_px) == (600, 1.1)
    assert asked.printer.levels == plain.printer.levels


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"dpi": 10}, "dpi"),
        ({"levels": 1}, "levels"),
        ({"spread_um": -1.0}, "spread_um"),
        ({"spread_um": float("nan")}, "spread_um"),
        ({"misregistration_um": 1e5}, "misregistration_um"),
        ({"mm_per_px": 1.0}, "mm_per_px"),
        ({"mm_per_px": float("nan")}, "mm_per_px"),
        ({"blur_px": 0.0}, "blur_px"),
        ({"full_well_electrons": 0.0}, "full_well_electrons"),
        ({"inks": 4}, "inks: no such option"),
    ],
)
def test_nonsense_is_refused_by_name(more: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words) as why:
        bench_of("virtual", more)
    assert "\n" not in str(why.value)


def test_a_real_rig_has_no_printer() -> None:
    with pytest.raises(InputError, match="name a virtual rig"):
        bench_of("grbl-bench", {})


@pytest.mark.parametrize(
    ("dpi", "mm_per_px"), [(1200, 0.0378), (600, 0.0378), (2400, 0.02), (300, 0.08)]
)
def test_candidates_can_be_printed_and_seen(dpi: int, mm_per_px: float) -> None:
    mm_per_dot = 25.4 / dpi
    found = candidates(mm_per_dot, mm_per_px)
    assert len({c.name for c in found}) == len(found)
    assert [c.name for c in found if c.is_paper] == ["algorithm1 d 0.075 r 0.6"]
    for c in found:
        recipe = c.recipe(3)
        if not c.is_paper:
            assert recipe.patch_mm is not None
            assert (
                MIN_DOTS * mm_per_dot <= recipe.patch_mm * (1 + 1e-9) <= 1.01 * MAX_PX * mm_per_px
            )
            checked_mm_per_px(recipe, dpi, whole=False)
        assert recipe.dots is None


def test_the_usual_bench_has_some_tens_of_candidates() -> None:
    assert 30 <= len(candidates(25.4 / 1200, 0.0378)) <= 60


def test_a_bench_is_plain_data_and_back() -> None:
    bench = bench_of("virtual", {"mm_per_px": 0.03})
    assert PatternImager.from_dict(asdict(bench)) == bench


def test_the_view_is_the_sensors_whatever_the_scale() -> None:
    for mm_per_px in (0.0378, 0.02, 0.061):
        bench = bench_of("virtual", {"mm_per_px": mm_per_px})
        view, part = bench.view(), bench.view(100_000)
        assert view.width_px * mm_per_px == pytest.approx(30.16, abs=2 * mm_per_px)
        assert part.width_px * part.height_px <= 100_000
        assert view.width_px % 2 == view.height_px % 2 == part.width_px % 2 == 0
        assert bench.design().optics.mm_per_px == mm_per_px


def test_fewer_candidates_still_hold_the_papers() -> None:
    whole = candidates(25.4 / 1200, 0.0378)
    for scale in (0.02, 0.3, 1.0):
        size = size_of(scale, len(whole))
        among = thinned(whole, size.candidates, ())
        assert len(among) == size.candidates
        assert any(c.is_paper for c in among)
        assert {c.family for c in among} == {c.family for c in whole}
        assert size.held_out >= 2


def test_a_shorter_drag_keeps_the_step_between_frames() -> None:
    whole = plan.load("pattern-search")[0]
    short = shortened(whole, 0.02)
    assert short.shear is not None
    assert short.shear.amplitude_mm == pytest.approx(0.2)
    assert shortened(whole, 1.0) == whole
