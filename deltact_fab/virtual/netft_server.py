"""The simulated Net F/T box on real sockets, at the wall clock: UDP records, the page over HTTP."""

from __future__ import annotations

import select
import socket
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from http.server import BaseHTTPRequestHandler, HTTPServer

from ..rig.config import ForceConfig
from .clock import VirtualClock
from .netft import BoxFaults, NetFTBox, Wrenches

WAKE_S = 0.05  # how long a command or the end of the server may wait at most


class NetFTServer(AbstractContextManager["NetFTServer"]):
    """A box over any wrench function, served until `close`. Ports are chosen by the system.

    wrenches: forces (N) and torques (N mm) on the sensor (n, 6) at times (n,) ns of the monotonic
    clock; called from the server's thread. sent: told of every record with the time (ns) just
    before it was sent. serial: of the transducer. Raises OSError where no socket can be had.
    """

    def __init__(
        self,
        wrenches: Wrenches,
        config: ForceConfig | None = None,
        *,
        seed: int = 0,
        noise_n: float = 0.0,
        serial: str = "FT00001",
        host: str = "127.0.0.1",
        sent: Callable[[bytes, int], None] | None = None,
    ) -> None:
        self._clock = VirtualClock()
        self._clock.advance_to_ns(time.monotonic_ns())
        self._box = NetFTBox(config or ForceConfig(), self._clock, seed, wrenches, noise_n)
        self._sent = sent
        self.path = "/netftapi2.xml"
        self.page = _page(self._box, serial)
        """What the page shows; may be changed at any time."""
        self.host = host
        self._done = threading.Event()
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._udp.bind((host, 0))
            self._udp.setblocking(False)
            server = self

            class BoxPageHandler(BaseHTTPRequestHandler):
                def do_GET(self) -> None:
                    server._answer(self)

                def log_message(self, format: str, *args: object) -> None:
                    """Nothing is printed."""

            self._http = HTTPServer((host, 0), BoxPageHandler)
        except OSError:
            self._udp.close()
            raise
        self.rdt_port: int = self._udp.getsockname()[1]
        self.http_port: int = self._http.server_address[1]
        self._threads = [
            threading.Thread(target=self._stream, name="netft-rdt"),
            threading.Thread(target=self._http.serve_forever, args=(WAKE_S,), name="netft-http"),
        ]
        for thread in self._threads:
            thread.start()

    @property
    def faults(self) -> BoxFaults:
        return self._box.faults

    def close(self) -> None:
        """End both threads and close the sockets; again does nothing."""
        if self._done.is_set():
            return
        self._done.set()
        self._http.shutdown()
        for thread in self._threads:
            thread.join()
        self._http.server_close()
        self._udp.close()

    def __exit__(self, *error: object) -> None:
        self.close()

    def _stream(self) -> None:
        """The one thread that the box belongs to."""
        client: tuple[str, int] | None = None
        udp, box, clock = self._udp, self._box, self._clock
        while not self._done.is_set():
            now_ns = time.monotonic_ns()
            wait_s = (box.next_ns(now_ns + 10**9) - now_ns) / 1e9
            ready = select.select([udp], [], [], min(max(wait_s, 0.0), WAKE_S))[0]
            clock.advance_to_ns(time.monotonic_ns())
            if ready:
                command, client = udp.recvfrom(64)
                box.send(command)
            while client is not None and (data := box.due()) is not None:
                if self._sent is not None:
                    self._sent(data.payload, time.monotonic_ns())
                try:
                    udp.sendto(data.payload, client)
                except OSError:
                    break  # nobody is there, or its buffer is full: as on a wire, it is lost

    def _answer(self, request: BaseHTTPRequestHandler) -> None:
        if request.path.partition("?")[0] != self.path:
            request.send_error(404)
            return
        lines = "\n".join(f"<{name}>{value}</{name}>" for name, value in self.page.items())
        body = f'<?xml version="1.0"?><netft>\n{lines}\n</netft>\n'.encode("ascii")
        request.send_response(200)
        request.send_header("Content-Type", "text/xml")
        request.send_header("Content-Length", str(len(body)))
        request.end_headers()
        request.wfile.write(body)


def _page(box: NetFTBox, serial: str) -> dict[str, str]:
    """The elements of a box's page: `cfgcalsn` is the transducer's number, `mfgdigsn` the box's."""
    settings = box.settings()
    return {
        "prodname": "Simulated Net F/T",
        "runstat": "0x00000000",
        "cfgcalsn": serial,
        "scfgfu": "N",
        "scfgtu": "Nmm",
        "cfgcpf": f"{settings.counts_per_n:.0f}",
        "cfgcpt": f"{settings.counts_per_nmm:.0f}",
        "cfgmr": ";".join(f"{value:g}" for value in box.limits.tolist()),
        "comrdte": "Enabled",
        "comrdtrate": f"{settings.rate_hz:.0f}",
        "comrdtbsiz": "1",
        "mfgdigsn": "SIM1",
        "mfgdigver": "2.2.59",
    }
