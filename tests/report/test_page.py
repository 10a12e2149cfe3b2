"""The report is one file that needs nothing else, and says what it is."""

from __future__ import annotations

import html
import json
import re
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pandas as pd
import pytest

from deltact_fab import record
from deltact_fab.analysis.measured import measured
from deltact_fab.analysis.tracking_error import TrackingResult, analyse
from deltact_fab.report import figures, run_figures
from deltact_fab.report.page import write
from deltact_fab.report.templating import number


@pytest.fixture(scope="module")
def result(mini_run: Path) -> TrackingResult:
    with ThreadPoolExecutor(1) as executor:
        return analyse(mini_run, ["dis-fast", "dis-fast/static"], executor)


@pytest.fixture(scope="module")
def page(
    mini_run: Path,
    result: TrackingResult,
    calibrations: list[Path],
    tmp_path_factory: pytest.TempPathFactory,
) -> str:
    out = tmp_path_factory.mktemp("report") / "report.html"
    note = "The parts were left out: no libGL"
    found = measured(record.open(mini_run), calibrations)
    return write(mini_run, out, result, found, parts={"parts": [], "note": note}).read_text()


@pytest.mark.slow
def test_it_shows_shape_contacts_and_force_and_how_far_to_believe_them(page: str) -> None:
    _, _, rest = page.partition("Shape and contact at the deepest press")
    section, _, after = rest.partition("</section>")
    assert section.count("<image") == 2  # a map an indenter
    rows = re.findall(r'<tr class=""><td[^>]*>(sphere:10|4dots)</td>.*?</tr>', section)
    assert rows.count("sphere:10") == 1
    assert rows.count("4dots") >= 1
    assert "force sensor" in after.partition("</section>")[0]
    verdict = page.partition('<div class="verdict')[2].partition("</div>")[0]
    assert "this is no test of it" in verdict.partition('<p class="warning">')[2]


class Attributes(HTMLParser):
    """Collects ids and everything a browser would fetch."""

    def __init__(self) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.fetched: list[str] = []
        self.tags: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        for name, value in attrs:
            if name == "id" and value:
                self.ids.append(value)
            if name in ("src", "href", "xlink:href", "srcset") and value:
                self.fetched.append(value)


def test_it_fetches_nothing(page: str) -> None:
    seen = Attributes()
    seen.feed(page)
    assert all(link.startswith(("data:", "#")) for link in seen.fetched)
    assert "script" not in seen.tags
    assert "@import" not in page
    assert not re.search(r"url\((?!#)", page)


def test_the_figures_ids_do_not_meet(page: str) -> None:
    seen = Attributes()
    seen.feed(page)
    assert len(seen.ids) > 20
    assert len(seen.ids) == len(set(seen.ids))


def test_it_says_simulated_seed_versions_paper_and_what_was_left_out(page: str) -> None:
    for words in (
        "simulated", "seed 3", "0.08 mm", "left out: finite-strain gel", "Grbl 1.1h",
        "opencv-contrib-python-headless", "The parts were left out: no libGL",
        "Why ours differs",
    ):  # fmt: skip
        assert words in page, words


def test_its_first_line_says_which_method_to_take(page: str, result: TrackingResult) -> None:
    verdict = re.search(r'</h1>\s*<div class="verdict (\w+)">(.*?)</div>', page, re.DOTALL)
    assert verdict is not None
    assert result.verdict.line in html.unescape(verdict.group(2))
    assert (verdict.group(1) == "good") <= result.verdict.trusted
    for name, why in result.verdict.doubts.items():
        assert (f"<b>{name}</b> is not reliable here" in page) == bool(why)


def test_the_figure_crosses_out_what_cannot_be_believed(result: TrackingResult) -> None:
    good = {**result.methods[0], "confident_wrong_share": 0.0, "coverage": 1.0,
            "trusted_share": 1.0, "mean_off_dots_mm": 0.02, "ms_per_frame": 5.0}  # fmt: skip
    lying = {**good, "name": "lying", "confident_wrong_share": 0.2, "ms_per_frame": 2.0}
    figure = run_figures.error_by_time(replace(result, methods=[good, lying]))
    assert figure is not None
    marks = {line.get_marker(): line.get_xydata().tolist() for line in figure.axes[0].lines[::-1]}
    assert (marks["o"], marks["x"]) == ([[5.0, 0.02]], [[2.0, 0.02]])
    unknown = [{**good, "mean_off_dots_mm": None, "mean_at_dots_mm": None,
                "mean_confident_mm": None, "coverage": None}]  # fmt: skip
    assert run_figures.error_by_time(replace(result, methods=unknown)) is None


