"""A study's page as a browser meets it: wide and narrow, copied from, and printed."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd
import pytest
from made_up_study import COLUMNS, study, wide

from deltact_fab.common.templating import MAX_COLUMNS, format_label
from deltact_fab.present.report import study_page
from deltact_fab.present.report.result import ReportTable

if TYPE_CHECKING:
    from playwright.sync_api import Page

    Opened = Callable[..., Page]

pytestmark = pytest.mark.slow


def test_headlines_fit_390_px(opened: Opened, pages: Callable[[str], Path]) -> None:
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


def words_of(pdf: Path) -> str:
    """The words of a PDF without blanks: lines break them."""
    if shutil.which("pdftotext") is None:
        pytest.skip("no pdftotext on this machine: apt-get install poppler-utils")
    command = ["pdftotext", "-raw", str(pdf), "-"]
    text = subprocess.run(command, capture_output=True, check=True).stdout
    return re.sub(r"\s", "", text.decode())


def test_print_has_all_wide_table_columns(opened: Opened, tmp_path: Path) -> None:
    many = pd.DataFrame({f"column_{i}_of_many_mm": [i + 0.5, 700.25 + i] for i in range(22)})
    page = study_page.write_study_page(
        replace(
            study(), figures=(), tables=(*study().tables[:1], ReportTable("many", "Many", many))
        ),
        tmp_path / "s",
    )
    words = words_of(printed(opened(page.as_uri()), tmp_path / "p.pdf"))
    assert wide().shape[1] == COLUMNS
    for name in (*wide(), *many):
        assert re.sub(r"\s", "", format_label(name)) in words, name
    for i in range(MAX_COLUMNS):
        assert f"{700.25 + i:.4g}" in words
    for value in wide()["rmse_left_out_position_9_n"]:
        assert f"{value:.4g}".replace("-", "−") in words
    for head in ("95%interval,over", "goal", "remark"):
        assert head in words
