"""A study's page is offline and says the verdict first; its folder is whole or as it was."""

from __future__ import annotations

import html
import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import scipy.stats
from made_up_study import study
from seen_page import offline

from deltact_fab.common import templating
from deltact_fab.common.errors import InputError, RunFailed
from deltact_fab.present.report import study_page
from deltact_fab.present.report.result import Headline, ReportFigure, ReportTable, StudyResult
from deltact_fab.present.report.study_page import read_result


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("study") / "made-up"
    assert study_page.write_study_page(study(missing=25), out) == out / "report.html"
    return out


@pytest.fixture(scope="module")
def page(folder: Path) -> str:
    return (folder / "report.html").read_text()


def plain() -> StudyResult:
    """Without figures: they take the time."""
    return replace(study(), figures=())


def section(page: str, title: str) -> str:
    """One section of the page, by its heading."""
    return page.partition(f"<h2>{title}</h2>")[2].partition("</section>")[0]


def table_of(part: str) -> list[list[str]]:
    """The cells of the first table in a part of the page, the head first."""
    rows = re.findall(r"<tr.*?</tr>", part.partition("</table>")[0], re.DOTALL)
    cells = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row, re.DOTALL) for row in rows]
    return [[html.unescape(re.sub("<.*?>", "", cell)) for cell in row] for row in cells]


def test_verdict_is_first_settings_last(page: str) -> None:
    body = page.partition("<body>")[2]
    places = [body.index(words) for words in (
        "The better one is half as far off.", "It holds for &lt;all&gt; seeds.",
        "25 jobs missing", "Key figures", "Bars of three tools.", "Twelve columns",
        "Not built or used", "Settings", "opencv-contrib-python-headless",
    )]  # fmt: skip
    assert places == sorted(places)
    assert "simulated</span>" in body
    assert "seed 7" in body


def test_page_is_offline_and_links_files(page: str, folder: Path) -> None:
    seen, beside = offline(page)
    assert beside == {"headlines.csv", "wide.csv", "points.csv", "recipe.toml"}
    assert all((folder / link).is_file() for link in beside)
    assert len(seen.ids) > 20


def test_headlines_have_value_interval_paper_goal(page: str) -> None:
    head, *rows = table_of(section(page, "Key figures"))
    assert head == ["figure", "value", "95 % interval, over", "paper", "goal", "remark"]
    assert rows[0] == [
        "mean error of the default tracker", "0.01235\u00a0mm", "0.011 to 0.014\u00a0mm, 5 seeds",
        "0.08\u00a0mm", "at most 0.03\u00a0mm: met", "",
    ]  # fmt: skip
    price = "10 positions more, 1.1 CPU min, would decide"
    assert rows[1][4:] == [
        f"at most 0.2\u00a0N: undecided, {price}",
        "the edge of the gel is softer",
    ]
    price = "4 repeats more would give an interval"
    assert rows[2][1:] == ["0.991", "one fit", "0.99", f"at least 0.98: undecided, {price}", ""]


def test_undecided_goal_tells_its_price() -> None:
    """By simulation: so many positions put the goal outside of the interval in 4 of 5 studies."""
    head = study().headlines[1]
    extra = int(head.price.split()[0])
    rng, n, value = np.random.default_rng(1), 9 + extra, math.log(0.31)
    spread = (math.log(0.4) - math.log(0.15)) / 2 / scipy.stats.t.ppf(0.975, 8) * 3
    outside = 0
    for _ in range(1000):
        drawn = rng.normal(value, spread, n)
        reach = scipy.stats.t.ppf(0.975, n - 1) * drawn.std(ddof=1) / math.sqrt(n)
        outside += abs(drawn.mean() - math.log(0.2)) > reach
    assert 750 < outside < 900


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"value": 0.2, "low": 0.15, "high": 0.2667}, "1000 positions would not decide"),
        ({"value": -0.1, "low": -0.3, "high": 0.3}, "7 positions more"),
        ({"value": 0.19, "groups": 2, "low": None, "high": None},
         "2 positions more would give an interval"),
        ({"value": math.nan, "groups": 0, "low": None, "high": None},
         "4 positions more would give an interval"),
        ({"whole": False}, "run the same command"),
    ],
)  # fmt: skip
def test_no_goal_is_undecided_without_price(change: dict[str, Any], says: str) -> None:
    head = replace(study().headlines[1], unit_cpu_s=0.0, **change)
    assert head.state == "undecided"
    assert says in head.price
    assert says in head.sentence
    assert says in head.as_dict()["price"]


def test_only_goals_and_missing_jobs_warn(tmp_path: Path) -> None:
    good = replace(plain(), headlines=plain().headlines[:1])
    page = study_page.write_study_page(good, tmp_path / "good").read_text()
    assert 'class="verdict pass"' in page
    assert "missing</h2>" not in page
    bad = study_page.write_study_page(replace(good, missing=("one",)), tmp_path / "bad").read_text()
    assert 'class="verdict warn"' in bad
    assert "1 job is missing" in bad


