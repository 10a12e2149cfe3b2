"""The page's server: who may ask, what a browser gets, and that none holds the measurement up."""

from __future__ import annotations

import http.client
import json
import re
import select
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count
from typing import Any
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest

from deltact_fab.present.live import page as live_page
from deltact_fab.present.live.page import LivePage

# Requests by their lines; {good} is one that sets a reference, as long as it is the first.
GOOD = "POST {root}reference HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\n"
FOREIGN = "POST {root}reference HTTP/1.1\r\nHost: {host}\r\nOrigin: http://deltact.example\r\n"
HEAD = "POST {root}reference HTTP/1.1\r\nHost: {host}\r\n"
ATTACKS = {
    "refused, its body a request": FOREIGN + "Content-Length: {size}\r\n\r\n{good}",
    "body of text": GOOD + "Content-Type: text/plain\r\nContent-Length: {size}\r\n\r\n{good}",
    "two lengths": GOOD + "Content-Length: 0\r\nContent-Length: {size}\r\n\r\n{good}",
    "negative length": GOOD + "Content-Length: -1\r\n\r\n{good}",
    "length of no digits": GOOD + "Content-Length: 0x0\r\n\r\n{good}",
    "chunks": GOOD + "Transfer-Encoding: chunked\r\n\r\n{size:x}\r\n{good}\r\n0\r\n\r\n",
    "chunks and length": GOOD
    + "Content-Length: 0\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n{good}",
    "pipelined": "GET {root}nothing HTTP/1.1\r\nHost: {host}\r\n\r\n{good}",
    "refused, then pipelined": "GET / HTTP/1.1\r\nHost: x\r\nConnection: keep-alive\r\n\r\n{good}",
    "no token": "POST /reference HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\n\r\n",
    "other token": GOOD.replace("{root}", "/{other}/") + "\r\n",
    "token of no ASCII": GOOD.replace("{root}", "/\xe9/") + "\r\n",
    "path of a proxy": GOOD.replace("{root}", "http://deltact.example{root}") + "\r\n",
    "no host": "POST {root}reference HTTP/1.1\r\nOrigin: http://{host}\r\n\r\n",
    "two hosts": GOOD + "Host: {host}\r\n\r\n",
    "made-up host": GOOD.replace("{host}", "deltact.example:{port}") + "\r\n",
    "host without port": GOOD.replace("{host}", "localhost") + "\r\n",
    "no origin": HEAD + "\r\n",
    "null origin": HEAD + "Origin: null\r\n\r\n",
    "https origin": HEAD + "Origin: https://{host}\r\n\r\n",
    "bare origin": HEAD + "Origin: {host}\r\n\r\n",
    "origin of another port": HEAD + "Origin: http://127.0.0.1:1\r\n\r\n",
    "origin of another name": HEAD + "Origin: http://localhost:{port}\r\n\r\n",
    "longer origin": HEAD + "Origin: http://{host}.deltact.example\r\n\r\n",
    "two origins": GOOD + "Origin: http://deltact.example\r\n\r\n",
    "cross-site": GOOD + "Sec-Fetch-Site: cross-site\r\n\r\n",
    "same site, other port": GOOD + "Sec-Fetch-Site: same-site\r\n\r\n",
    "other methods": GOOD.replace("POST", "PUT") + "\r\n{good}",
    "read to set": GOOD.replace("POST", "GET") + "\r\n{good}",
    "protocol of 1991": "GET {root}reference\r\nHost: {host}\r\n\r\n{good}",
    "protocol of the future": GOOD.replace("1.1", "9.9") + "\r\n{good}",
    "bare line ends": (GOOD + "\r\n").replace("\r", ""),
    "long header": GOOD + "X: " + "x" * 70_000 + "\r\n\r\n",
    "many headers": GOOD + f"X: {'x' * 1000}\r\n" * 30 + "\r\n",
    "cut off": GOOD,
}


@contextmanager
def serve(asked: list[str]) -> Iterator[LivePage]:
    made = LivePage({"source": "here"}, lambda: asked.append("reference"))
    yield made
    made.close()


@pytest.fixture
def asked() -> list[str]:
    """What browsers asked for."""
    return []


@pytest.fixture
def page(asked: list[str]) -> Iterator[LivePage]:
    with serve(asked) as made:
        yield made


