"""The live page as browsers meet it: drawn, offline, its buttons, several at once."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = pytest.mark.slow

# Share of a canvas's pixels that differ from their neighbour on the left.
DRAWN = """id => {
  const c = document.getElementById(id), g = c.getContext('2d');
  const d = new Uint32Array(g.getImageData(0, 0, c.width, c.height).data.buffer);
  return d.filter((v, i) => i && v !== d[i - 1]).length / d.length;
}"""
SPEECH = "() => document.body.innerText"


def opened(browser: Browser, url: str) -> tuple[Page, list[str]]:
    """A tab on the page, and what it says and fetches that it should not."""
    tab, wrong = browser.new_page(viewport={"width": 1300, "height": 900}), list[str]()
    tab.on("console", lambda m: wrong.append(f"{m.type}: {m.text}"))
    tab.on("pageerror", lambda error: wrong.append(str(error)))
    tab.on("request", lambda r: None if r.url.startswith(url) else wrong.append(r.url))
    tab.goto(url)
    return tab, wrong


def image(tab: Any) -> int:
    """Number of the image that the page shows."""
    words = tab.evaluate(SPEECH).split()
    return int(words[words.index("image", words.index("age")) + 1])


def test_it_is_drawn_obeys_its_buttons_and_several_may_look(
    browser: Browser, live_url: str
) -> None:
    tab, wrong = opened(browser, live_url)
    tab.wait_for_function("() => /image [5-9]/.test(document.body.innerText)", timeout=60_000)
    words = tab.evaluate(SPEECH)
    for word in ("simulated, seed 3", "the flow is trusted", "no force calibration", "Hz"):
        assert word in words
    assert tab.evaluate(DRAWN, "face") > 0.5
    assert tab.evaluate(DRAWN, "plot") > 0.01

    tab.click("#pause")
    tab.wait_for_function("() => document.getElementById('state').innerText == 'paused'")
    tab.wait_for_timeout(1000)  # what was under way is shown
    held = image(tab)
    other, wrong_too = opened(browser, live_url)  # a browser that comes later sees what is there
    other.wait_for_function(f"() => /image {held}/.test(document.body.innerText)")
    assert image(tab) == held
    other.click("#reference")
    other.click("#pause")
    tab.wait_for_function("() => document.getElementById('state').innerText == ''")
    tab.wait_for_function("() => /ended/.test(document.getElementById('state').innerText)",
                          timeout=120_000)  # fmt: skip
    assert image(tab) == image(other) > held
    assert tab.evaluate("() => document.documentElement.scrollWidth <= innerWidth")
    assert wrong == wrong_too == []
