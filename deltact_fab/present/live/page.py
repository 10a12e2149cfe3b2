"""Live page: a small server on the loopback that shows the newest result to local browsers.

The measurement only stores its newest result here. A browser polls ten times per second in a
thread of its own, so a slow one only misses results; numbers and image are made on request.
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
JPEG_QUALITY = 80  # by hand: size against artefacts
TRACE_POINTS = 1200  # sent to a browser that connects later; by hand: more slow the page down


class LivePage:
    """Server of the live page.

    reference: called when a browser requests a new reference. about: constant facts of the source.
    ended: reason why results ended. health, unfit: the sensor's state of health, and why its
    results are not trusted. Only users of this computer can view and request a reference: it
    listens on the loopback, and rejects pages of other origins.
    """

    def __init__(self, about: dict[str, Any], reference: Callable[[], None], port: int = 0) -> None:
        """port: 0 for a free one. Raises InputError for an unavailable one."""
        self._about, self._lock = about, threading.Lock()
        self._trace: deque[tuple[float | None, ...]] = deque(maxlen=TRACE_POINTS)
        self._number, self._data = -1, cache(dict[str, Any])
        self.jpeg: Callable[[], bytes] = bytes
        """Encode the newest picture."""
        self.ended: str | None = None
        self.health = self.unfit = ""
        self.reference = reference
        page = self

        class Handler(_Handler):
            live_page = page

        try:
            self._server = ThreadingHTTPServer((LOOPBACK_HOST, port), Handler)
        except OSError as error:
            text = f"--port {port}: {error.strerror}; omit --port for a free one"
            raise InputError(text) from error
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
        """Store a result: its numbers, its image, its point of the traces (time, then values)."""

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
        """Return the facts for a new browser, with the traces so far."""
        with self._lock:
            return {**self._about, "trace": list(self._trace)}

    def newest(self, last_number: str) -> dict[str, Any]:
        """Return the news for a browser whose last result has that number."""
        with self._lock:
            number, data = self._number, self._data
        return {
            "ended": self.ended, "health": self.health, "unfit": self.unfit, "number": number,
            "result": None if last_number == str(number) else data(),
        }  # fmt: skip


class _Handler(BaseHTTPRequestHandler):
    live_page: LivePage
    protocol_version = "HTTP/1.1"
    timeout = 30  # s, by hand: drops a browser that reads nothing

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing: the terminal belongs to the measurement."""

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
        """True if the request is for this server and from no other server's page."""
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
# Style of all pages, read without importing their library, which a robot lacks.
_STYLE_FILE = asset("templates/style.css")
