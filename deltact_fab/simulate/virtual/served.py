"""A rig file's devices on this computer's own wires, for a host that knows of no simulator.

The controller stands behind a pseudo terminal, the force sensor behind sockets, the camera is a
command that shows images of the face at rest. What presses on the face is felt by closed forms
(`bench_face`), and nothing of it is seen. The Net F/T box is that of the virtual rig, at the wall
clock: records over UDP, the page over HTTP.
"""

from __future__ import annotations

import select
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.bench import ForceConfig, RigConfig, SimulatorConfig, WallClock, encode_png
from deltact_fab.common import Point, disk_errors, toml_text, write_new_file, write_whole
from deltact_fab.fabricate import PatternRecipe
from deltact_fab.sensor import SensorDimensions, camera_toml

from .bench_face import BenchFace
from .clock import VirtualClock
from .controller import GrblController
from .netft import RDT_COMMAND, BoxFaults, NetFTBox, Wrenches
from .picture import FrameRenderer, PictureGeometry
from .pty import PtyCable

POLL_S = 0.05  # by hand: longest delay of a command or of the end of the server
RIG_FILE, CAMERA_FILE, IMAGE_FOLDER = "rig.toml", "camera.toml", "images"
# By hand: images at rest, their rate, and a silence that a busy computer does not reach.
IMAGE_COUNT = 20
FRAME_HZ = 10.0
SILENCE_LIMIT_S = 1.0


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
        on_send: Callable[[bytes, int], None] | None = None,
    ) -> None:
        self._clock = VirtualClock()
        self._clock.advance_to_ns(time.monotonic_ns())
        self._box = NetFTBox(config or ForceConfig(), self._clock, seed, wrenches, noise_n)
        self._on_send = on_send
        self.path = "/netftapi2.xml"
        self.page = _page(self._box, serial)
        """What the page shows; may be changed at any time."""
        self.host = "127.0.0.1"
        self._stop = threading.Event()
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._udp.bind((self.host, 0))
            self._udp.setblocking(False)
            server = self

            class BoxPageHandler(BaseHTTPRequestHandler):
                timeout = SILENCE_LIMIT_S

                def do_GET(self) -> None:
                    server._answer(self)

                def log_message(self, format: str, *args: object) -> None:
                    """Nothing is printed."""

            self._http = ThreadingHTTPServer((self.host, 0), BoxPageHandler)
        except OSError:
            self._udp.close()
            raise
        self.rdt_port: int = self._udp.getsockname()[1]
        self.http_port: int = self._http.server_address[1]
        self._threads = [
            threading.Thread(target=self._stream, name="netft-rdt"),
            threading.Thread(target=self._http.serve_forever, args=(POLL_S,), name="netft-http"),
        ]
        for thread in self._threads:
            thread.start()

    @property
    def faults(self) -> BoxFaults:
        return self._box.faults

    def close(self) -> None:
        """End both threads and close the sockets; again does nothing."""
        if self._stop.is_set():
            return
        self._stop.set()
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
        while not self._stop.is_set():
            now_ns = time.monotonic_ns()
            wait_s = (box.next_ns(now_ns + 10**9) - now_ns) / 1e9
            ready = select.select([udp], [], [], min(max(wait_s, 0.0), POLL_S))[0]
            clock.advance_to_ns(time.monotonic_ns())
            if ready:
                command, sender = udp.recvfrom(64)
                if len(command) == RDT_COMMAND.size:  # no STUN, which any web page can send
                    client = sender
                box.send(command)
            while client is not None and (data := box.pop_due()) is not None:
                if self._on_send is not None:
                    self._on_send(data.payload, time.monotonic_ns())
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


@contextmanager
def serve_rig(
    rig: RigConfig,
    design: SensorDimensions,
    recipe: PatternRecipe,
    indenter: str,
    folder: Path,
    seed: int = 0,
) -> Iterator[Path]:
    """Serve simulated devices while the context lasts; their rig file, in a new folder.

    indenter: the one that is mounted. Raises InputError for a firmware that no board simulates and
    a folder that is there already, OSError where no socket can be had.
    """
    simulator = rig.virtual if rig.kind == "virtual" else SimulatorConfig()
    clock, mount = WallClock(), simulator.mount
    board = GrblController.for_stage(rig.stage, clock)
    frame = rig.stage.frame
    x, y, z = (a + b for a, b in zip(frame.origin_machine_mm, mount.offset_mm, strict=True))
    true = replace(frame, origin_machine_mm=(x, y, z), tilt_deg=mount.tilt_deg)
    face = BenchFace(true, design.skin)
    face.mount(indenter, mount.longer_mm.get(indenter, 0.0))
    force = rig.force or ForceConfig()
    with disk_errors(folder, "made"):
        (folder / IMAGE_FOLDER).mkdir(parents=True)
    geometry, rng = PictureGeometry.resting(design), np.random.default_rng(seed)
    write_new_file(folder / CAMERA_FILE, camera_toml(geometry.camera))
    draw = FrameRenderer.printed(geometry, simulator, recipe, seed)
    for k in range(IMAGE_COUNT):
        image = draw.render(None, rng)
        write_whole(folder / IMAGE_FOLDER / f"{k:05d}.png", encode_png(image))
    with PtyCable(board, clock) as terminal:

        def wrenches(t_ns: Any) -> Any:
            with terminal.lock:
                positions_mm: list[Point] = [board.position_mm(t / 1e9) for t in t_ns.tolist()]
            return np.reshape([face.wrench(p) for p in positions_mm], (-1, 6))

        noise_n = simulator.force.noise_n
        with NetFTServer(wrenches, force, seed=seed, noise_n=noise_n, serial="simulated") as box:
            file = folder / RIG_FILE
            write_new_file(file, _rig_text(rig, force, terminal.port, box, image.shape))
            yield file


def _rig_text(
    rig: RigConfig, force: ForceConfig, port: str, box: NetFTServer, shape: tuple[int, ...]
) -> str:
    """The rig file that a lab would write for these devices."""
    tables = rig.model_dump(mode="json", exclude_unset=True, exclude={"virtual", "kind", "camera"})
    tables["stage"]["port"] = port
    tables["stage"].pop("registration", None)
    force_table = force.model_dump(mode="json", exclude_unset=True, exclude={"serial", "netft"})
    address = {"host": box.host, "rdt_port": box.rdt_port, "http_port": box.http_port}
    netft = {**address, "silent_s": SILENCE_LIMIT_S}
    tables["force"] = {**force_table, "netft": netft}
    module, rate = "deltact_fab.simulate.virtual.shown", f"{FRAME_HZ:g}"
    tables["camera"] = {
        "command": [sys.executable, "-m", module, IMAGE_FOLDER, rate],
        "stamped": True, "width_px": shape[1], "height_px": shape[0],
        "rate_hz": FRAME_HZ, "model": CAMERA_FILE,
    }  # fmt: skip
    if rig.touch is not None:
        tables["touch"] = rig.touch.model_dump(mode="json", exclude_none=True)
    about = ("Simulated devices, while `rig simulate` runs.",)
    return toml_text({"kind": "grbl", "served": True, **tables}, about)
