"""Live page: a small server on the loopback that shows the newest result to local browsers.

The measurement only stores its newest result here. A browser polls ten times per second in a
thread of its own, so a slow one only misses results; numbers and image are made on request.
Each connection carries one request of limited length and time, and nothing after its headers is
read. Pages of other origins get nothing: a request needs the random token of the printed address.
"""

from __future__ import annotations

import hmac
import json
import secrets
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from io import BytesIO
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import InputError
from deltact_fab.paths import asset

LOOPBACK_HOST = "127.0.0.1"
JPEG_QUALITY = 80  # by hand: size against artefacts
TRACE_POINTS = 1200  # sent to a browser that connects later; by hand: more slow the page down
# By hand: ten browsers of six connections; a browser's request has 1 kB and takes milliseconds,
# its answer of up to a megabyte longer in a slow tunnel.
THREAD_LIMIT = 64
REQUEST_LIMIT_BYTES, REQUEST_LIMIT_S, ANSWER_LIMIT_S = 16384, 5.0, 30.0


class LivePage:
    """Server of the live page.

    reference: called when a browser requests a new reference. about: constant facts of the source.
    ended: reason why results ended. health, unfit: the sensor's state of health, and why its
    results are not trusted. url: address, whose token is needed to view or request anything.
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
        self.token = secrets.token_urlsafe()
        try:
            self._server = _PageServer(self, port)
        except OSError as error:
            text = f"--port {port}: {error.strerror}; omit --port for a free one"
            raise InputError(text) from error
        self.port = int(self._server.server_address[1])
        self.url = f"http://{LOOPBACK_HOST}:{self.port}/{self.token}/"
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


class _PageServer(ThreadingHTTPServer):
    """Server of one page; closes a connection at once where threads are many."""

    request_queue_size = THREAD_LIMIT

    def __init__(self, page: LivePage, port: int) -> None:
        self.page = page
        super().__init__((LOOPBACK_HOST, port), _PageHandler)

    def verify_request(self, request: Any, client_address: Any) -> bool:
        return threading.active_count() < THREAD_LIMIT


class _PageHandler(BaseHTTPRequestHandler):
    server: _PageServer

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing: the terminal belongs to the measurement."""

    def handle(self) -> None:
        """Answer one request; nothing more is received, and the connection is closed."""
        with suppress(BlockingIOError, ConnectionError, TimeoutError):
            head = self._read_head()
            self.rfile.close()
            self.rfile = BytesIO(head)
            self.handle_one_request()

    def _read_head(self) -> bytes:
        """Receive request line and headers; empty if they are too long or incomplete."""
        head, end_s = b"", time.monotonic() + REQUEST_LIMIT_S
        while b"\r\n\r\n" not in head:
            self.connection.settimeout(max(end_s - time.monotonic(), 0))
            part = self.connection.recv(REQUEST_LIMIT_BYTES - len(head))
            if not part:
                return b""
            head += part
        self.connection.settimeout(ANSWER_LIMIT_S)
        return head

    def parse_request(self) -> bool:
        """Parse a request and leave its path below the token; refuse it and return False if bad."""
        if not super().parse_request():
            return False
        token, _, self.path = self.path.removeprefix("/").partition("/")
        valid = hmac.compare_digest(token.encode(), self.server.page.token.encode())
        if not (valid and self._has_own_headers()):
            self._answer(403, "text/plain", b"open the whole address that was printed")
            return False
        return True

    def _has_own_headers(self) -> bool:
        """True for a request without a body to this server, by its own page or by a person."""
        # A link to the page may be on any other, such as a terminal in a browser.
        link = self.headers["Sec-Fetch-Dest"] == "document"
        port, posts = self.server.page.port, self.command == "POST"
        allowed = {
            "Host": [f"{name}:{port}" for name in (LOOPBACK_HOST, "localhost")],
            "Origin": [f"http://{self.headers['Host']}", *[""] * (not posts)],
            "Sec-Fetch-Site": ["", "none", "same-origin", *["same-site", "cross-site"] * link],
            "Content-Length": ["", "0"],
            "Transfer-Encoding": [""],
        }
        return all(", ".join(self.headers.get_all(k, [])) in allowed[k] for k in allowed)

    def do_GET(self) -> None:
        page, (path, _, last_number) = self.server.page, self.path.partition("?")
        if path in _PAGE_FILES:
            kind, name = _PAGE_FILES[path]
            self._answer(200, f"text/{kind}; charset=utf-8", asset(name).read_bytes())
        elif path == "image.jpg":
            self._answer(200, "image/jpeg", page.jpeg())
        elif path in ("about", "newest"):
            reply = page.about() if path == "about" else page.newest(last_number)
            text = json.dumps(reply, allow_nan=False, separators=(",", ":"))
            self._answer(200, "application/json", text.encode())
        else:
            self.send_error(404)

    def do_POST(self) -> None:
        if self.path == "reference":
            self.server.page.reference()
            self._answer(204, "text/plain", b"")
        else:
            self.send_error(404)

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Answer without a text: the inherited one quotes the request."""
        self._answer(code, "text/plain", b"")

    def _answer(self, status: int, kind: str, body: bytes) -> None:
        self.send_response_only(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        for name, value in _SAFE_HEADERS.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)


# The style of all pages is read without importing their library, which a robot lacks.
_PAGE_FILES = {
    "": ("html", "live.html"), "live.css": ("css", "live.css"),
    "live.js": ("javascript", "live.js"), "style.css": ("css", "templates/style.css"),
}  # fmt: skip
# The page loads its own files, nothing else; no page frames it, embeds its files or opens it.
_SAFE_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
        "img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