def test_long_table_is_cut_and_noted(page: str, tmp_path: Path) -> None:
    head, *rows = table_of(section(page, "Every point"))
    assert head == ["point", "normal, N"]  # the empty column is left out
    assert len(rows) == study_page.FIRST_ROWS
    assert "first 20 of 2070 rows shown" in page
    missing = section(page, "25 jobs missing")
    assert missing.count("d0.1-r") == study_page.MAX_MISSING
    assert "and 5 more" in missing
    many = ReportTable("many", "Many", pd.DataFrame({f"c{i}_mm": [i + 0.5] for i in range(22)}))
    wide = study_page.write_study_page(replace(plain(), tables=(many,)), tmp_path / "s").read_text()
    (head, row), part = table_of(section(wide, "Many")), section(wide, "Many")
    assert (head[-1], row[-1]) == ("c13, mm", "13.5")
    assert "further columns: c14, mm; " in part
    assert pd.read_csv(tmp_path / "s" / "many.csv").shape == (1, 22)


def test_written_result_is_read_back(folder: Path) -> None:
    kept, made = read_result(folder), study(missing=25)
    assert (kept.study, kept.verdict, kept.simulated) == (made.study, made.verdict, True)
    assert kept.missing == made.missing
    held = json.loads((folder / "result.json").read_text())
    assert (held["seed"], held["scale"], held["settings"]) == (7, 0.1, made.settings)
    assert held["versions"]["numpy"] == np.__version__
    assert sorted(kept.files) == sorted(p.name for p in folder.iterdir() if p.name != "result.json")
    assert (folder / "recipe.toml").read_text() == "seed = 7\n"
    again = pd.read_csv(folder / "wide.csv")
    pd.testing.assert_frame_equal(again, made.tables[0].frame)


def test_nan_is_none_and_goal_undecided(tmp_path: Path) -> None:
    lost = Headline("error", float("nan"), "mm", None, None, "no frame was trusted", goal=1.0)
    study_page.write_study_page(replace(plain(), headlines=(lost,)), tmp_path)
    (kept,) = json.loads((tmp_path / "result.json").read_text())["headlines"]
    assert (kept["value"], kept["state"]) == (None, "undecided")
    assert read_result(tmp_path).study == plain().study


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": "deltact-fab study 0"}, "format: 'deltact-fab study 0'"),
        ({"verdict": "yes"}, "verdict: must be a list (got 'yes')"),
        ({"files": [1]}, "files.0"),
        ({"made": None}, "made: "),
    ],
)
def test_invalid_result_names_file_and_key(
    folder: Path, tmp_path: Path, change: dict[str, object], words: str
) -> None:
    found = json.loads((folder / "result.json").read_text())
    (tmp_path / "result.json").write_text(json.dumps({**found, **change}))
    with pytest.raises(InputError, match=re.escape(words)) as caught:
        read_result(tmp_path)
    assert str(tmp_path / "result.json") in str(caught.value)


def state(folder: Path) -> dict[str, bytes]:
    """All files of a folder."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def _fails() -> None:
    raise RunFailed("no such figure")


@pytest.mark.parametrize("what", ["figure", "number"])
def test_failure_keeps_the_earlier_study(tmp_path: Path, what: str) -> None:
    study_page.write_study_page(plain(), tmp_path)
    before = state(tmp_path)
    if what == "figure":
        bad = replace(plain(), figures=(ReportFigure("bad", "Bad.", _fails),))  # type: ignore[arg-type]
    else:
        bad = replace(plain(), extra={"error_mm": float("nan")})
    with pytest.raises(RunFailed):
        study_page.write_study_page(bad, tmp_path)
    assert state(tmp_path) == before


def test_earlier_files_go_user_files_stay(tmp_path: Path) -> None:
    study_page.write_study_page(plain(), tmp_path)
    (tmp_path / "my-notes.txt").write_text("mine")
    study_page.write_study_page(replace(plain(), tables=plain().tables[:1], files={}), tmp_path)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"report.html", "result.json", "headlines.csv", "wide.csv", "my-notes.txt"}


@pytest.mark.parametrize("held", ["another study", "a run"])
def test_no_other_folder_is_written_into(tmp_path: Path, held: str) -> None:
    if held == "a run":
        (tmp_path / "run.json").write_text("{}")
    else:
        study_page.write_study_page(replace(plain(), study="other"), tmp_path)
    before = state(tmp_path)
    with pytest.raises(InputError, match="give another folder"):
        study_page.require_ready_study("made-up", tmp_path)
    with pytest.raises(InputError, match="give another folder"):
        study_page.write_study_page(plain(), tmp_path)
    assert state(tmp_path) == before


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0.0123456, "0.01235"), (2070, "2\u202f070"), (-12.5, "−12.5"), (1.23e-7, "1.23e−07"),
        (123456.7, "123\u202f457"), (True, "yes"), (None, ""), (float("nan"), ""), (3.0, "3"),
        ("star", "star"), (np.int64(5), "5"), (np.float64(0.25), "0.25"),
    ],
)  # fmt: skip
def test_cells_are_formatted(value: object, shown: str) -> None:
    assert templating.format_cell(value) == shown
