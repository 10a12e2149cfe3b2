"""The report is one file that needs nothing else, and says what it is."""

from __future__ import annotations

import html
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from seen_page import offline

from deltact_fab.bench.record.run import open_run
from deltact_fab.common.templating import format_number
from deltact_fab.estimate.analysis.measured import measure_run
from deltact_fab.estimate.analysis.tracking_error.follow import analyse_tracking
from deltact_fab.estimate.analysis.tracking_error.result import TrackingResult
from deltact_fab.present.report import run_figures
from deltact_fab.present.report.page import write_run_page


@pytest.fixture(scope="module")
def result(tracked: TrackingResult) -> TrackingResult:
    return tracked


@pytest.fixture(scope="module")
def page(mini_run: Path, result: TrackingResult, tmp_path_factory: pytest.TempPathFactory) -> str:
    out = tmp_path_factory.mktemp("report") / "report.html"
    parts = {"parts": [], "note": "The parts were left out: no libGL"}
    return write_run_page(mini_run, out, result, parts=parts).read_text()


@pytest.mark.slow
def test_page_shows_shape_force_and_trust(
    mini_run: Path, result: TrackingResult, calibrations: list[Path], tmp_path: Path
) -> None:
    found = measure_run(open_run(mini_run), calibrations)
    page = write_run_page(mini_run, tmp_path / "report.html", result, found).read_text()
    _, _, rest = page.partition("Shape and contact at the deepest press")
    section, _, after = rest.partition("</section>")
    assert section.count("<image") == 2  # a map an indenter
    rows = re.findall(r'<tr class=""><td[^>]*>(sphere:10|4dots)</td>.*?</tr>', section)
    assert rows.count("sphere:10") == 1
    assert rows.count("4dots") >= 1
    assert "force sensor" in after.partition("</section>")[0]
    verdict = page.partition('<div class="verdict')[2].partition("</div>")[0]
    assert "not a test" in verdict.partition('<p class="warn">')[2]


def test_page_is_offline_and_labelled(page: str, result: TrackingResult) -> None:
    seen, beside = offline(page)
    assert beside == set()
    assert "script" not in seen.tags
    assert len(seen.ids) > 20
    for words in (
        "simulated", "seed 3", "0.08 mm", "not built: finite-strain gel", "Grbl 1.1h",
        "opencv-contrib-python-headless", "The parts were left out: no libGL",
        *(f">{format_number(row['mean_off_dots_mm'])}</td>" for row in result.methods),
    ):  # fmt: skip
        assert words in page, words


def test_first_line_recommends_a_method(page: str, result: TrackingResult) -> None:
    verdict = re.search(r'</h1>\s*<div class="verdict (\w+)">(.*?)</div>', page, re.DOTALL)
    assert verdict is not None
    assert result.verdict.line in html.unescape(verdict.group(2))
    assert (verdict.group(1) == "pass") <= result.verdict.trusted
    for name, why in result.verdict.doubts.items():
        assert (f"<b>{name}</b> is unreliable here" in page) == bool(why)


def test_figure_marks_unreliable_methods(result: TrackingResult) -> None:
    good = {**result.methods[0], "confident_wrong_share": 0.0, "coverage": 1.0,
            "trusted_share": 1.0, "mean_off_dots_mm": 0.02, "ms_per_frame": 5.0}  # fmt: skip
    lying = {**good, "name": "lying", "confident_wrong_share": 0.2, "ms_per_frame": 2.0}
    figure = run_figures.plot_error_by_time(replace(result, methods=[good, lying]))
    assert figure is not None
    marks = {line.get_marker(): line.get_xydata().tolist() for line in figure.axes[0].lines[::-1]}
    assert (marks["o"], marks["x"]) == ([[5.0, 0.02]], [[2.0, 0.02]])
    unknown = [{**good, "mean_off_dots_mm": None, "mean_at_dots_mm": None,
                "mean_confident_mm": None, "coverage": None}]  # fmt: skip
    assert run_figures.plot_error_by_time(replace(result, methods=unknown)) is None


@pytest.mark.slow
def test_run_without_motion_has_a_report(mini: tuple[Path, Path], tmp_path: Path) -> None:
    """A touch of 0.3 mm moves no pixel by 0.1 mm: the errors off the dots are empty."""
    from deltact_fab.simulate.experiment.request import RunRequest
    from deltact_fab.simulate.experiment.session import run_experiment

    text = mini[0].read_text().replace('"sphere:10", "4dots"', '"sphere:10"')
    text = text.replace('[shear]\namplitude_mm = 1.5\naxes = ["x"]\n', "").replace(', "shear"', "")
    (tmp_path / "touch.toml").write_text(text.replace("[1.0]", "[0.3]"))
    run_experiment(RunRequest(str(tmp_path / "touch.toml"), str(mini[1]), tmp_path / "r", seed=3))
    touched = analyse_tracking(tmp_path / "r", ["dis-fast"])
    assert touched.methods[0]["mean_off_dots_mm"] is None
    page = write_run_page(tmp_path / "r", tmp_path / "r.html", touched).read_text()
    assert "(at the dots)" in page


@pytest.mark.slow
def test_page_names_sensor_omits_unmeasured(
    mini_run: Path, result: TrackingResult, page: str, tmp_path: Path
) -> None:
    run = tmp_path / "run"
    shutil.copytree(mini_run, run)
    meta = json.loads((run / "run.json").read_text())
    meta["protocol"]["specimen"]["serial"] = "DT-007 <i>"
    (run / "run.json").write_text(json.dumps(meta))
    blind = replace(result, methods=[{**row, "p95_off_dots_mm": None} for row in result.methods])
    other = write_run_page(run, tmp_path / "r.html", blind).read_text()
    assert "sensor <b>" not in page
    assert "sensor <b>DT-007 &lt;i&gt;</b>" in other
    assert ">95th percentile, mm</th>" in page
    assert ">95th percentile, mm</th>" not in other
