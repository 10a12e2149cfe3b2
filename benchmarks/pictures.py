"""The pictures of the README: the exploded sensor, and the top of a report.

    deltact-fab demo --out demo-out
    python -m benchmarks.pictures demo-out/report.html    # writes docs/images

Wants the test extra's Playwright and a Chromium.
"""

from __future__ import annotations

import base64
import shutil
import sys
from pathlib import Path

IMAGES = Path(__file__).parents[1] / "docs" / "images"


def main(words: list[str]) -> None:
    """Draw the sensor; with the path of a report, photograph its top as well."""
    from playwright.sync_api import sync_playwright

    from deltact_fab.fabricate import guide
    from deltact_fab.fabricate.cad.design import load_design
    from deltact_fab.fabricate.cad.registry import list_parts
    from deltact_fab.fabricate.pdf import FONT_PATH

    drawn = guide.draw(load_design(), list_parts(), lambda done, total, what: None)
    svg = base64.b64decode(drawn.exploded.partition(",")[2]).decode()
    IMAGES.mkdir(exist_ok=True)
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=shutil.which("chromium"))
        page = browser.new_page(viewport={"width": 720, "height": 590})
        # The embedded font, whatever fonts the machine has; the picture's whole height.
        font = base64.b64encode(FONT_PATH.read_bytes()).decode()
        face = f"@font-face {{font-family:Arial;src:url(data:font/ttf;base64,{font})}}"
        body = f'<body style="margin:0;background:#fff">{svg}</body>'
        page.set_content(f"<style>{face}</style>{body}")
        page.evaluate("document.fonts.ready")
        page.locator("svg").screenshot(path=IMAGES / "sensor.png")
        for report in words:
            page.set_viewport_size({"width": 1100, "height": 760})
            page.goto(Path(report).resolve().as_uri())
            page.screenshot(path=IMAGES / "report.png")
        browser.close()


if __name__ == "__main__":
    main(sys.argv[1:])