@pytest.fixture(scope="module")
def target() -> Iterator[tuple[LivePage, list[str]]]:
    """A page for all attacks, as the end of each takes half a second; what they asked for."""
    counted: list[str] = []
    with serve(counted) as made:
        yield made, counted


def show(page: LivePage, k: int, size: int = 1) -> None:
    """A result of number k that weighs so many numbers."""
    numbers = {"frame": k, "load": [k] * size}
    page.show(lambda: numbers, lambda: np.full((8, 8, 3), 10 * k, np.uint8), (k, 2 * k, 1))


def place(page: LivePage) -> tuple[str, str]:
    """Path of the page, token included, and its host with port."""
    return urlsplit(page.url).path, f"127.0.0.1:{page.port}"


def ask(page: LivePage, name: str, method: str = "GET", **headers: str) -> tuple[int, bytes]:
    """Status and body of what has this name below the page's address."""
    link = http.client.HTTPConnection("127.0.0.1", page.port, timeout=10)
    link.request(method, urlsplit(page.url).path + name, headers=headers)
    answer = link.getresponse()
    body = answer.read()
    link.close()
    return answer.status, body


def newest(page: LivePage, seen: int = -1) -> dict[str, Any]:
    return json.loads(ask(page, f"newest?{seen}")[1])


def connect(page: LivePage) -> socket.socket:
    return socket.create_connection(("127.0.0.1", page.port), timeout=10)


def exchange(page: LivePage, request: str) -> str:
    """All that the server answers to these bytes, until it closes the connection."""
    answer = b""
    with connect(page) as link, suppress(ConnectionError):
        link.sendall(request.encode("latin-1"))
        with suppress(OSError):  # not connected: the server closed first
            link.shutdown(socket.SHUT_WR)
        while part := link.recv(65536):
            answer += part
    return answer.decode("latin-1")


def test_browser_gets_page_picture_and_traces(page: LivePage) -> None:
    for k in range(3):
        show(page, k)
    for name in ("", "live.css", "live.js", "style.css"):
        status, body = ask(page, name)
        assert status == 200
        assert b"http://" not in body.replace(b"http://www.w3.org", b"")  # nothing from elsewhere
    assert json.loads(ask(page, "about")[1])["trace"] == [[0, 0, 1], [1, 2, 1], [2, 4, 1]]
    picture = cv2.imdecode(np.frombuffer(ask(page, "image.jpg?2")[1], np.uint8), 1)
    assert picture is not None
    assert abs(int(picture.mean()) - 20) <= 2
    assert ask(page, "etc/passwd")[0] == 404
    assert newest(page, 1)["result"]["frame"] == 2
    assert newest(page, 2)["result"] is None


def test_other_address_is_not_listened_on(page: LivePage) -> None:
    with pytest.raises(ConnectionRefusedError):  # 127.0.0.2 is this computer too, and not asked
        socket.create_connection(("127.0.0.2", page.port))


@pytest.mark.parametrize("name", ["127.0.0.1", "localhost"])
def test_own_page_sets_a_reference(page: LivePage, asked: list[str], name: str) -> None:
    own = {"Host": f"{name}:{page.port}", "Origin": f"http://{name}:{page.port}"}
    assert ask(page, "reference", "POST", **own, **{"Sec-Fetch-Site": "same-origin"})[0] == 204
    assert asked == ["reference"]
    clicked = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Dest": "document"}  # a link to the page
    assert ask(page, "", Host=own["Host"], **clicked)[0] == 200


@pytest.mark.parametrize("attack", ATTACKS)
def test_foreign_requests_set_nothing(
    target: tuple[LivePage, list[str]], attack: str, capfd: pytest.CaptureFixture[str]
) -> None:
    page, counted = target
    counted.clear()
    root, host = place(page)
    facts: dict[str, Any] = {"root": root, "host": host, "port": page.port, "other": "A" * 22}
    facts["good"] = (GOOD + "\r\n").format(**facts)
    answer = exchange(page, ATTACKS[attack].format(**facts, size=len(facts["good"])))
    assert counted == []
    assert answer.count("HTTP/1") <= 1
    assert not re.match(r"HTTP/1\.\d 2", answer)
    assert capfd.readouterr().err == ""


