"""The series' page: one file that needs nothing else, holds every figure and says what it is."""

from __future__ import annotations

import base64
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from deltact_fab.errors import InputError
from deltact_fab.patterns.series import job as series
from deltact_fab.report import figures, patterns_page


class Seen(HTMLParser):
    """Collects ids, everything a browser would fetch, and the text of table fields."""

    def __init__(self) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.fetched: list[str] = []
        self.tags: set[str] = set()
        self.rows: list[list[str]] = []
        self._in_field = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        if tag == "tr":
            self.rows.append([])
        if tag == "td":
            self.rows[-1].append("")
            self._in_field = True
        for name, value in attrs:
            if name == "id" and value:
                self.ids.append(value)
            if name in ("src", "href", "xlink:href", "srcset") and value:
                self.fetched.append(value)

    def handle_endtag(self, tag: str) -> None:
        if tag == "td":
            self._in_field = False

    def handle_data(self, data: str) -> None:
        if self._in_field:
            self.rows[-1][-1] += data


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> series.SeriesReport:
    """Three of the paper's patterns on small stickers, with their page."""
    entries = []
    for entry in series.recipes(seed=3, with_dots=False):
        if entry.name in ("d0p05-r0p6", "d0p075-r0p6", "d0p2-r0p1"):
            small = entry.recipe.model_copy(update={"size_mm": 7.0})
            entries.append(series.SeriesEntry(entry.name, entry.rounds, small,
                                              entry.paper_error_mm, entry.paper_about))  # fmt: skip
    out = tmp_path_factory.mktemp("page") / "s"
    return series.write(out, seed=3, entries=entries, page=patterns_page.ready())


@pytest.fixture(scope="module")
def page(report: series.SeriesReport) -> str:
    return (report.out / "patterns.html").read_text()


@pytest.fixture(scope="module")
def seen(page: str) -> Seen:
    parsed = Seen()
    parsed.feed(page)
    return parsed


@pytest.mark.slow
def test_the_page_is_part_of_the_folder(report: series.SeriesReport) -> None:
    assert report.out / "patterns.html" in report.files
    assert not list(report.out.glob(".*"))


def test_it_fetches_nothing(page: str, seen: Seen) -> None:
    beside = ("quality.csv", "quality.json")
    assert all(link.startswith(("data:", "#")) or link in beside for link in seen.fetched)
    assert "script" not in seen.tags
    assert "@import" not in page
    assert not re.search(r"url\((?!#)", page)


def test_the_charts_ids_do_not_meet(seen: Seen) -> None:
    assert len(seen.ids) > 20
    assert len(seen.ids) == len(set(seen.ids))


def test_it_says_what_it_is(page: str) -> None:
    text = " ".join(page.split())
    for words in (
        "simulated", "seed 3", "1200 dpi", "<b>assumed</b>, not measured",
        "printer misregistration, µm",
        "without the marker dots", "0.11 mm", "0.08 mm", "around 0.5 mm",
        "the paper prints d as 0.5, 0.75 and 0.1", "levels 3 and 4",
    ):  # fmt: skip
        assert words in text, words


def test_the_table_holds_every_pattern_as_the_camera_sees_it(
    report: series.SeriesReport, seen: Seen
) -> None:
    table = [row for row in seen.rows if len(row) > 8]
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


def test_the_views_are_in_it_unchanged(report: series.SeriesReport, seen: Seen) -> None:
    shown = [link for link in seen.fetched if link.startswith("data:image/png")]
    held = {base64.b64decode(picture.partition(",")[2]) for picture in shown}
    assert held == {file.read_bytes() for file in (report.out / "views").iterdir()}
    assert len(shown) == len(report.figures["patterns"])


def test_the_same_folder_gives_the_same_page(report: series.SeriesReport, page: str) -> None:
    assert patterns_page.write(report.out).read_text() == page


def test_the_charts_draw_the_figures(report: series.SeriesReport) -> None:
    rows = report.figures["patterns"]
    chart = patterns_page.draw(rows)
    for axis, level in zip(chart.axes[1:], (3, 4), strict=True):
        drawn = {line.get_label(): line.get_xydata().tolist() for line in axis.get_lines()}
        expected: dict[str, list[list[float]]] = {}
        for row in rows:
            point = [row["d_mm"], row["quality"]["photographed"]["contrast"][level]]
            expected.setdefault(f"r = {row['r']:g}", []).append(point)
        assert drawn == expected
    assert "<dc:date>" not in figures.to_svg(chart)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "no series: quality.json is missing"),
        ("{", "not valid JSON"),
        ("[]", "an object is needed"),
        (json.dumps({"format": "deltact-fab pattern series 0"}), "series 0"),
    ],
)
def test_a_folder_without_a_series_is_one_line(
    tmp_path: Path, content: str | None, said: str
) -> None:
    if content is not None:
        (tmp_path / "quality.json").write_text(content)
    with pytest.raises(InputError) as caught:
        patterns_page.write(tmp_path)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "patterns.html").exists()
