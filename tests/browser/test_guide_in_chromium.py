"""The fabrication guide as a browser meets it: offline, everything drawn, the model turned."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from deltact_fab.cad.registry import listed
from deltact_fab.report import guide

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

CHROMIUM = shutil.which("chromium")
# WebGL without a graphics card: the model is drawn by the processor.
FLAGS = [
    "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--use-gl=angle", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]  # fmt: skip
LOADED = "window[0].scene?.children.length > 1"
GREY = 190  # darker than the white around the parts
IMAGES = "() => [...document.images].map(i => i.complete ? i.naturalWidth : 0)"
OVERFLOW = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
WAIT_MS = 120_000

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        CHROMIUM is None, reason="no chromium on this machine: apt-get install chromium"
    ),
]


@dataclass
class Visit:
    """An open page, what it said that is an error, and what it asked for."""

    tab: Page
    page: Path
    errors: list[str] = field(default_factory=list)
    fetched: list[str] = field(default_factory=list)

    def outside(self) -> list[str]:
        """Requests for anything but the page itself and what it carries."""
        own = self.page.as_uri()
        return [
            url for url in self.fetched if url != own and not url.startswith(("data:", "about:"))
        ]

    def view(self) -> NDArray[np.uint8]:
        """The 3D view as pixels, after two frames."""
        self.tab.evaluate("() => new Promise(r => requestAnimationFrame(() => setTimeout(r, 500)))")
        png = self.tab.locator("#view").screenshot()
        image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
        assert image is not None
        return np.asarray(image, np.uint8)


@pytest.fixture(scope="module")
def page(pages: Callable[[str], Path]) -> Path:
    """The real guide, every part built and drawn."""
    return pages("guide")


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield started
        started.close()


@pytest.fixture(scope="module")
def visit(browser: Browser, page: Path) -> Iterator[Visit]:
    tab = browser.new_page(viewport={"width": 1100, "height": 900})
    seen = Visit(tab, page)
    tab.on("console", lambda m: seen.errors.append(m.text) if m.type == "error" else None)
    tab.on("pageerror", lambda error: seen.errors.append(str(error)))
    tab.on("request", lambda request: seen.fetched.append(request.url))
    tab.goto(page.as_uri())
    tab.locator("#view").scroll_into_view_if_needed()
    tab.wait_for_function(LOADED, timeout=WAIT_MS)
    yield seen
    tab.close()


def test_it_loads_without_error_and_fetches_nothing(visit: Visit) -> None:
    assert visit.errors == []
    assert visit.outside() == []
    assert visit.fetched[0] == visit.page.as_uri()


def test_every_picture_is_drawn_and_nothing_runs_over(visit: Visit) -> None:
    widths = visit.tab.evaluate(IMAGES)
    exploded, bench, wiring, casting = 1, 1, 1, 32
    pattern = 1 + 4  # and a good and a spoiled print and sensor
    steps = casting + len(guide.STEPS)
    assert len(widths) == exploded + len(listed()) + steps + bench + wiring + pattern
    assert min(widths) > 0
    assert visit.tab.evaluate(OVERFLOW) == 0
    visit.tab.set_viewport_size({"width": 480, "height": 900})
    narrow = visit.tab.evaluate(OVERFLOW)
    visit.tab.set_viewport_size({"width": 1100, "height": 900})
    assert narrow == 0


def test_the_model_is_seen_and_turns(visit: Visit) -> None:
    visit.tab.locator("#view").scroll_into_view_if_needed()
    exploded = visit.view()
    colours = exploded.reshape(-1, 3).astype(int)
    # The camera's board is green, frame and shell are shown grey: both are in the picture.
    blue, green, red = colours.T
    grey = (np.ptp(exploded, axis=2) < 24) & (exploded.max(axis=2) < GREY)
    assert np.mean((green > 1.3 * red) & (green > 1.3 * blue)) > 0.001
    assert np.mean(grey) > 0.02
    high = np.ptp(np.flatnonzero(grey.any(axis=1)))
    box = visit.tab.locator("#view").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    visit.tab.mouse.move(x, y)
    visit.tab.mouse.down()
    visit.tab.mouse.move(x + 150, y, steps=5)
    visit.tab.mouse.up()
    turned = visit.view()
    assert np.mean(np.any(turned != exploded, axis=2)) > 0.01
    # Exploded it is a tall stack.
    assert high > 0.5 * exploded.shape[0]
    assert visit.errors == []
    assert visit.outside() == []


def test_without_webgl_a_picture_stands_where_the_model_would(browser: Browser, page: Path) -> None:
    flags = [FLAGS[0], "--disable-gpu", "--disable-3d-apis"]
    poor = browser.browser_type.launch(executable_path=CHROMIUM, args=flags)
    tab = poor.new_page(viewport={"width": 390, "height": 900})
    seen = Visit(tab, page)
    tab.on("console", lambda m: seen.errors.append(m.text) if m.type == "error" else None)
    tab.on("pageerror", lambda error: seen.errors.append(str(error)))
    tab.goto(page.as_uri())
    assert tab.evaluate("document.createElement('canvas').getContext('webgl2')") is None
    assert tab.evaluate(OVERFLOW) == 0
    assert "no WebGL" in tab.inner_text("#turn")
    assert seen.errors == []
    # The skin is a light blue that the empty box is not; black lines are drawn too.
    blue, _, red = seen.view().reshape(-1, 3).astype(int).T
    assert np.mean((blue > 246) & (red < 236) & (red > 215)) > 0.02
    assert np.mean(blue < 60) > 0.005
    poor.close()
