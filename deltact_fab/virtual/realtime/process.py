"""What runs in a separate process: everything below the wire, and the mounting of indenters.

`main` reads a rig's settings and a job from its standard input, answers with a GrblConfig or an
error, then answers one request after the other until its input ends. Whatever else the host wants
to know it reads from the wires.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

from ...elasticity import GelMaterial
from ...errors import DeltactFabError
from ...optics import StageFrame
from ...rig.camera.config import CameraConfig
from ...rig.config import GrblConfig, VirtualConfig
from ...rig.force.config import NetFTConfig
from ...rig.job import RigSetup
from ..backend import Below
from ..bench_face import BenchFace
from ..clock import VirtualClock
from ..devices import TruthWriter
from ..netft_server import NetFTServer
from ..pty import PtyCable
from ..scene import Observation
from .scene import LiveCamera, LiveScene


class LiveClock(VirtualClock):
    """Stands still between two calls of `catch_up`; its origin is that of `time.monotonic`."""

    def __init__(self) -> None:
        super().__init__()
        self.catch_up()

    def catch_up(self) -> None:
        """Let the time pass that has passed."""
        self.advance_to_ns(time.monotonic_ns())


HOST = "127.0.0.1"
# The camera shares this computer's processors with all that runs on it: what would be a fault of a
# real one is not one yet.
PATIENT = 10.0  # times the period of the images
NEAR_MM = 0.3  # as far as a touch-off may be off and the press still be the planned one
SWITCH_S = 0.0005  # a thread that draws lets the others have their turn sooner


class LiveBench:
    """The devices, and the hands that mount an indenter under them."""

    def __init__(self, config: VirtualConfig, job: RigSetup, open_: ExitStack) -> None:
        self._config, self._job = config, job
        self._lock = threading.RLock()
        self.clock = LiveClock()
        self._below = below = Below(config, job, self.clock, LiveScene)
        assert isinstance(below.scene, LiveScene)
        self.scene = below.scene
        self.scene.near_mm = NEAR_MM
        self._face, self._true = self._bench_face()
        self.scene.felt = self._face.wrench
        self.camera: LiveCamera | None = None
        folder = Path(open_.enter_context(tempfile.TemporaryDirectory(prefix="deltact-fab-")))
        if below.crop is not None:
            picture, lens = below.picture()
            self._truth = TruthWriter(job.folder, self.scene, below.crop.lattice, lens)
            rate_hz = config.virtual.realtime.camera_rate_hz
            self._size_px = picture.geometry.size_px
            self.camera = LiveCamera(picture, self._look, folder / "images", rate_hz, job.seed)
        self._force = open_.enter_context(
            NetFTServer(
                self._wrenches,
                config.force,
                seed=job.seed,
                noise_n=config.virtual.force.noise_n,
                serial="simulated",
            )
        )
        terminal = open_.enter_context(
            PtyCable(below.controller, self.clock, lock=self._lock, passing=self.clock.catch_up)
        )
        self.rig = self._rig_file(terminal.port, folder / "images")

    def _rig_file(self, port: str, images: Path) -> GrblConfig:
        """The rig file that a lab would write for these devices."""
        config = self._config
        netft = NetFTConfig(
            host=HOST, rdt_port=self._force.rdt_port, http_port=self._force.http_port
        )
        camera = None
        if self.camera is not None:
            camera = CameraConfig(
                command=("cat", str(images)),
                stamped=True,
                width_px=self._size_px[0],
                height_px=self._size_px[1],
                rate_hz=config.virtual.realtime.camera_rate_hz / PATIENT,
            )
        return GrblConfig(
            kind="grbl",
            stage=config.stage.model_copy(update={"port": port}),
            force=config.force.model_copy(update={"netft": netft}),
            camera=camera,
            guard=config.guard,
            touch=config.touch,
            tools=config.tools,
        )

    def answer(self, what: str, told: Mapping[str, Any]) -> Any:
        """One request of the host. Raises DeltactFabError."""
        return getattr(self, f"_do_{what}")(**told)

    def _bench_face(self) -> tuple[BenchFace, StageFrame]:
        """What is felt where no press has begun, and where the face truly is."""
        mount, frame = self._config.virtual.mount, self._config.stage.frame
        x, y, z = (a + b for a, b in zip(frame.origin_machine_mm, mount.offset_mm, strict=True))
        true = replace(frame, origin_machine_mm=(x, y, z), tilt_deg=mount.tilt_deg)
        specimen = self._job.protocol.specimen
        material = GelMaterial(specimen.modulus_mpa, specimen.poisson)
        return BenchFace(true, self._job.sensor.skin, material), true

    def _do_mount(self, indenter: str) -> None:
        longer_mm = self._config.virtual.mount.longer_mm.get(indenter, 0.0)
        x, y, z = self._true.origin_machine_mm
        with self._lock:
            self.clock.catch_up()
            self.scene.mount(indenter)
            self.scene.set_frame(replace(self._true, origin_machine_mm=(x, y, z + longer_mm)))
            self._face.mount(indenter, longer_mm)

    def _do_begin(self, press: str) -> None:
        """A press by its name; other streams of a camera do not concern the gel."""
        presses = self._below.presses
        path = next((path for path in presses.paths if path.press == press), None)
        if path is None or not presses.observed:
            return
        found = presses.of(path)  # read from the disk while the others go on
        with self._lock:
            self.clock.catch_up()
            self.scene.observe()
            self.scene.take(found)
        if self.camera is not None:
            self.camera.begin()

    def _do_end(self, press: str, frames: Mapping[str, float]) -> None:
        if self.camera is not None:
            self.camera.keep(self._truth, press, frames)

    def _do_about(self) -> dict[str, Any]:
        """What the summary keeps."""
        drawn = self.camera.drawn if self.camera is not None else 0
        return {
            "left_out": self._below.left_out(),
            "notes": self._below.notes(),
            "seen_s": self.camera.seen_s if self.camera is not None else 0.0,
            "guessed": self.scene.guessed,
            "drawn": drawn,
            "draw_s": self.camera.seconds / max(drawn, 1) if self.camera is not None else 0.0,
        }

    def _do_carriage(self, t_s: list[float]) -> list[tuple[float, float, float]]:
        """Where the carriage was, machine mm: to judge how good the record is."""
        with self._lock:
            self.clock.catch_up()
            return [self._below.controller.position_mm(t) for t in t_s]

    def _look(self) -> tuple[int, Observation]:
        with self._lock:
            self.clock.catch_up()
            return self.clock.now_ns(), self.scene.observe()

    def _wrenches(self, t_ns: Any) -> Any:
        with self._lock:
            self.clock.catch_up()
            return self.scene.wrenches(t_ns)


def serve(asked: BinaryIO, answers: BinaryIO) -> None:
    """Build the requested bench, then answer until `asked` ends."""
    with ExitStack() as open_:
        try:
            config, job = pickle.load(asked)
            bench = LiveBench(config, job, open_)
        except DeltactFabError as why:
            _say(answers, why)
            return
        _say(answers, bench.rig)
        while True:
            try:
                what, told = pickle.load(asked)
            except EOFError:
                return  # the host is gone, or has had enough
            try:
                _say(answers, bench.answer(what, told))
            except (DeltactFabError, KeyError, ValueError) as why:
                _say(answers, why)


def _say(answers: BinaryIO, what: object) -> None:
    pickle.dump(what, answers)
    answers.flush()


def main() -> None:
    """Signals are the host's to answer: this process ends when it does."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    sys.setswitchinterval(SWITCH_S)
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever is printed is no answer
    try:
        serve(sys.stdin.buffer, answers)
    except BrokenPipeError:
        pass
    finally:
        os._exit(0)  # threads that wait for a reader have nothing to finish
