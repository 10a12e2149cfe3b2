"""The live page: a small server on the loopback that shows the newest result to any browser here.

The measurement only leaves its newest result here. A browser asks ten times a second for what is
new and has a thread of its own, so one that is slow misses results and stops nobody; numbers and
picture are made when one asks.
"""

from __future__ import annotations

import json
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import InputError
from deltact_fab.paths import asset

LOOPBACK_HOST = "127.0.0.1"
JPEG_QUALITY = 80
TRACE_POINTS = 1200
"""Points of the traces that a browser which comes later is shown."""


class LivePage:
    """Serves the live page until it is closed.

    reference: called when a browser asks for a new reference. about: what the page says of the
    source, once. ended: why no more results will come. health, unfit: the sensor's state of health,
    and why its results are not to be trusted. Anyone on this computer may look and ask for a
    reference, and nobody else: it listens on the loopback, and answers no page of another origin.
    """

    def __init__(self, about: dict[str, Any], reference: Callable[[], None], port: int = 0) -> None:
        """port: 0 takes a free one. Raises InputError for one that cannot be had."""
        self._about, self._lock = about, threading.Lock()
        self._trace: deque[tuple[float | None, ...]] = deque(maxlen=TRACE_POINTS)
        self._number, self._data = -1, cache(dict[str, Any])
        self.jpeg: Callable[[], bytes] = bytes
        """The newest picture."""
        self.ended: str | None = None
        self.health = self.unfit = ""
        self.reference = reference
        page = self

        class Handler(_Handler):
            live_page = page

        try:
            self._server = ThreadingHTTPServer((LOOPBACK_HOST, port), Handler)
        except OSError as error:
            raise InputError(
                f"--port {port}: {error.strerror}; leave it out for a free one"
            ) from error
        self._server.daemon_threads = True
        self.port = int(self._server.server_address[1])
        self.url = f"http://{LOOPBACK_HOST}:{self.port}/"
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def show(
        self,
        data: Callable[[], dict[str, Any]],
        image: Callable[[], NDArray[np.uint8]],
        point: tuple[float | None, ...],
    ) -> None:
        """Leave a result: its numbers, its picture, its point of the traces (time, then values)."""

        def jpeg() -> bytes:
            ok, file = cv2.imencode(".jpg", image(), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
            return file.tobytes() if ok else b""

        with self._lock:
            self._number, self._data, self.jpeg = self._number + 1, cache(data), cache(jpeg)
            self._trace.append(point)

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()

    def about(self) -> dict[str, Any]:
        """What a browser is told first, with the traces so far."""
        with self._lock:
            return {**self._about, "trace": list(self._trace)}

    def newest(self, last_number: str) -> dict[str, Any]:
        """What a browser is told that has seen the result of that number."""
        with self._lock:
            number, data = self._number, self._data
        return {
            "ended": self.ended, "health": self.health, "unfit": self.unfit, "number": number,
            "result": None if last_number == str(number) else data(),
        }  # fmt: skip


class _Handler(BaseHTTPRequestHandler):
    live_page: LivePage
    protocol_version = "HTTP/1.1"
    timeout = 30  # a browser that takes nothing for so long is let go

    def log_message(self, format: str, *args: Any) -> None:
        """The terminal belongs to the measurement."""

    def handle(self) -> None:
        with suppress(ConnectionError, TimeoutError):
            super().handle()

    def do_GET(self) -> None:
        path, _, words = self.path.partition("?")
        if not self._from_here():
            self._answer(403, "text/plain", b"only pages of this server")
        elif path == "/":
            self._answer(200, "text/html; charset=utf-8", _PAGE_FILE.read_bytes())
        elif path == "/style.css":
            self._answer(200, "text/css; charset=utf-8", _STYLE_FILE.read_bytes())
        elif path == "/image.jpg":
            self._answer(200, "image/jpeg", self.live_page.jpeg())
        elif path in ("/about", "/newest"):
            reply = self.live_page.about() if path == "/about" else self.live_page.newest(words)
            text = json.dumps(reply, allow_nan=False, separators=(",", ":"))
            self._answer(200, "application/json", text.encode())
        else:
            self._answer(404, "text/plain", b"not here")

    def do_POST(self) -> None:
        if not self._from_here():
            self._answer(403, "text/plain", b"only pages of this server")
        elif self.path == "/reference":
            self.live_page.reference()
            self._answer(204, "text/plain", b"")
        else:
            self._answer(404, "text/plain", b"not here")

    def _from_here(self) -> bool:
        """The browser means this server, and no page of another one sent it."""
        hosts = {f"{name}:{self.live_page.port}" for name in (LOOPBACK_HOST, "localhost")}
        origin = self.headers.get("Origin")
        return self.headers.get("Host") in hosts and (
            origin is None or origin.removeprefix("http://") in hosts
        )

    def _answer(self, status: int, kind: str, body: bytes) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(body)


_PAGE_FILE = asset("live.html")
# The sheet of all pages; it is read and nothing is imported, for a robot has no library of pages.
_STYLE_FILE = asset("templates/style.css")