def test_charts_have_whole_frames_and_the_four_methods_that_matter(result: TrackingResult) -> None:
    one, paper_mm = result.methods[0], 0.08
    names = ("best", "b", "c", "d", "e", "paper", "fastest")
    many = [
        {**one, "name": name, "mean_off_dots_mm": 0.001 * (k + 1), "ms_per_frame": 9.0 - (k == 6)}
        for k, name in enumerate(names)
    ]
    frames = pd.concat(
        [result.frames[result.frames["method"] == one["name"]].assign(method=n) for n in names]
    )
    found = replace(result, methods=many, frames=frames)
    scatter, lines = run_figures.error_by_time(found), run_figures.error_by_step(found)
    assert scatter is not None
    assert lines is not None
    assert {text.get_text() for text in scatter.axes[0].texts} == {
        "best", "b", "paper", "fastest", "paper 0.08 ↑"
    }  # fmt: skip
    assert scatter.axes[0].get_ylim()[1] < paper_mm  # told in words, for it is far above
    lines.draw_without_rendering()
    for axis in lines.axes:
        assert {line.get_label() for line in axis.lines} >= {"best", "b", "paper", "fastest"}
        assert all(float(tick).is_integer() for tick in axis.get_xticks())
    assert [axis.texts[0].get_text() for axis in lines.axes] == ["(a)", "(b)"]


def test_the_table_holds_the_computed_figures(page: str, result: TrackingResult) -> None:
    for row in result.methods:
        assert f">{number(row['mean_off_dots_mm'])}</td>" in page


def test_figures_are_the_same_bytes_each_time(result: TrackingResult) -> None:
    drawn = []
    for _ in range(2):
        figure = run_figures.error_by_time(result)
        assert figure is not None
        drawn.append(figures.to_svg(figure))
    assert drawn[0] == drawn[1]
    assert "<dc:date>" not in drawn[0]


@pytest.mark.slow
def test_a_run_in_which_nothing_moved_enough_still_has_a_report(
    mini: tuple[Path, Path], tmp_path: Path
) -> None:
    """A touch of 0.3 mm moves no pixel by 0.1 mm: the errors off the dots are empty."""
    from deltact_fab import experiment

    text = mini[0].read_text().replace('"sphere:10", "4dots"', '"sphere:10"')
    text = text.replace('[shear]\namplitude_mm = 1.5\naxes = ["x"]\n', "").replace(', "shear"', "")
    (tmp_path / "touch.toml").write_text(text.replace("[1.0]", "[0.3]"))
    experiment.run(
        experiment.RunRequest(str(tmp_path / "touch.toml"), str(mini[1]), tmp_path / "r", seed=3)
    )
    touched = analyse(tmp_path / "r", ["dis-fast"])
    assert touched.methods[0]["mean_off_dots_mm"] is None
    page = write(tmp_path / "r", tmp_path / "r.html", touched).read_text()
    assert "(at the dots)" in page


@pytest.mark.slow
def test_it_names_the_sensor_that_was_pressed(
    mini_run: Path, result: TrackingResult, page: str, tmp_path: Path
) -> None:
    run = tmp_path / "run"
    shutil.copytree(mini_run, run)
    meta = json.loads((run / "run.json").read_text())
    assert meta["protocol"]["specimen"]["serial"] is None
    assert "sensor <b>" not in page
    meta["protocol"]["specimen"]["serial"] = "DT-007 <i>"
    (run / "run.json").write_text(json.dumps(meta))
    assert "sensor <b>DT-007 &lt;i&gt;</b>" in write(run, tmp_path / "r.html", result).read_text()


@pytest.mark.slow
def test_columns_that_nobody_measured_are_not_in_the_page(
    mini_run: Path, result: TrackingResult, page: str, tmp_path: Path
) -> None:
    unknown = dict.fromkeys(("mean_off_dots_mm", "p95_off_dots_mm", "mean_confident_mm"))
    blind = replace(result, methods=[{**row, **unknown} for row in result.methods])
    out = write(mini_run, tmp_path / "r.html", blind).read_text()
    for head in (
        "mean error over all moving pixels, mm",
        "95th percentile, mm",
        "confident pixels, mm",
    ):
        assert f">{head}</th>" in page
        assert f">{head}</th>" not in out
    assert ">frames trusted</th>" in out
