"""A study's page as a browser meets it: wide and narrow, copied from, and printed."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pandas as pd
import pytest
from made_up_study import COLUMNS, study, wide

from deltact_fab.report import figures, study_page
from deltact_fab.report.result import ReportFigure, ReportTable
from deltact_fab.report.templating import MAX_COLUMNS, named

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from playwright.sync_api import Page

    Opened = Callable[..., Page]

FIGURES = 20

pytestmark = pytest.mark.slow


def test_headlines_are_read_at_390_px_without_scrolling(
    opened: Opened, pages: Callable[[str], Path]
) -> None:
    tab = opened(pages("study").as_uri(), 390)
    headlines = tab.locator("table").first
    box = headlines.bounding_box()
    assert box is not None
    assert box["x"] + box["width"] <= 390
    words = headlines.inner_text()
    assert "0.15 to 0.4" in words
    # What stands above a column at full width is written before each value.
    before = "getComputedStyle(document.querySelector('table td + td'), '::before').content"
    assert "value" in tab.evaluate(before)


def printed(tab: Page, out: Path) -> Path:
    """The page on paper."""
    tab.pdf(path=str(out), prefer_css_page_size=True)
    return out


def words_of(pdf: Path, sheet: int | None = None) -> str:
    """The words of a PDF or of one sheet, counted from 1, without blanks: lines break them."""
    if shutil.which("pdftotext") is None:
        pytest.skip("no pdftotext on this machine: apt-get install poppler-utils")
    only = [] if sheet is None else ["-f", str(sheet), "-l", str(sheet)]
    command = ["pdftotext", "-raw", *only, str(pdf), "-"]
    text = subprocess.run(command, capture_output=True, check=True).stdout
    return re.sub(r"\s", "", text.decode())


def test_the_print_has_every_column_of_a_wide_table(opened: Opened, tmp_path: Path) -> None:
    many = pd.DataFrame({f"column_{i}_of_many_mm": [i + 0.5, 700.25 + i] for i in range(22)})
    page = study_page.write(
        replace(
            study(), figures=(), tables=(*study().tables[:1], ReportTable("many", "Many", many))
        ),
        tmp_path / "s",
    )
    words = words_of(printed(opened(page.as_uri()), tmp_path / "p.pdf"))
    assert wide().shape[1] == COLUMNS
    for name in (*wide(), *many):
        assert re.sub(r"\s", "", named(name)) in words, name
    for i in range(MAX_COLUMNS):
        assert f"{700.25 + i:.4g}" in words
    for value in wide()["rmse_left_out_position_9_n"]:
        assert f"{value:.4g}".replace("-", "−") in words
    for head in ("95%interval,over", "goal", "remark"):
        assert head in words


def bar(colour: str, height_in: float) -> Callable[[], Figure]:
    """A figure that is one high bar of one colour."""

    def draw() -> Figure:
        figure, (axis,) = figures.blank(6, height_in)
        axis.axis("off")
        axis.barh([0], [1], 1, color=colour)
        axis.margins(0)
        return figure

    return draw


def test_no_figure_is_split_between_two_sheets_or_from_its_words(
    opened: Opened, tmp_path: Path
) -> None:
    if shutil.which("pdftoppm") is None:
        pytest.skip("no pdftoppm on this machine: apt-get install poppler-utils")
    # So many heights that a sheet's end meets every part of a figure and of its words.
    heights_in = [2.6 + 0.17 * (7 * i % FIGURES) for i in range(FIGURES)]
    greens = [10 * i for i in range(FIGURES)]
    drawn = tuple(
        ReportFigure(f"f{i}", f"Figure {i}: " + "words " * 80, bar(f"#c8{green:02x}c8", height_in))
        for i, (green, height_in) in enumerate(zip(greens, heights_in, strict=True))
    )
    page = study_page.write(replace(study(), figures=drawn, tables=()), tmp_path / "s")
    pdf = printed(opened(page.as_uri()), tmp_path / "p.pdf")
    subprocess.run(["pdftoppm", "-r", "50", "-png", pdf, tmp_path / "sheet"], check=True)
    sheets = [cv2.imread(str(path)) for path in sorted(tmp_path.glob("sheet*.png"))]
    assert len(sheets) >= 8
    for i, (green, height_in) in enumerate(zip(greens, heights_in, strict=True)):
        rows = [
            int(np.all(np.abs(sheet.astype(int) - (200, green, 200)) < 4, axis=2).any(axis=1).sum())
            for sheet in sheets
            if sheet is not None
        ]
        assert sum(count > 0 for count in rows) == 1, i
        assert max(rows) > 0.9 * 50 * height_in
        words = words_of(pdf, 1 + int(np.argmax(rows)))
        assert words.partition(f"Figure{i}:")[2].startswith("words" * 80), i
