"""A bench on the wall clock from real parts: a terminal, UDP and HTTP, a camera's process."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
from board import Board, board
from numpy.typing import NDArray

from deltact_fab.bench.protocols import plan
from deltact_fab.bench.protocols.plan import Step
from deltact_fab.bench.record.writer import RunWriter
from deltact_fab.bench.rig.camera.model import open_camera
from deltact_fab.bench.rig.force.guard import ForceGuard, GuardLimits
from deltact_fab.bench.rig.force.watchdog import open_force
from deltact_fab.bench.rig.interface import Devices, WallClock
from deltact_fab.bench.rig.run.runner import Runner
from deltact_fab.bench.rig.stage.grbl import GrblStage
from deltact_fab.bench.rig.tables import CameraConfig, ForceConfig, GuardConfig, NetFTConfig
from deltact_fab.bench.rig.tool.tooling import home_safely
from deltact_fab.sensor.optics.camera import StageFrame
from deltact_fab.simulate.virtual.served import NetFTServer

ORIGIN_MM = (-30.0, -30.0, -20.0)
N_PER_MM = 2.0  # of depth
# A camera: stamped images of noise, 60 a second, while there is no file `stall` in its folder; the
# file `skip` has it leave out as many numbers as it says, once.
CAMERA = """
import os, struct, sys, time
import numpy as np
rng, number = np.random.default_rng(0), 0
started = time.monotonic_ns()
while True:
    if os.path.exists("stall"):
        time.sleep(0.05)
        continue
    if os.path.exists("skip"):
        number += int(open("skip").read())
        os.remove("skip")
    image = rng.integers(0, 256, (48, 64, 3), dtype=np.uint8)
    head = struct.pack("<qII", time.monotonic_ns(), number, 0)
    sys.stdout.buffer.write(head + image.tobytes())
    sys.stdout.buffer.flush()
    number += 1
    time.sleep(max(0.0, (started + number * 16_666_667 - time.monotonic_ns()) / 1e9))
"""
PROTOCOL = """
name = "short"
indenters = ["sphere:6"]
positions_mm = [[0.0, 0.0], [1.0, 0.0]]
depths_mm = [1.0]
channels = ["image", "force"]
[capture]
rate_hz = 20.0
settle_s = 0.1
[motion]
clearance_mm = 3.0
park_mm = 6.0
travel_feed_mm_min = 600.0
press_feed_mm_min = 90.0
"""
META = {"name": "r", "simulated": False, "camera": None}


class WallBench:
    """folder: of the run and of the camera. fx of the force is a sine of time, fz follows depth."""

    def __init__(self, folder: Path, it: Board, server: NetFTServer, devices: Devices) -> None:
        self.folder = folder
        self.board = it
        self.server = server
        self.devices = devices
        (folder / "p.toml").write_text(PROTOCOL)
        self.protocol = plan.load_protocol(str(folder / "p.toml"))[0]
        self.steps: Sequence[Step] = plan.expand_protocol(self.protocol)

    def writer(self, **rig: object) -> RunWriter:
        """Of the run, new or taken up."""
        out = self.folder / "r"
        if out.exists():
            return RunWriter.resume(out, self.steps)
        meta = {**META, "protocol": self.protocol.model_dump(mode="json"), "rig": rig}
        meta["protocol"]["channels"] = sorted(self.protocol.channels)
        return RunWriter.create(out, meta, b"", {"dots_mm": [], "dot_diameter_mm": 0.0}, self.steps)

    def run(self, writer: RunWriter, **more: object) -> int:
        """All of it; the writer is let go of in any case."""
        try:
            return Runner(self.devices, writer, **more).run(self.steps)  # type: ignore[arg-type]
        finally:
            writer.abandon()

    def home(self) -> str:
        """As `rig home` does, on the operator's word."""
        d = self.devices
        d.stage.connect()
        return home_safely(d.stage, d.clock, d.force, d.guard, None, tip_is_clear=True)


def sine_n(t_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """What fx is at times of the monotonic clock."""
    return 0.5 * np.sin(2 * np.pi * np.asarray(t_s))


@contextmanager
def wall_bench(
    folder: Path,
    guard_n: float = 20.0,
    behind_s: float = 2.0,
    silent_s: float = 1.0,
    camera: bool = True,
) -> Iterator[WallBench]:
    """All devices open; closed at the end, in good order, whatever the run came to."""
    with ExitStack() as held:
        it = held.enter_context(board())

        def wrenches(t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
            out = np.zeros((len(t_ns), 6))
            out[:, 0] = sine_n(t_ns / 1e9)
            out[:, 2] = -N_PER_MM * max(ORIGIN_MM[2] - it.at_mm()[2], 0.0)
            return out

        config = ForceConfig(rate_hz=500.0)
        server = held.enter_context(NetFTServer(wrenches, config))
        clock = WallClock()
        stage = GrblStage(it.port, clock, StageFrame(ORIGIN_MM))
        held.callback(stage.close)
        net = NetFTConfig(
            host=server.host, rdt_port=server.rdt_port, http_port=server.http_port,
            silent_s=silent_s,
        )  # fmt: skip
        # The box is in this process: on a busy machine it may be kept from running for a while.
        force = open_force(config.model_copy(update={"netft": net}), clock)
        held.callback(force.close)
        seeing = None
        if camera:
            (folder / "camera.py").write_text(CAMERA)
            seen = CameraConfig(
                command=(sys.executable, "camera.py"), stamped=True,
                width_px=64, height_px=48, rate_hz=60.0,
            )  # fmt: skip
            seeing = open_camera(seen, folder, clock)
            held.callback(seeing.close)
            seeing.timeout_s = 3.0  # type: ignore[attr-defined] # the camera's process, too
        limits = GuardLimits.from_config(GuardConfig(force_n=guard_n), config)
        guard = ForceGuard(stage.cancel, limits, clock, behind_s)
        devices = Devices(
            clock, stage, seeing, force, lambda name: None, guard, contact_n=1.0, wall_clock=True
        )
        yield WallBench(folder, it, server, devices)
