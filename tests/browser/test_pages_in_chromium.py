"""Report pages as a browser meets them: no error, nothing fetched, everything drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

if TYPE_CHECKING:
    from playwright.sync_api import Browser

WIDTH_PX, HEIGHT_PX = 1100, 900
BANDS = 8
# Left-over size of what a page shows: an image that did not decode has no natural width.
SHOWN = """() => ({
  images: [...document.images].map(i => i.complete ? i.naturalWidth : 0),
  figures: [...document.querySelectorAll('svg')].map(s => s.getBoundingClientRect().width),
  overflow_px: document.documentElement.scrollWidth - document.documentElement.clientWidth,
})"""

pytestmark = pytest.mark.slow


@dataclass
class Visit:
    """What a page said, fetched and showed."""

    said: list[str] = field(default_factory=list)
    fetched: list[str] = field(default_factory=list)
    shown: dict[str, Any] = field(default_factory=dict)
    picture: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((0, 0, 3), np.uint8))

    def ink(self) -> list[float]:
        """Share of pixels off the background's colour, in bands from the top to the bottom."""
        colours, counts = np.unique(self.picture.reshape(-1, 3), axis=0, return_counts=True)
        background = colours[np.argmax(counts)]
        off = np.any(self.picture != background, axis=-1)
        return [float(band.mean()) for band in np.array_split(off, BANDS)]


def visit(browser: Browser, page: Path) -> Visit:
    """Open a page and look at all of it."""
    seen = Visit()
    tab = browser.new_page(viewport={"width": WIDTH_PX, "height": HEIGHT_PX})
    tab.on("console", lambda message: seen.said.append(f"{message.type}: {message.text}"))
    tab.on("pageerror", lambda error: seen.said.append(str(error)))
    tab.on("request", lambda request: seen.fetched.append(request.url))
    tab.goto(page.as_uri())
    seen.shown = tab.evaluate(SHOWN)
    png = np.frombuffer(tab.screenshot(full_page=True), np.uint8)
    tab.close()
    image = cv2.imdecode(png, cv2.IMREAD_COLOR)
    assert image is not None
    seen.picture = np.asarray(image, np.uint8)
    return seen


def outside(seen: Visit, page: Path) -> list[str]:
    """Requests for anything but the page itself and what it carries."""
    return [url for url in seen.fetched if url != page.as_uri() and not url.startswith("data:")]


def test_the_report_opens_without_error_fetches_nothing_and_is_drawn(
    browser: Browser, demo: Path
) -> None:
    report = demo / "report.html"
    seen = visit(browser, report)
    assert seen.said == []
    assert outside(seen, report) == []
    assert seen.fetched[0] == report.as_uri()
    assert len(seen.shown["images"]) >= 3  # the pattern and a strip an indenter
    assert min(seen.shown["images"]) > 0
    assert len(seen.shown["figures"]) >= 4
    assert min(seen.shown["figures"]) > 100
    assert seen.shown["overflow_px"] == 0
    assert seen.picture.shape[0] > 2 * HEIGHT_PX
    assert min(seen.ink()) > 0.01


def test_a_bad_page_is_caught(browser: Browser, tmp_path: Path) -> None:
    page = tmp_path / "bad.html"
    page.write_text(
        "<title>bad</title><script>console.error('broken'); missing()</script>"
        "<img src='http://127.0.0.1:9/x.png'>"
    )
    seen = visit(browser, page)
    assert "error: broken" in seen.said
    assert any("missing is not defined" in line for line in seen.said)
    assert outside(seen, page) == ["http://127.0.0.1:9/x.png"]
    assert seen.shown["images"] == [0]
    assert min(seen.ink()) == 0


def test_the_numerics_page_opens_the_same_way(
    browser: Browser, pages: Callable[[str], Path]
) -> None:
    page = pages("numerics")
    seen = visit(browser, page)
    assert seen.said == []
    assert outside(seen, page) == []
    assert len(seen.shown["figures"]) >= 1
    assert min(seen.shown["figures"]) > 100
