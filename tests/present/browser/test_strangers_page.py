"""The live page under attack by pages of other origins, in a real browser."""

from __future__ import annotations

import http.server
import threading
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import numpy as np
import pytest

from deltact_fab.present.live.page import LivePage

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = pytest.mark.slow

# Each takes the address of the live page, token included: every defence holds without the token's.
SMUGGLED = """const {pathname, host} = new URL(url);
  const smuggled = `POST ${pathname}reference HTTP/1.1\\r\\nHost: ${host}\\r\\n\\r\\n`;"""
FETCH = f"""async url => {{ {SMUGGLED}
  for (const mode of ['no-cors', 'cors']) for (const name of ['reference', '', '../reference'])
    await fetch(url + name, {{method: 'POST', mode, headers: {{'Content-Type': 'text/plain'}},
      body: smuggled}}).catch(() => 0);
  navigator.sendBeacon(url + 'reference', smuggled);
}}"""
FORM = f"""async url => {{ {SMUGGLED}
  for (const enctype of ['text/plain', 'application/x-www-form-urlencoded']) {{
    const frame = document.createElement('iframe'); frame.name = 'into' + enctype;
    const form = document.createElement('form'), field = document.createElement('textarea');
    Object.assign(form, {{method: 'post', action: url + 'reference', enctype, target: frame.name}});
    field.name = smuggled + smuggled; field.value = smuggled;
    form.append(field); document.body.append(frame, form); form.submit();
    await new Promise(done => frame.onload = done);
  }}
}}"""
# Names of what another page could read or run of the live page.
READ = """async url => {
  const read = [], load = (tag, at, name) => new Promise(done => {
    const e = document.createElement(tag); e.onerror = done;
    e.onload = () => { read.push(`${tag} ${name}`); done(); };
    if (tag === 'link') Object.assign(e, {rel: 'stylesheet', href: at}); else e.src = at;
    document.body.append(e);
  });
  for (const name of ['', 'about', 'newest?-1', 'image.jpg', 'live.js', 'style.css']) {
    for (const tag of ['img', 'script', 'link']) await load(tag, url + name, name);
    await fetch(url + name).then(() => read.push(`fetch ${name}`), () => 0);
  }
  return read;
}"""
# A frame below the pointer, nearly invisible, as clickjacking lays it.
FRAME = """url => new Promise(done => {
  const e = document.createElement('iframe'); e.onload = done; e.id = 'bait'; e.src = url;
  e.style = 'position: fixed; inset: 0; width: 1000px; height: 700px; opacity: 0.01';
  document.body.append(e);
})"""


class Bait(http.server.BaseHTTPRequestHandler):
    """An empty page of a stranger; `?` and an address in its own address is a link to there."""

    def do_GET(self) -> None:
        body = f"<!doctype html><body><a href='{self.path.partition('?')[2]}'>link</a>".encode()
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: object) -> None:
        """Nothing is printed."""


@pytest.fixture(scope="module")
def stranger_port() -> Iterator[int]:
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Bait)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield server.server_port
    server.shutdown()
    server.server_close()


@pytest.fixture
def asked() -> list[str]:
    return []


@pytest.fixture
def live(asked: list[str]) -> Iterator[LivePage]:
    about = {"source": "here", "trace_names": ["z"], "trace_title": "Force", "trace_least": 0.2}
    page = LivePage(about, lambda: asked.append("reference"))
    page.show(lambda: {"frame": 7}, lambda: np.full((8, 8, 3), 70, np.uint8), (0.0, 0.0, 1.0))
    yield page
    page.close()


# Another port is another origin of the same site; another name, another site.
@pytest.fixture(params=["127.0.0.1", "localhost", "stranger.test"])
def stranger(
    request: pytest.FixtureRequest, browser: Browser, stranger_port: int
) -> Iterator[Page]:
    tab = browser.new_page(viewport={"width": 1000, "height": 700})
    tab.goto(f"http://{request.param}:{stranger_port}/")
    yield tab
    tab.close()


def click_own(opened: Callable[..., Page], live: LivePage) -> None:
    """Click the button of the page itself."""
    tab = opened(live.url)
    with tab.expect_response("**/reference") as answer:
        tab.click("#reference")
    assert answer.value.status == 204


@pytest.mark.parametrize("attack", [FETCH, FORM], ids=["fetch", "form"])
def test_foreign_page_sets_no_reference(
    attack: str, stranger: Page, live: LivePage, asked: list[str], opened: Callable[..., Page]
) -> None:
    stranger.evaluate(attack, live.url)
    assert asked == []
    click_own(opened, live)
    assert asked == ["reference"]


def test_foreign_page_reads_nothing(stranger: Page, live: LivePage) -> None:
    assert stranger.evaluate(READ, live.url) == []


def test_foreign_page_cannot_frame_it(stranger: Page, live: LivePage, asked: list[str]) -> None:
    with stranger.expect_console_message(
        lambda m: "frame-ancestors 'none'" in m.text, timeout=9000
    ):
        stranger.evaluate(FRAME, live.url)
    assert live.url not in [frame.url for frame in stranger.frames]
    for x_px in range(20, 1000, 40):
        for y_px in (20, 40, 60):
            stranger.mouse.click(x_px, y_px)
    assert asked == []


def test_name_led_here_reads_nothing(browser: Browser, live: LivePage, asked: list[str]) -> None:
    """Rebinding: the stranger's own name leads to the live page, whose origin is then its own."""
    tab, root = browser.new_page(), urlsplit(live.url).path
    answer = tab.goto(f"http://stranger.test:{live.port}{root}")
    assert answer is not None
    assert (answer.status, answer.text()) == (403, "open the whole address that was printed")
    fetched = "path => fetch(path, {method: 'POST'}).then(r => r.status)"
    assert tab.evaluate(fetched, f"{root}reference") == 403
    assert asked == []
    tab.close()


def test_link_from_a_page_opens_it(stranger: Page, live: LivePage, asked: list[str]) -> None:
    """An address in a terminal in a browser, for instance; it stays a page of its own."""
    stranger.goto(f"{stranger.url}?{live.url}")
    stranger.click("a")
    stranger.wait_for_url(live.url)
    with stranger.expect_response("**/reference") as answer:
        stranger.click("#reference")
    assert (answer.value.status, asked) == (204, ["reference"])


def test_policy_runs_no_foreign_script(opened: Callable[..., Page], live: LivePage) -> None:
    tab = opened(live.url)
    tab.evaluate("""() => {
      document.body.insertAdjacentHTML('beforeend', '<img src=x onerror="window.run = 1">');
      const e = document.createElement('script'); e.textContent = 'window.run = 2';
      document.body.append(e);
    }""")
    tab.wait_for_timeout(200)
    assert tab.evaluate("window.run") is None
    opened.wrong.clear()  # type: ignore[attr-defined]
