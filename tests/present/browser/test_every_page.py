"""What every page keeps to: dark and light, a telephone, paper, a verdict first, no empty table."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Page

KINDS = ("run", "study", "index", "numerics", "patterns", "guide")
SHEET_PX = 703  # an A4 sheet less its margins at 96 dpi
MIN_LETTER_PX = 11.9

# Words that are hard to read: contrast of text and ground by WCAG 2, less than 4.5 or, of large
# letters, 3. A ground is that of the nearest element that has one, laid over those below.
FAINT = """() => {
  const paint = document.createElement('canvas').getContext('2d', {willReadFrequently: true});
  const rgba = colour => {
    paint.clearRect(0, 0, 1, 1); paint.fillStyle = colour; paint.fillRect(0, 0, 1, 1);
    return [...paint.getImageData(0, 0, 1, 1).data].map(v => v / 255);
  };
  const over = (a, b) => [0, 1, 2].map(k => a[k] * a[3] + b[k] * (1 - a[3])).concat(1);
  const light = c => [0.2126, 0.7152, 0.0722].reduce((sum, w, k) =>
    sum + w * (c[k] <= 0.04045 ? c[k] / 12.92 : ((c[k] + 0.055) / 1.055) ** 2.4), 0);
  const ground = e => {
    const layers = [];
    for (let at = e; at; at = at.parentElement)
      layers.push(rgba(getComputedStyle(at).backgroundColor));
    return layers.reverse().reduce((below, layer) => over(layer, below), [1, 1, 1, 1]);
  };
  const found = [];
  for (const e of document.querySelectorAll('body, body *')) {
    const texts = [...e.childNodes].filter(n => n.nodeType === 3);
    const words = texts.map(n => n.data.trim()).join('');
    if (!words || e.closest('script, style, textarea, [disabled]')) continue;
    if (!e.checkVisibility()) continue;
    const style = getComputedStyle(e), under = ground(e.closest('svg')?.parentElement ?? e);
    const ink = over(rgba(e.closest('svg') ? style.fill : style.color), under);
    const [a, b] = [light(ink), light(under)].sort((x, y) => y - x);
    const size = parseFloat(style.fontSize);
    const large = size >= 24 || (size >= 18.6 && style.fontWeight >= 700);
    if ((a + 0.05) / (b + 0.05) < (large ? 3 : 4.5))
      found.push(`${words.slice(0, 40)}: ${((a + 0.05) / (b + 0.05)).toFixed(2)}`);
  }
  return found;
}"""
GROUND = """() => {
  const [r, g, b] = getComputedStyle(document.body).backgroundColor.match(/[0-9.]+/g).map(Number);
  return (r + g + b) / 3;
}"""
SMALL = """least => [...document.querySelectorAll('.plot svg text')].map(t => [
  t.textContent, t.ownerSVGElement.getScreenCTM().a * parseFloat(getComputedStyle(t).fontSize),
]).filter(([, px]) => px < least)"""
CUT_FIGURES = """() => [...document.querySelectorAll('.plot .scroll')].filter(
  box => box.scrollWidth > box.clientWidth + 1).length"""
OFF_THE_SHEET = """() => [...document.querySelectorAll('table, svg, img')].filter(e =>
  e.checkVisibility() && e.getBoundingClientRect().right > innerWidth + 1
).map(e => e.outerHTML.slice(0, 80))"""
MAY_BE_SPLIT = """() => [...document.querySelectorAll('svg, img, figure, .plot, tr')].filter(e =>
  e.checkVisibility() && !e.parentElement.closest('svg') &&
  getComputedStyle(e).breakInside !== 'avoid'
).map(e => e.outerHTML.slice(0, 80))"""
HIDDEN = """() => [
  ...document.querySelectorAll('details:not(.screen *) > :not(summary)')
].filter(e =>
  !e.checkVisibility({contentVisibilityAuto: true}) || e.getBoundingClientRect().height === 0
).map(e => e.outerHTML.slice(0, 80))"""
BEFORE_THE_VERDICT = """() => {
  const verdict = document.querySelector('.verdict');
  return [...document.querySelectorAll('svg, img, canvas, table')].filter(e =>
    verdict.compareDocumentPosition(e) & Node.DOCUMENT_POSITION_PRECEDING).length;
}"""
EMPTY = """() => {
  const nothing = ['', '–', '—', '-', 'n.a.'];
  const none = e => !e.querySelector('img, svg') && nothing.includes(e.textContent.trim());
  const found = [];
  for (const table of document.querySelectorAll('table')) {
    const rows = [...table.tBodies].flatMap(b => [...b.rows]).filter(r => r.cells.length > 1);
    const whole = rows.filter(r => [...r.cells].every(c => c.colSpan === 1));
    const wide = Math.max(0, ...whole.map(r => r.cells.length));
    for (let k = 0; k < wide; k++)
      if (whole.length === rows.length && rows.every(r => none(r.cells[k])))
        found.push(`column ${k} of ${table.textContent.slice(0, 60)}`);
    for (const r of rows)
      if ([...r.cells].slice(1).every(none)) found.push(`row ${r.textContent}`);
    if (!table.rows.length) found.push('a table of nothing');
  }
  return found;
}"""
NAMELESS = """() => [
  ...[...document.images].filter(i => !i.alt).map(i => i.outerHTML.slice(0, 60)),
  ...[...document.querySelectorAll('.plot svg')]
    .filter(s => s.getAttribute('role') !== 'img' || !s.getAttribute('aria-label'))
    .map(s => s.outerHTML.slice(0, 60)),
  ...[...document.querySelectorAll('canvas')]
    .filter(c => !c.getAttribute('aria-label') && !c.getAttribute('aria-labelledby'))
    .map(c => c.id),
]"""
# An image that did not decode has no natural width.
UNDRAWN = """() => [
  ...[...document.images].filter(i => !i.complete || !i.naturalWidth),
  ...[...document.querySelectorAll('.plot svg')].filter(s => s.getBoundingClientRect().width < 99),
].map(e => e.outerHTML.slice(0, 80))"""
LEVELS = "() => [...document.querySelectorAll('h1, h2, h3, h4')].map(h => +h.tagName[1])"

pytestmark = pytest.mark.slow


def checked(tab: Page, out_of_sight: Callable[[Page], list[str]]) -> None:
    """All that a page keeps to; an open one, in a light window of 1280 pixels."""
    assert tab.evaluate("document.documentElement.lang") == "en"
    assert tab.title()
    assert tab.evaluate(NAMELESS) == []
    levels = tab.evaluate(LEVELS)
    assert levels[0] == 1
    assert all(b <= a + 1 and b > 1 for a, b in pairwise(levels))
    words = tab.locator(".verdict").first.inner_text()
    assert len(words) > 20
    assert "." in words
    assert tab.evaluate(BEFORE_THE_VERDICT) == 0
    assert tab.evaluate(EMPTY) == []

    assert tab.evaluate(UNDRAWN) == []
    assert out_of_sight(tab) == []
    assert tab.evaluate(CUT_FIGURES) == 0
    assert tab.evaluate(GROUND) > 230
    assert tab.evaluate(FAINT) == []
    tab.emulate_media(color_scheme="dark")
    assert tab.evaluate(GROUND) < 40
    assert tab.evaluate(FAINT) == []

    tab.set_viewport_size({"width": 390, "height": 900})
    assert out_of_sight(tab) == []
    assert tab.evaluate(SMALL, MIN_LETTER_PX) == []

    tab.emulate_media(media="print", color_scheme="dark")
    tab.set_viewport_size({"width": SHEET_PX, "height": 1000})
    assert tab.evaluate(OFF_THE_SHEET) == []
    assert tab.evaluate(FAINT) == []  # on white: paper is light, whatever the screen is
    assert tab.evaluate(MAY_BE_SPLIT) == []
    assert tab.evaluate(HIDDEN) == []


@pytest.mark.parametrize("kind", KINDS)
def test_every_page_is_readable_everywhere(
    kind: str,
    opened: Callable[..., Page],
    pages: Callable[[str], Path],
    out_of_sight: Callable[[Page], list[str]],
) -> None:
    checked(opened(pages(kind).as_uri()), out_of_sight)


def test_a_bad_page_is_caught(
    opened: Callable[..., Page], out_of_sight: Callable[[Page], list[str]], tmp_path: Path
) -> None:
    page = tmp_path / "bad.html"
    table = "<table><tr><td style='min-width: 600px'>x</td></tr></table>"
    page.write_text(
        f"<main><section style='overflow: hidden'>{table}</section></main><script>missing()"
        "</script><img src='http://127.0.0.1:9/x.png'>"
    )
    tab = opened(page.as_uri(), 390)
    assert any(found.startswith("<table>") for found in out_of_sight(tab))
    assert len(tab.evaluate(UNDRAWN)) == 1
    wrong = " ".join(opened.wrong)  # type: ignore[attr-defined]
    assert "missing is not defined" in wrong
    assert "http://127.0.0.1:9/x.png" in wrong
    opened.wrong.clear()  # type: ignore[attr-defined]


# Share of a canvas's pixels that differ from their neighbour on the left.
DRAWN = """id => {
  const c = document.getElementById(id), g = c.getContext('2d');
  const d = new Uint32Array(g.getImageData(0, 0, c.width, c.height).data.buffer);
  return d.filter((v, i) => i && v !== d[i - 1]).length / d.length;
}"""
STATE = "() => document.getElementById('state').innerText"


def image(tab: Page) -> int:
    """Number of the image that the live page shows."""
    words = tab.inner_text("body").split()
    return int(words[words.index("image", words.index("age")) + 1])


def test_live_page_buttons_and_several_viewers(
    live_url: str, opened: Callable[..., Page], out_of_sight: Callable[[Page], list[str]]
) -> None:
    tab = opened(live_url)
    tab.wait_for_function(
        r"() => /image ([3-9]|\d\d)/.test(document.body.innerText)", timeout=60_000
    )
    tab.click("#pause")
    tab.wait_for_function(f"{STATE} == 'paused'")
    tab.wait_for_timeout(1000)  # what was under way is shown
    words, held = tab.inner_text("body"), image(tab)
    for word in ("simulated, seed 3", "flow trusted", "no force calibration", "Hz"):
        assert word in words
    assert tab.evaluate(DRAWN, "face") > 0.5
    assert tab.evaluate(DRAWN, "plot") > 0.01

    other = opened(live_url)  # a browser that comes later sees what is there, and holds nobody
    other.wait_for_function(r"() => /image \d/.test(document.body.innerText)")
    assert image(tab) == held <= image(other)
    other.click("#reference")
    tab.click("#pause")
    tab.wait_for_function(f"{STATE}.startsWith('ended')", timeout=120_000)
    assert image(tab) == image(other) > held
    checked(tab, out_of_sight)
