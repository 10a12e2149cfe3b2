"""The paper's table of sensors, recomputed, and what it says of the paper's claims."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import pytest

from deltact_fab.cad.design import load_design
from deltact_fab.cad.envelope import size_mm
from deltact_fab.errors import InputError
from deltact_fab.report import figures
from deltact_fab.report.result import StudyResult
from deltact_fab.study import comparison, sensors
from deltact_fab.study.request import StudyRequest

MINE = """
base = "deltact"
[mount]
length_mm = 25.0
[optics]
image_width_px = 700
"""


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> StudyResult:
    mine = tmp_path_factory.mktemp("cad") / "mine.toml"
    mine.write_text(MINE)
    return comparison.run(StudyRequest(more={"design": (str(mine), "deltact")}))


@pytest.mark.parametrize(
    ("cite", "pixel_mm", "printed"),
    [
        # sqrt(area / pixels), worked out by hand from the paper's table
        ("dong2017improved", 0.028641, "cut off"),
        ("taylor2021gelslim3", 0.046875, "rounded"),
        ("lambeta2020digit", 0.031509, "cut off"),
        ("yamaguchi2016combining", 0.049411, "rounded"),
        ("sferrazza2019design", 0.054127, "rounded"),
        ("ward2018tactip", 1.968894, "cut off"),
        ("du2021high", 0.049608, "cut off"),
        ("deltact", 0.037993, "cut off"),
    ],
)
def test_pixel_sizes_follow_from_area_and_pixels(cite: str, pixel_mm: float, printed: str) -> None:
    (one,) = [s for s in sensors.IN_TABLE if s.cite == cite]
    assert one.true_pixel_mm == pytest.approx(pixel_mm, abs=1e-6)
    assert one.printed == printed


def test_a_printed_size_that_fits_nothing_is_told() -> None:
    odd = sensors.SensorRow("x", "x", "x", (1, 1, 1), (100, 100), 100.0, "0.12")
    assert odd.true_pixel_mm == pytest.approx(0.1)
    assert odd.printed == "differs"


@pytest.mark.parametrize(
    ("theirs", "measure", "percent"),
    [
        ((51, 65, 52), "volume", 59.276),  # 70200 against 172380 mm3
        ((51, 65, 52), "footprint, first x second side", 29.412),
        ((51, 65, 52), "surface of the box", 43.190),
        ((51, 65, 52), "sum of the sides", 23.214),
        ((51, 65, 52), "longest side", 7.692),
        ((51, 65, 52), "third side", 42.308),
        ((51, 65, 52), "diagonal", 20.515),
        ((20, 20, 26), "volume", -575.0),  # 70200 against 10400 mm3
        ((52, 108, 69), "volume", 81.884),  # 70200 against 387504 mm3
    ],
)
def test_reductions(theirs: sensors.Size, measure: str, percent: float) -> None:
    assert 100 * sensors.reduction(theirs, measure) == pytest.approx(percent, abs=1e-3)


def test_bounds_are_those_of_the_worst_rounding() -> None:
    low, high = sensors.bounds((51, 65, 52))
    assert low == pytest.approx(1 - 39.5 * 60.5 * 30.5 / (50.5 * 64.5 * 51.5))
    assert high == pytest.approx(1 - 38.5 * 59.5 * 29.5 / (51.5 * 65.5 * 52.5))
    assert low < sensors.reduction((51, 65, 52)) < high


def test_a_third_fits_no_measure_and_the_footprint_best() -> None:
    measure, share = sensors.nearest_measure()
    assert measure == "footprint, first x second side"
    assert share == pytest.approx(0.2941, abs=1e-4)


def test_the_verdict_says_that_table_and_figure_contradict_each_other(result: StudyResult) -> None:
    first, second, *_ = result.verdict
    assert "59 % smaller by volume" in first
    assert "6.8 times as large" in first
    assert "not one-third" in first
    assert "20 x 20 x 26 mm and 51 x 65 x 52 mm" in second
    assert "520 mm²" in second  # the table's largest side cannot hold the area of its own row
    assert "756 mm²" in second
    tactip = next(s for s in sensors.IN_TABLE if s.name == "TacTip")
    assert tactip.size_mm == sensors.PREDECESSOR.size_mm


def test_claims_are_held_against_ranks_in_the_table() -> None:
    said = sensors.claims()
    assert {name: one.holds for name, one in said.items()} == {
        "third": "no",
        "smaller": "yes, by the figure; no, by the table",
        "same area": "nearly",
        "large area": "yes",
        "compact": "hardly",
        "pixel": "cut off, not rounded",
    }
    assert "11 % less" in said["same area"].figures
    assert (
        "place 4 of 8 by area, 3 by pixel size and 1 by number of pixels"
        in said["large area"].figures
    )
    assert "place 6 of 8 by volume" in said["compact"].figures
    assert "640 mm²" in said["pixel"].figures


def test_equal_ones_share_a_place() -> None:
    assert sensors.rank([1.0, 2.0, 2.0, 3.0], 2.0) == 2
    assert sensors.rank([0.1 + 0.2], 0.3) == 1


def test_own_designs_are_rows_of_their_dimensions(result: StudyResult) -> None:
    table = result.tables[1].frame.set_index("sensor")
    own = table[table["said_in"] == "own design"]
    assert list(own.index) == [
        "own: deltact", "own: fingertip-24x24", "own: franka", "own: large-60x50",
        "own: screws-19mm", "own: skin-30x34", "own: skin-44x40", "own: mine",
    ]  # fmt: skip
    assert own.loc["own: deltact", "size_mm"] == "39 x 60 x 30"
    assert own.loc["own: deltact", "area_mm2"] == pytest.approx(798 * 586 * 0.0378**2)
    assert own.loc["own: deltact", "pixel_mm"] == pytest.approx(0.0378)
    assert own.loc["own: skin-44x40", "volume_cm3"] == pytest.approx(47 * 66 * 30.6 / 1e3)
    assert own.loc["own: skin-30x34", "pixels"] == "660 x 586"
    assert own.loc["own: mine", "size_mm"] == "39 x 65 x 30"
    assert own.loc["own: mine", "area_mm2"] == pytest.approx(700 * 586 * 0.0378**2)


def test_a_view_beyond_the_face_is_bad_input(tmp_path: Path) -> None:
    path = tmp_path / "wide.toml"
    path.write_text('base = "deltact"\n[optics]\nimage_width_px = 1000\n')
    # 1000 px see 37.8 mm, and the face is 36 mm wide
    with pytest.raises(InputError, match=r"wide\.toml: skin: view .* 37\.8 <= 36 fails"):
        comparison.sensor_of(str(path))


def test_the_size_is_that_of_the_parts() -> None:
    assert size_mm(load_design("skin-44x40")) == pytest.approx((47, 66, 30.6))
    higher = load_design("deltact", ["mount.height_mm=8", "mount.length_mm=25"])
    assert size_mm(higher) == pytest.approx((39, 65, 30))


@pytest.mark.slow
def test_no_kernel_is_loaded_for_the_size() -> None:
    code = (
        "import sys; from deltact_fab.study import comparison; comparison.sensor_of('deltact'); "
        "sys.exit('OCP' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_design_that_is_none_is_bad_input(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        comparison.run(StudyRequest(more={"design": (str(tmp_path / "none.toml"),)}))
    bad = tmp_path / "bad.toml"
    bad.write_text('base = "deltact"\n[skin]\nwidth_cm = 3\n')
    with pytest.raises(InputError, match=r"bad\.toml: skin\.width_cm"):
        comparison.run(StudyRequest(more={"design": (str(bad),)}))


@pytest.mark.parametrize(
    "asked",
    [StudyRequest(scale=0.5), StudyRequest(rig="virtual"), StudyRequest(runs=(Path("run"),))],
)
def test_what_it_does_not_depend_on_is_refused(asked: StudyRequest) -> None:
    with pytest.raises(InputError, match="the study comparison has no use for it"):
        comparison.run(asked)


def test_headlines_and_data_are_plain_and_of_the_paper(result: StudyResult) -> None:
    assert not result.simulated
    by_volume = result.headlines[0]
    assert by_volume.value == pytest.approx(59.276, abs=1e-3)
    assert by_volume.low == pytest.approx(56.55, abs=0.01)
    assert by_volume.high == pytest.approx(61.84, abs=0.01)
    assert by_volume.paper == pytest.approx(100 / 3)
    data = json.loads(json.dumps(result.data, allow_nan=False))
    gecko = next(row for row in data["sensors"] if row["cite"] == "pang2021viko")
    assert gecko["area_mm2"] is None
    assert gecko["volume_cm3"] == pytest.approx(387.504)
    assert len(data["claims"]) == 6
    assert math.isclose(data["reductions"][0]["than_table_percent"], -575.0)


def test_figures_name_every_sensor_and_nothing_is_clipped(result: StudyResult) -> None:
    bars, scatter = (figures.draw(one) for one in result.figures)
    names = [label.get_text() for label in bars.axes[0].get_yticklabels()]
    table = result.tables[1].frame
    assert sorted(names) == sorted(table["sensor"])
    assert len(bars.axes[0].patches) == len(table)
    labels = ", ".join(text.get_text() for text in scatter.axes[0].texts)
    for name in table.loc[table["area_mm2"].notna(), "sensor"]:
        assert name.removeprefix("own: ") in labels
    assert not figures.runs_over(bars)
    assert not figures.runs_over(scatter)
