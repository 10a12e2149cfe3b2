"""The page's server: who may ask, what a browser gets, and that none holds the measurement up."""

from __future__ import annotations

import http.client
import json
import socket
import threading
from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
import pytest

from deltact_fab.live.page import LivePage, PageResult


@pytest.fixture
def asked() -> list[str]:
    """What browsers asked for."""
    return []


@pytest.fixture
def page(asked: list[str]) -> Iterator[LivePage]:
    made = LivePage({"source": "here"}, lambda: asked.append("reference"))
    yield made
    made.close()


def shot(k: int, size: int = 1) -> PageResult:
    """A result of number k that weighs so many numbers."""
    return PageResult(
        lambda: {"frame": k, "load": [k] * size}, lambda: np.full((8, 8, 3), 10 * k, np.uint8)
    )


def ask(page: LivePage, path: str, method: str = "GET", **headers: str) -> tuple[int, bytes]:
    link = http.client.HTTPConnection("127.0.0.1", page.port, timeout=10)
    link.request(method, path, headers=headers)
    answer = link.getresponse()
    body = answer.read()
    link.close()
    return answer.status, body


def events(page: LivePage) -> Iterator[dict[str, Any]]:
    """The results that a browser is told."""
    link = http.client.HTTPConnection("127.0.0.1", page.port, timeout=10)
    link.request("GET", "/events")
    answer = link.getresponse()
    kind = "message"
    while line := answer.readline().decode():
        if line.startswith("event: "):
            kind = line.removeprefix("event: ").strip()
        elif line.startswith("data: "):
            yield {"kind": kind, **json.loads(line.removeprefix("data: "))}
            kind = "message"


def test_a_browser_gets_the_page_the_newest_picture_and_the_traces_so_far(page: LivePage) -> None:
    for k in range(3):
        page.show(shot(k), (float(k), 2.0 * k, 1.0))
    status, body = ask(page, "/")
    assert status == 200
    assert b"EventSource" in body
    assert b"http://" not in body.replace(b"http://www.w3.org", b"")  # nothing is fetched elsewhere
    assert json.loads(ask(page, "/about")[1])["trace"] == [[0, 0, 1], [1, 2, 1], [2, 4, 1]]
    picture = cv2.imdecode(np.frombuffer(ask(page, "/image.jpg?2")[1], np.uint8), 1)
    assert picture is not None
    assert abs(int(picture.mean()) - 20) <= 2
    assert ask(page, "/etc/passwd")[0] == 404


def test_only_this_computer_may_ask_and_no_page_of_another_server(
    page: LivePage, asked: list[str]
) -> None:
    with pytest.raises(ConnectionRefusedError):  # 127.0.0.2 is this computer too, and not asked
        socket.create_connection(("127.0.0.2", page.port))
    assert ask(page, "/", Host="deltact.example")[0] == 403  # a name that was made to lead here
    assert ask(page, "/reference", "POST", Origin="http://deltact.example")[0] == 403
    assert asked == []
    assert ask(page, "/reference", "POST", Origin=page.url.rstrip("/"))[0] == 204
    assert asked == ["reference"]


@pytest.mark.slow
def test_a_browser_that_reads_nothing_holds_up_neither_measurement_nor_others(
    page: LivePage,
) -> None:
    """Every result is some megabytes: more than the buffers between server and browser take."""
    deaf = socket.create_connection(("127.0.0.1", page.port))
    deaf.sendall(f"GET /events HTTP/1.1\r\nHost: 127.0.0.1:{page.port}\r\n\r\n".encode())
    heard = (e for e in events(page) if e["kind"] == "message")
    seen = []
    for k in range(8):
        page.show(shot(k, 1 << 20), (float(k), 0.0, 1.0))
        if k % 2:
            seen.append(next(heard)["frame"])
    assert seen[-1] >= 6
    assert sorted(set(seen)) == seen
    deaf.close()


def test_pause_and_end_are_told_to_every_browser(page: LivePage) -> None:
    told = [(e for e in events(page) if e["kind"] == "state") for _ in range(2)]
    assert [next(t)["paused"] for t in told] == [False, False]
    assert page.going(0.0)
    ask(page, "/pause", "POST")
    assert [next(t)["paused"] for t in told] == [True, True]
    assert not page.going(0.0)
    threading.Timer(0.05, lambda: ask(page, "/go", "POST")).start()
    assert page.going(10.0)
    page.tell("state of health: fit to use")
    page.end("ended")
    for t in told:
        last = next(s for s in t if s["ended"])
        assert last["health"] == "state of health: fit to use"