def test_one_connection_sets_one_reference(page: LivePage, asked: list[str]) -> None:
    root, host = place(page)
    request = (GOOD + "Connection: keep-alive\r\n\r\n").format(root=root, host=host)
    answer = exchange(page, request * 3)
    assert (answer.count("HTTP/1"), asked) == (1, ["reference"])


@pytest.mark.parametrize("name", ["", "live.js", "about", "newest?-1", "image.jpg", "nothing"])
def test_without_token_nothing_is_read(target: tuple[LivePage, list[str]], name: str) -> None:
    show(page := target[0], 7)
    own, host = place(page)
    for root in ("/", "//", "/A/", f"/{'A' * 22}/", f"/?{own}"):
        answer = exchange(page, f"GET {root}{name} HTTP/1.1\r\nHost: {host}\r\n\r\n")
        head, _, body = answer.partition("\r\n\r\n")
        assert head.startswith("HTTP/1.0 403 ")
        assert body == "open the whole address that was printed"
    headers = {"Origin": "http://127.0.0.1:1"}, {"Sec-Fetch-Site": "cross-site"}, {"Host": "a.test"}
    for header in headers:  # of a page that has the token, and no right to read
        assert ask(page, name, **header)[0] == 403


def test_every_answer_forbids_frames_and_sniffing(page: LivePage) -> None:
    show(page, 7)
    wanted = {
        "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
        "connect-src 'self'; img-src 'self' data:; base-uri 'none'; form-action 'none'; "
        "frame-ancestors 'none'",
        "X-Frame-Options": "DENY", "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer", "Cross-Origin-Resource-Policy": "same-origin",
        "Cross-Origin-Opener-Policy": "same-origin", "Cache-Control": "no-store",
    }  # fmt: skip
    (root, host), codes = place(page), []
    for target in (*(f"GET {root}{n}" for n in ("", "about", "nothing")), "GET /", f"PUT {root}"):
        answer = exchange(page, f"{target} HTTP/1.1\r\nHost: {host}\r\n\r\n")
        head = answer.partition("\r\n\r\n")[0].split("\r\n")
        codes.append(head[0].split()[1])
        headers = dict(line.split(": ", 1) for line in head[1:])
        assert headers.items() >= wanted.items()
        assert headers.keys() - wanted.keys() == {"Content-Type", "Content-Length"}
    assert codes == ["200", "200", "404", "403", "501"]


def test_slow_request_is_cut_off(
    page: LivePage, asked: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A byte arrives in time again and again, the whole does not."""
    monkeypatch.setattr(live_page, "REQUEST_LIMIT_S", 0.3)
    start_s = time.monotonic()
    with connect(page) as link, suppress(ConnectionError):
        for k in count():
            assert time.monotonic() - start_s < 10
            link.sendall(b"POST / HTTP/1.1\r\nX: "[k : k + 1] or b"x")
            if select.select([link], [], [], 0.02)[0]:
                assert link.recv(1) == b""
                break
    assert asked == []


def test_idle_connections_are_limited(page: LivePage, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_page, "REQUEST_LIMIT_S", 60.0)
    idle, deadline_s = [connect(page) for _ in range(80)], time.monotonic() + 10
    while len(select.select(idle, [], [], 0.1)[0]) < 16:
        assert time.monotonic() < deadline_s
    assert threading.active_count() <= 64
    for link in idle:
        link.close()
    while not exchange(page, "GET / HTTP/1.1\r\n\r\n"):  # their threads end one by one
        assert time.monotonic() < deadline_s
    assert ask(page, "about")[0] == 200


@pytest.mark.slow
def test_stalled_browser_blocks_nothing(page: LivePage) -> None:
    """Every result is some megabytes: more than the buffers between server and browser take."""
    show(page, 0, 1 << 20)
    deaf = connect(page)
    root, host = place(page)
    deaf.sendall(f"GET {root}newest?-1 HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
    for k in range(1, 8):
        show(page, k, 1 << 20)
        assert newest(page, k - 1)["result"]["frame"] == k
    deaf.close()


def test_browsers_get_health_and_end(page: LivePage) -> None:
    page.health, page.ended = "state of health: fit to use", "ended"
    told = newest(page)
    assert (told["health"], told["ended"]) == ("state of health: fit to use", "ended")
