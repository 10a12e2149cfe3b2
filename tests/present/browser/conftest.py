"""Debian's own Chromium, driven through Playwright; nothing is downloaded."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

CHROMIUM = shutil.which("chromium")
# WebGL without a graphics card: a model is drawn by the processor.
FLAGS = [
    "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--use-gl=angle", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    # A name for pages of a stranger, whose requests go to this computer.
    "--host-resolver-rules=MAP stranger.test 127.0.0.1",
]  # fmt: skip


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """One browser for all tests."""
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


@pytest.fixture(scope="session")
def out_of_sight() -> Callable[[Page], list[str]]:
    """What of an open page can be seen by no scrolling of a box."""

    def found(tab: Page) -> list[str]:
        bad = list(tab.evaluate(_STICKS_OUT))
        if (over_px := tab.evaluate(_OVERFLOW)) != 0:
            bad.append(f"the page runs over by {over_px} px")
        return bad + [f"a box hides {px} px" for px in tab.evaluate(_OUT_OF_REACH) if px > 1]

    return found


@pytest.fixture
def opened(browser: Browser) -> Iterator[Callable[..., Page]]:
    """Opens a page, by its address, in a window so wide; none may complain or fetch anything."""
    wrong: list[str] = []
    tabs: list[Page] = []

    def visit(url: str, width_px: int = 1280) -> Page:
        tab = browser.new_page(viewport={"width": width_px, "height": 900}, color_scheme="light")
        tabs.append(tab)
        tab.on("console", lambda m: wrong.append(m.text) if m.type == "error" else None)
        tab.on("pageerror", lambda error: wrong.append(str(error)))
        own = (url, "data:", "about:")
        tab.on("request", lambda r: None if r.url.startswith(own) else wrong.append(r.url))
        tab.goto(url)
        return tab

    visit.wrong = wrong  # type: ignore[attr-defined]
    yield visit
    for tab in tabs:
        tab.close()
    assert wrong == []


@pytest.fixture(scope="session")
def pages(
    made_once: Callable[[str, Callable[[Path], object]], Path], request: pytest.FixtureRequest
) -> Callable[[str], Path]:
    """A page of each kind that is written, made once for all workers, when it is asked for."""
    from made_up_study import study

    from deltact_fab.fabricate import guide
    from deltact_fab.fabricate.cad.design import load_design
    from deltact_fab.fabricate.patterns import series as job
    from deltact_fab.present.report import index_page, patterns_page, study_page
    from deltact_fab.present.report.first_light import render_examples as pairs
    from deltact_fab.studies.numerics import harness

    def series(out: Path) -> None:
        entries = [
            replace(entry, recipe=entry.recipe.model_copy(update={"size_mm": 7.0}))
            for entry in job.list_series(seed=3, with_dots=False)
            if entry.name in ("d0p075-r0p6", "d0p2-r0p1")
        ]
        job.write_series(out, seed=3, entries=entries, page=patterns_page.write_patterns_page)

    def index(out: Path) -> None:
        study_page.write_study_page(study(missing=3), out / "made-up")
        (out / "damaged").mkdir()
        (out / "damaged" / "run.json").write_text("{")
        index_page.write_index(out, out / "report.html")

    made: dict[str, tuple[Callable[[Path], object], str]] = {
        "study": (lambda out: study_page.write_study_page(study(missing=3), out), "report.html"),
        "index": (index, "report.html"),
        "numerics": (
            lambda out: harness.run_engines(["pattern"], quick=True).save(out),
            "numerics.html",
        ),
        "patterns": (series, job.SERIES_PAGE),
        "guide": (
            lambda out: guide.write_guide(load_design(), out / "guide.html", examples=pairs),
            "guide.html",
        ),
    }

    def page(kind: str) -> Path:
        if kind == "run":
            return Path(request.getfixturevalue("demo")) / "report.html"
        make, name = made[kind]
        return made_once(f"page-{kind}", make) / name

    return page


@pytest.fixture
def live_url(mini_run: Path) -> Iterator[str]:
    """The live page on a run that is measured at two images a second."""
    with subprocess.Popen(
        [sys.executable, "-m", "deltact_fab.app.cli.main", "measure", str(mini_run), "--view",
         "--hz", "2"],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    ) as going:  # fmt: skip
        assert going.stderr is not None
        said = going.stderr.readline()
        assert said.startswith("view: http://127.0.0.1:"), said
        yield said.split()[1]
        going.terminate()
