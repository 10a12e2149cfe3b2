"""The fabrication guide as a browser meets it: offline, everything drawn, the model turned."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from deltact_fab.fabricate import guide
from deltact_fab.fabricate.cad.registry import list_parts

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

LOADED = "window[0].scene?.children.length > 1"
GREY = 190  # darker than the white around the parts
IMAGES = "() => [...document.images].map(i => i.naturalWidth)"
WAIT_MS = 120_000
NO_WEBGL = """
  const get = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
    return kind.startsWith('webgl') ? null : get.call(this, kind, ...more);
  };"""

pytestmark = pytest.mark.slow


def view(tab: Page) -> NDArray[np.uint8]:
    """The 3D view as pixels, after two frames."""
    tab.evaluate("() => new Promise(r => requestAnimationFrame(() => setTimeout(r, 500)))")
    png = tab.locator("#view").screenshot()
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return np.asarray(image, np.uint8)


def test_pictures_render_and_model_rotates(
    opened: Callable[..., Page], pages: Callable[[str], Path]
) -> None:
    tab = opened(pages("guide").as_uri(), 1100)
    exploded, bench, wiring, casting = 1, 1, 1, 20
    pattern = 1 + 4  # and a good and a spoiled print and sensor
    steps = casting + len(guide.ASSEMBLY_STEPS)
    assert len(tab.evaluate(IMAGES)) == (
        exploded + len(list_parts()) + steps + bench + wiring + pattern
    )
    tab.locator("#view").scroll_into_view_if_needed()
    tab.wait_for_function(LOADED, timeout=WAIT_MS)
    seen = view(tab)
    # The camera's board is green, frame and shell are shown grey: both are in the picture.
    blue, green, red = seen.reshape(-1, 3).astype(int).T
    grey = (np.ptp(seen, axis=2) < 24) & (seen.max(axis=2) < GREY)
    assert np.mean((green > 1.3 * red) & (green > 1.3 * blue)) > 0.001
    assert np.mean(grey) > 0.02
    assert np.ptp(np.flatnonzero(grey.any(axis=1))) > 0.5 * seen.shape[0]  # a tall stack
    box = tab.locator("#view").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    tab.mouse.move(x, y)
    tab.mouse.down()
    tab.mouse.move(x + 150, y, steps=5)
    tab.mouse.up()
    assert np.mean(np.any(view(tab) != seen, axis=2)) > 0.01


def test_picture_replaces_model_without_webgl(
    browser: Browser, pages: Callable[[str], Path]
) -> None:
    tab = browser.new_page(viewport={"width": 390, "height": 900})
    wrong: list[str] = []
    tab.on("pageerror", lambda error: wrong.append(str(error)))
    tab.add_init_script(NO_WEBGL)
    tab.goto(pages("guide").as_uri())
    assert "no WebGL" in tab.inner_text("#turn")
    # The skin is a light blue that the empty box is not; black lines are drawn too.
    blue, _, red = view(tab).reshape(-1, 3).astype(int).T
    assert np.mean((blue > 246) & (red < 236) & (red > 215)) > 0.02
    assert np.mean(blue < 60) > 0.005
    tab.close()
    assert wrong == []
