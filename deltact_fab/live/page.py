"""The live page: a small server on the loopback that shows the newest result to any browser here.

The measurement only leaves its newest result here. Each browser has a thread of its own that takes
whatever is newest when it is ready for more, so one that is slow misses results and stops nobody;
numbers and picture are made ready once for all of them, and only when one asks.
"""

from __future__ import annotations

import json
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

LOOPBACK = "127.0.0.1"
MAX_HZ = 10.0
JPEG_QUALITY = 80
HISTORY = 1200
"""Points of the traces that a browser which comes later is shown."""


@dataclass
class PageResult:
    """One result for the page: its numbers and its picture, made when they are first asked for."""

    data: Callable[[], dict[str, Any]]
    image: Callable[[], NDArray[np.uint8]]

    _lock: threading.Lock = field(default_factory=threading.Lock)

    def json(self) -> str:
        """The numbers, made once."""
        with self._lock:
            return self._json

    def jpeg(self) -> bytes:
        """The picture, made once."""
        with self._lock:
            return self._jpeg

    @cached_property
    def _json(self) -> str:
        return json.dumps(self.data(), allow_nan=False, separators=(",", ":"))

    @cached_property
    def _jpeg(self) -> bytes:
        done, data = cv2.imencode(".jpg", self.image(), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        return data.tobytes() if done else b""


class LivePage:
    """Serves the live page until it is closed.

    reference: called when a browser asks for a new reference. about: what the page says of the
    source, once. Anyone on this computer may look and press the two buttons, and nobody else:
    it listens on the loopback, and answers no page of another origin.
    """

    def __init__(self, about: dict[str, Any], reference: Callable[[], None], port: int = 0) -> None:
        """port: 0 takes a free one. Raises InputError for one that cannot be had."""
        self._about = about
        self._reference = reference
        self._came = threading.Condition()
        self._newest: tuple[int, PageResult] | None = None
        self._trace: deque[tuple[float | None, ...]] = deque(maxlen=HISTORY)
        self._going = threading.Event()
        self._going.set()
        self._ended: str | None = None
        self._health = self._unfit = ""
        self._closed = False
        page = self

        class Handler(_Handler):
            shown = page

        try:
            self._server = ThreadingHTTPServer((LOOPBACK, port), Handler)
        except OSError as why:
            raise InputError(f"--port {port}: {why.strerror}; leave it out for a free one") from why
        self._server.daemon_threads = True
        self.port = int(self._server.server_address[1])
        self.url = f"http://{LOOPBACK}:{self.port}/"
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def show(self, shot: PageResult, point: tuple[float | None, ...]) -> None:
        """Leave a result, and its point of the traces (time, then values). Costs nothing."""
        with self._came:
            self._newest = (self._newest[0] + 1 if self._newest else 0, shot)
            self._trace.append(point)
            self._came.notify_all()

    def going(self, timeout_s: float) -> bool:
        """False while a browser holds the measurement; waits up to timeout_s for its end."""
        return self._going.wait(timeout_s)

    def tell(self, health: str, unfit: str = "") -> None:
        """The sensor's state of health; unfit: why its results are not to be trusted."""
        with self._came:
            self._health, self._unfit = health, unfit
            self._came.notify_all()

    def end(self, why: str) -> None:
        """No more results will come, and why; the page stays."""
        with self._came:
            self._ended = why
            self._came.notify_all()

    def close(self) -> None:
        """Let every browser go and stop listening."""
        with self._came:
            self._closed = True
            self._came.notify_all()
        self._server.shutdown()
        self._server.server_close()

    # What follows is called by the threads of the browsers.

    def about(self) -> str:
        """What a browser is told first, with the traces so far."""
        with self._came:
            return json.dumps({**self._about, "trace": list(self._trace)}, allow_nan=False)

    def state(self) -> dict[str, Any]:
        """Whether the measurement is held or over, and the sensor's health."""
        held = not self._going.is_set()
        return {"paused": held, "ended": self._ended, "health": self._health, "unfit": self._unfit}

    def next(
        self, seen: tuple[int, dict[str, Any]], timeout_s: float
    ) -> tuple[int, PageResult] | None:
        """The newest result that is not `seen`, or None when the state changed or time is up."""
        with self._came:
            self._came.wait_for(
                lambda: (
                    self._closed
                    or self.state() != seen[1]
                    or (self._newest is not None and self._newest[0] != seen[0])
                ),
                timeout_s,
            )
            if self._closed:
                raise ConnectionAbortedError
            return self._newest if self._newest and self._newest[0] != seen[0] else None

    def newest(self) -> PageResult | None:
        """The newest result."""
        with self._came:
            return self._newest[1] if self._newest else None

    def hold(self, held: bool) -> None:
        """Hold the measurement, or let it go on."""
        with self._came:
            (self._going.clear if held else self._going.set)()
            self._came.notify_all()

    def refer(self) -> None:
        """A new reference."""
        self._reference()


class _Handler(BaseHTTPRequestHandler):
    shown: LivePage
    protocol_version = "HTTP/1.1"
    timeout = 30  # a browser that takes nothing for so long is let go

    def log_message(self, format: str, *args: Any) -> None:
        """The terminal belongs to the measurement."""

    def handle(self) -> None:
        with suppress(ConnectionError, TimeoutError):
            super().handle()

    def do_GET(self) -> None:
        path = self.path.partition("?")[0]
        if not self._from_here():
            self._answer(403, "text/plain", b"only pages of this server")
        elif path == "/":
            self._answer(200, "text/html; charset=utf-8", _PAGE.read_bytes())
        elif path == "/about":
            self._answer(200, "application/json", self.shown.about().encode())
        elif path == "/style.css":
            self._answer(200, "text/css; charset=utf-8", _STYLE.read_bytes())
        elif path == "/image.jpg" and (shot := self.shown.newest()) is not None:
            self._answer(200, "image/jpeg", shot.jpeg())
        elif path == "/events":
            self._events()
        else:
            self._answer(404, "text/plain", b"not here")

    def do_POST(self) -> None:
        deeds = {
            "/reference": self.shown.refer,
            "/pause": lambda: self.shown.hold(True),
            "/go": lambda: self.shown.hold(False),
        }
        if not self._from_here():
            self._answer(403, "text/plain", b"only pages of this server")
        elif self.path in deeds:
            deeds[self.path]()
            self._answer(204, "text/plain", b"")
        else:
            self._answer(404, "text/plain", b"not here")

    def _from_here(self) -> bool:
        """The browser means this server, and no page of another one sent it."""
        hosts = {f"{name}:{self.shown.port}" for name in (LOOPBACK, "localhost")}
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

    def _events(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "text/event-stream")
        self.send_header("Cache-Control", "no-store")
        self.send_header("Connection", "close")
        self.end_headers()
        self.close_connection = True
        number, state = -1, dict[str, Any]()
        while True:
            began_s = time.monotonic()
            found = self.shown.next((number, state), 5.0)
            state = self.shown.state()
            lines = [f"event: state\ndata: {json.dumps(state)}\n\n"]
            if found is not None:
                number = found[0]
                lines.append(f"data: {found[1].json()}\n\n")
            self.wfile.write("".join(lines).encode())
            time.sleep(max(0.0, began_s + 1 / MAX_HZ - time.monotonic()))


_PAGE = Path(__file__).parent / "page.html"
# The sheet of all pages; it is read and nothing is imported, for a robot has no library of pages.
_STYLE = Path(__file__).parent.parent / "report" / "templates" / "style.css"
