"""The paper's table of sensors, recomputed, and what it says of the paper's claims."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from deltact_fab.cad.design import load_design
from deltact_fab.cad.envelope import size_mm
from deltact_fab.errors import InputError
from deltact_fab.report import figures
from deltact_fab.report.result import StudyResult
from deltact_fab.study import comparison
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
    ("name", "pixel_mm", "printed"),
    [
        # sqrt(area / pixels), worked out by hand from the paper's table
        ("GelSight (2017)", 0.028641, "cut off"),
        ("GelSlim 3.0", 0.046875, "rounded"),
        ("DIGIT", 0.031509, "cut off"),
        ("FingerVision (2016)", 0.049411, "rounded"),
        ("Sferrazza, D'Andrea", 0.054127, "rounded"),
        ("TacTip", 1.968894, "cut off"),
        ("FingerVision (2021), table", 0.049608, "cut off"),
        ("DelTact, the paper's", 0.037993, "cut off"),
    ],
)
def test_pixel_sizes_follow_from_area_and_pixels(name: str, pixel_mm: float, printed: str) -> None:
    (one,) = [s for s in comparison.IN_TABLE if s.name == name]
    assert one.true_pixel_mm == pytest.approx(pixel_mm, abs=1e-6)
    assert one.printed == printed


def test_a_printed_size_that_fits_nothing_is_told() -> None:
    odd = comparison.Sensor("x", "x", "x", (1, 1, 1), (100, 100), 100.0, "0.12")
    assert odd.true_pixel_mm == pytest.approx(0.1)
    assert odd.printed == "differs"


@pytest.mark.parametrize(
    ("theirs", "measure", "percent"),
    [
        ((51, 65, 52), "volume", 59.276),  # 70200 against 172380 mm3
        ((51, 65, 52), "footprint, first x second side", 29.412),
        ((51, 65, 52), "surface of the box", 43.190),
        ((51, 65, 52), "longest side", 7.692),
        ((51, 65, 52), "diagonal", 20.515),
        ((20, 20, 26), "volume", -575.0),  # 70200 against 10400 mm3
        ((52, 108, 69), "volume", 81.884),  # 70200 against 387504 mm3
    ],
)
def test_reductions(theirs: comparison.Size, measure: str, percent: float) -> None:
    of = comparison.MEASURES[measure]
    assert comparison.smaller(theirs, of) == pytest.approx(percent, abs=1e-3)


def test_bounds_are_those_of_the_worst_rounding(result: StudyResult) -> None:
    volume, area, pixel = result.headlines
    assert volume.low == pytest.approx(100 * (1 - 39.5 * 60.5 * 30.5 / (50.5 * 64.5 * 51.5)))
    assert volume.high == pytest.approx(100 * (1 - 38.5 * 59.5 * 29.5 / (51.5 * 65.5 * 52.5)))
    assert (volume.value, volume.paper) == (pytest.approx(59.276, abs=1e-3), 33.3)
    assert area.value == pytest.approx(10.714, abs=1e-3)
    assert "5 of 8 rows; 0.037 mm would be 640 mm²" in pixel.remark
    for one in result.headlines:
        assert one.low is not None
        assert one.high is not None
        assert one.low < one.value < one.high


def test_the_verdict_says_that_table_and_figure_contradict_each_other(result: StudyResult) -> None:
    said = " ".join(result.verdict)
    assert "520 mm², cannot hold the row's 756 mm²" in said  # the largest side of the table's
    assert "6.8 times as large" in said
    assert "59.3 % [56.5 to 61.8]; the paper 33.3" in said
    assert comparison.TACTIP.size_mm == comparison.PREDECESSOR.size_mm
    assert len(said.split()) <= 80


def test_places_in_the_papers_table() -> None:
    places = {"area": 4, "pixel size": 3, "number of pixels": 1, "volume": 6}
    assert comparison.places() == places  # GelSlim has as much area, and shares the place


def test_own_designs_are_rows_of_their_dimensions(result: StudyResult) -> None:
    table = result.tables[0].frame.set_index("sensor")
    own = table[table["from"] == "own design"]
    assert list(own.index) == [
        "deltact", "fingertip-24x24", "franka", "large-60x50", "screws-19mm", "skin-30x34",
        "skin-44x40", "mine",
    ]  # fmt: skip
    assert own.loc["deltact", "size_mm"] == "39 x 60 x 30"
    assert own.loc["deltact", "sensing_area_mm2"] == pytest.approx(798 * 586 * 0.0378**2)
    assert own.loc["deltact", "pixel_recomputed_mm"] == pytest.approx(0.0378)
    assert own.loc["skin-44x40", "volume_cm3"] == pytest.approx(47 * 66 * 30.6 / 1e3)
    assert own.loc["skin-30x34", "pixels"] == "660 x 586"
    assert own.loc["mine", "size_mm"] == "39 x 65 x 30"
    assert own.loc["mine", "sensing_area_mm2"] == pytest.approx(700 * 586 * 0.0378**2)
    data = json.loads(json.dumps(result.data, allow_nan=False))
    gecko = next(row for row in data["tables"]["sensors"] if row["sensor"].startswith("Gecko"))
    assert gecko["sensing_area_mm2"] is None
    assert gecko["volume_cm3"] == pytest.approx(387.504)
    assert table.loc["TacTip", "pixels"] == "162 pins"


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


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (None, "no such file"),
        ('base = "deltact"\n[skin]\nwidth_cm = 3\n', r"own\.toml: skin\.width_cm"),
        # 1000 px see 37.8 mm, and the face is 36 mm wide
        (
            'base = "deltact"\n[optics]\nimage_width_px = 1000\n',
            r"own\.toml: skin: view .* 37\.8 <= 36 fails",
        ),
    ],
)
def test_a_design_that_is_none_is_bad_input(tmp_path: Path, text: str | None, says: str) -> None:
    path = tmp_path / "own.toml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=says):
        comparison.run(StudyRequest(more={"design": (str(path),)}))


@pytest.mark.parametrize(
    "asked",
    [StudyRequest(scale=0.5), StudyRequest(rig="virtual"), StudyRequest(runs=(Path("run"),))],
)
def test_what_it_does_not_depend_on_is_refused(asked: StudyRequest) -> None:
    with pytest.raises(InputError, match="the study comparison has no use for it"):
        comparison.run(asked)


def test_the_figure_names_every_sensor_with_an_area_and_clips_nothing(result: StudyResult) -> None:
    (scatter,) = (figures.draw(one) for one in result.figures)
    labels = ", ".join(text.get_text() for text in scatter.axes[0].texts)
    table = result.tables[0].frame
    for name in table.loc[table["sensing_area_mm2"].notna(), "sensor"]:
        assert name in labels
    assert scatter.get_tightbbox().x1 <= scatter.get_size_inches()[0] + 0.02
