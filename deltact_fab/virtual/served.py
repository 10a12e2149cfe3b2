"""A rig file's devices on this computer's own wires, for a host that knows of no simulator.

The controller stands behind a pseudo terminal, the force sensor behind sockets, the camera is a
command that shows images of the face at rest. What presses on the face is felt by closed forms
(`bench_face`), and nothing of it is seen: this is for rig files, drivers and hands; `run --rig
virtual` is for experiments.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..aliases import Vector
from ..catalog import as_toml, write_new
from ..elasticity import GelMaterial
from ..files import making, write_whole
from ..optics import as_toml as camera_toml
from ..patterns.recipe import PatternRecipe
from ..record import encode_png
from ..rig.config import RigConfig
from ..rig.interface import WallClock
from ..rig.simulator import SimulatorConfig
from ..rig.tables import ForceConfig
from ..shapes import SensorDimensions
from .bench_face import BenchFace
from .controller import GrblController
from .drawing import printed, resting
from .netft_server import NetFTServer
from .pty import PtyCable

RIG, CAMERA, IMAGES = "rig.toml", "camera.toml", "images"
RATE_HZ = 10.0
SILENT_S = 1.0  # a busy computer keeps the simulated box from running for a while


@contextmanager
def served(
    rig: RigConfig,
    design: SensorDimensions,
    recipe: PatternRecipe,
    indenter: str,
    folder: Path,
    images: int = 20,
    seed: int = 0,
) -> Iterator[Path]:
    """The rig file of the simulated devices, in a new folder, while the context lasts.

    indenter: the one that is mounted. images: of the face at rest. Raises InputError for a firmware
    that no board simulates and a folder that is there already, OSError where no socket can be had.
    """
    simulator = rig.virtual if rig.kind == "virtual" else SimulatorConfig()
    clock, mount = WallClock(), simulator.mount
    board = GrblController.of(rig.stage, clock)
    frame = rig.stage.frame
    x, y, z = (a + b for a, b in zip(frame.origin_machine_mm, mount.offset_mm, strict=True))
    true = replace(frame, origin_machine_mm=(x, y, z), tilt_deg=mount.tilt_deg)
    face = BenchFace(true, design.skin, GelMaterial())
    face.mount(indenter, mount.longer_mm.get(indenter, 0.0))
    force = rig.force or ForceConfig()
    with making(folder):
        (folder / IMAGES).mkdir(parents=True)
    geometry, rng = resting(design), np.random.default_rng(seed)
    write_new(folder / CAMERA, camera_toml(geometry.camera))
    draw = printed(simulator, recipe, geometry, seed)
    for k in range(images):
        image = draw.render(None, rng)
        write_whole(folder / IMAGES / f"{k:05d}.png", encode_png(image))
    with PtyCable(board, clock) as terminal:

        def wrenches(t_ns: Any) -> Any:
            with terminal.lock:
                at: list[Vector] = [board.position_mm(t / 1e9) for t in t_ns.tolist()]
            return np.reshape([face.wrench(p) for p in at], (-1, 6))

        noise_n = simulator.force.noise_n
        with NetFTServer(wrenches, force, seed=seed, noise_n=noise_n, serial="simulated") as box:
            file = folder / RIG
            write_new(file, _text(rig, force, terminal.port, box, image.shape))
            yield file


def _text(
    rig: RigConfig, force: ForceConfig, port: str, box: NetFTServer, shape: tuple[int, ...]
) -> str:
    """The rig file that a lab would write for these devices."""
    told = rig.model_dump(mode="json", exclude_unset=True, exclude={"virtual", "kind", "camera"})
    told["stage"]["port"] = port
    told["stage"].pop("registration", None)
    kept = force.model_dump(mode="json", exclude_unset=True, exclude={"serial", "netft"})
    way = {"host": box.host, "rdt_port": box.rdt_port, "http_port": box.http_port}
    netft = {**way, "silent_s": SILENT_S}
    told["force"] = {**kept, "netft": netft}
    shows = [sys.executable, "-m", "deltact_fab.virtual.shown", IMAGES, f"{RATE_HZ:g}"]
    told["camera"] = {
        "command": shows, "stamped": True, "width_px": shape[1], "height_px": shape[0],
        "rate_hz": RATE_HZ, "model": CAMERA,
    }  # fmt: skip
    if rig.touch is not None:
        told["touch"] = rig.touch.model_dump(mode="json", exclude_none=True)
    about = ("Simulated devices, while `rig simulate` runs.",)
    return as_toml({"kind": "grbl", "served": True, **told}, about)
