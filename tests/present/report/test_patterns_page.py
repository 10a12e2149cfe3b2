"""The series' page: one file that needs nothing else, holds every figure and says what it is."""

from __future__ import annotations

import base64
import json
from pathlib import Path

import pytest
from seen_page import SeenPage, offline

from deltact_fab.common.errors import InputError
from deltact_fab.fabricate.patterns import series
from deltact_fab.present.report import patterns_page


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> series.SeriesReport:
    """Three of the paper's patterns on small stickers, with their page."""
    entries = []
    for entry in series.list_series(seed=3, with_dots=False):
        if entry.name in ("d0p05-r0p6", "d0p075-r0p6", "d0p2-r0p1"):
            small = entry.recipe.model_copy(update={"size_mm": 7.0})
            entries.append(series.SeriesEntry(entry.name, small, entry.rounds,
                                              entry.paper_error_mm, entry.paper_about))  # fmt: skip
    out = tmp_path_factory.mktemp("page") / "s"
    return series.write_series(out, seed=3, entries=entries, page=patterns_page.write_patterns_page)


@pytest.fixture(scope="module")
def page(report: series.SeriesReport) -> str:
    return (report.out / "patterns.html").read_text()


@pytest.fixture(scope="module")
def seen(page: str) -> SeenPage:
    return SeenPage(page)


def test_page_is_offline_and_labelled(report: series.SeriesReport, page: str) -> None:
    seen, beside = offline(page)
    assert beside == {"quality.csv", "quality.json"}
    assert "script" not in seen.tags
    assert len(seen.ids) > 20
    for words in (
        "simulated", "seed 3", "1200 dpi", "assumed, not measured", "0.11 mm", "around 0.5 mm",
        "the paper prints d as 0.5, 0.75 and 0.1",
    ):  # fmt: skip
        assert words in seen.text, words
    assert report.out / "patterns.html" in report.files
    assert patterns_page.write_patterns_page(report.out).read_text() == page


def test_table_has_every_photographed_pattern(report: series.SeriesReport, seen: SeenPage) -> None:
    table = [row for row in seen.rows if len(row) > 8 and row[0][:1].isdigit()]
    assert [row[2] for row in table] == ["≈ 0.5", "0.08", ""]
    for fields, row in zip(table, report.figures["patterns"], strict=True):
        q = row["quality"]
        b = q["photographed"]
        assert fields[:2] == [str(row["d_mm"]), str(row["r"])]
        found = [float(field.replace("\u202f", "")) for field in fields[3:11]]
        assert found == pytest.approx([
            round(b["mean_gradient"], 1), round(b["contrast"][3], 1), round(b["contrast"][4], 1),
            round(b["peak"], 2), round(b["peak_mm"], 2), round(q["px_a_patch"], 2),
            *(round(100 * q[f"{k}_contrast"]) for k in ("print", "camera")),
        ], rel=1e-3)  # fmt: skip


def test_the_views_are_in_it_unchanged(report: series.SeriesReport, seen: SeenPage) -> None:
    shown = [link for link in seen.links if link.startswith("data:image/png")]
    held = {base64.b64decode(picture.partition(",")[2]) for picture in shown}
    assert held == {file.read_bytes() for file in (report.out / "views").iterdir()}
    assert len(shown) == len(report.figures["patterns"])


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "no series: quality.json is missing"),
        ("{", "not valid JSON"),
        ("[]", "an object is needed"),
        (json.dumps({"format": "deltact-fab pattern series 0"}), "series 0"),
    ],
)
def test_folder_without_series_is_refused(tmp_path: Path, content: str | None, said: str) -> None:
    if content is not None:
        (tmp_path / "quality.json").write_text(content)
    with pytest.raises(InputError) as caught:
        patterns_page.write_patterns_page(tmp_path)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "patterns.html").exists()
