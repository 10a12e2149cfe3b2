"""The page's server: who may ask, what a browser gets, and that none holds the measurement up."""

from __future__ import annotations

import http.client
import json
import socket
from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
import pytest

from deltact_fab.present.live.page import LivePage


@pytest.fixture
def asked() -> list[str]:
    """What browsers asked for."""
    return []


@pytest.fixture
def page(asked: list[str]) -> Iterator[LivePage]:
    made = LivePage({"source": "here"}, lambda: asked.append("reference"))
    yield made
    made.close()


def show(page: LivePage, k: int, size: int = 1) -> None:
    """A result of number k that weighs so many numbers."""
    numbers = {"frame": k, "load": [k] * size}
    page.show(lambda: numbers, lambda: np.full((8, 8, 3), 10 * k, np.uint8), (k, 2 * k, 1))


def ask(page: LivePage, path: str, method: str = "GET", **headers: str) -> tuple[int, bytes]:
    link = http.client.HTTPConnection("127.0.0.1", page.port, timeout=10)
    link.request(method, path, headers=headers)
    answer = link.getresponse()
    body = answer.read()
    link.close()
    return answer.status, body


def newest(page: LivePage, seen: int = -1) -> dict[str, Any]:
    return json.loads(ask(page, f"/newest?{seen}")[1])


def test_browser_gets_page_picture_and_traces(page: LivePage) -> None:
    for k in range(3):
        show(page, k)
    status, body = ask(page, "/")
    assert status == 200
    assert b"/newest" in body
    assert b"http://" not in body.replace(b"http://www.w3.org", b"")  # nothing is fetched elsewhere
    assert json.loads(ask(page, "/about")[1])["trace"] == [[0, 0, 1], [1, 2, 1], [2, 4, 1]]
    picture = cv2.imdecode(np.frombuffer(ask(page, "/image.jpg?2")[1], np.uint8), 1)
    assert picture is not None
    assert abs(int(picture.mean()) - 20) <= 2
    assert ask(page, "/etc/passwd")[0] == 404
    assert newest(page, 1)["result"]["frame"] == 2
    assert newest(page, 2)["result"] is None


def test_foreign_requests_are_rejected(page: LivePage, asked: list[str]) -> None:
    with pytest.raises(ConnectionRefusedError):  # 127.0.0.2 is this computer too, and not asked
        socket.create_connection(("127.0.0.2", page.port))
    assert ask(page, "/", Host="deltact.example")[0] == 403  # a name that was made to lead here
    assert ask(page, "/reference", "POST", Origin="http://deltact.example")[0] == 403
    assert asked == []
    assert ask(page, "/reference", "POST", Origin=page.url.rstrip("/"))[0] == 204
    assert asked == ["reference"]


@pytest.mark.slow
def test_stalled_browser_blocks_nothing(page: LivePage) -> None:
    """Every result is some megabytes: more than the buffers between server and browser take."""
    show(page, 0, 1 << 20)
    deaf = socket.create_connection(("127.0.0.1", page.port))
    deaf.sendall(f"GET /newest?-1 HTTP/1.1\r\nHost: 127.0.0.1:{page.port}\r\n\r\n".encode())
    for k in range(1, 8):
        show(page, k, 1 << 20)
        assert newest(page, k - 1)["result"]["frame"] == k
    deaf.close()


def test_browsers_get_health_and_end(page: LivePage) -> None:
    page.health, page.ended = "state of health: fit to use", "ended"
    told = newest(page)
    assert (told["health"], told["ended"]) == ("state of health: fit to use", "ended")
