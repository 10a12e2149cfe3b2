"""Debian's own Chromium, driven through Playwright; nothing is downloaded."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser

CHROMIUM = shutil.which("chromium")
FLAGS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
]  # fmt: skip


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """A browser for the tests of one file."""
    if CHROMIUM is None:
        pytest.skip("no chromium on this machine: apt-get install chromium")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield started
        started.close()


# What sticks out of the window and lies in no box of its own that scrolls: a section cuts it off.
_STICKS_OUT = """() => [...document.querySelectorAll('main *')].filter(e => {
  const box = e.getBoundingClientRect();
  return box.width && box.right > innerWidth + 1 && !e.closest('.scroll');
}).map(e => e.outerHTML.slice(0, 80))"""
_OVERFLOW = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
# Of every box that scrolls: how far its end stays out of reach.
_OUT_OF_REACH = """() => [...document.querySelectorAll('.scroll')].map(e => {
  e.scrollLeft = 1e6; return e.scrollWidth - e.clientWidth - e.scrollLeft; })"""


@pytest.fixture(scope="module")
def cut_off(browser: Browser) -> Callable[[Path, int], list[str]]:
    """What of a page in a window of so many pixels can be seen by no scrolling of a box."""

    def found(page: Path, width_px: int) -> list[str]:
        tab = browser.new_page(viewport={"width": width_px, "height": 900})
        tab.goto(page.as_uri())
        bad = list(tab.evaluate(_STICKS_OUT))
        if (over_px := tab.evaluate(_OVERFLOW)) != 0:
            bad.append(f"the page runs over by {over_px} px")
        bad += [f"a box hides {px} px" for px in tab.evaluate(_OUT_OF_REACH) if px > 1]
        tab.close()
        return bad

    return found
