"""What every stage, camera, force sensor and rig keeps to, whichever it is.

A class of the package that has all methods of an interface and no case here fails the first test.
"""

from __future__ import annotations

import importlib
import inspect
import itertools
import json
import math
import pkgutil
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scale_on_pty import scale
from served import powered, rig_file

import deltact_fab
from deltact_fab.errors import DeltactFabError, InputError, RunFailed, SensorError
from deltact_fab.experiment import kind_of
from deltact_fab.patterns.recipe import load_recipe
from deltact_fab.protocols import plan
from deltact_fab.rig import config
from deltact_fab.rig.camera.config import CameraConfig
from deltact_fab.rig.camera.open import open_camera
from deltact_fab.rig.clock import WallClock
from deltact_fab.rig.config import ForceConfig
from deltact_fab.rig.force.config import NetFTConfig
from deltact_fab.rig.force.guard import GuardLimits
from deltact_fab.rig.force.open import open_force
from deltact_fab.rig.force.watchdog import Watchdog
from deltact_fab.rig.interface import Camera, Clock, ForceSensor, Stage
from deltact_fab.rig.job import Devices, Rig, RigSetup
from deltact_fab.shapes import SensorDimensions

# Each implementation, and the kind of rig that it is taken from.
STAGES = {"GrblStage": ("virtual", "grbl")}
CAMERAS = {
    "VirtualCamera": ("virtual",), "StreamCamera": ("command",), "FileCamera": ("folder",),
}  # fmt: skip
FORCE_SENSORS = {
    "NetFTSensor": ("virtual", "sockets"),
    "VirtualForce": ("virtual",),
    "SerialScale": ("pty",),
    "Watchdog": ("process",),
}
RIGS = {"VirtualRig": ("virtual",), "GrblRig": ("grbl",)}
INTERFACES = {"Stage": Stage, "Camera": Camera, "ForceSensor": ForceSensor, "Rig": Rig}
CASES = {"Stage": STAGES, "Camera": CAMERAS, "ForceSensor": FORCE_SENSORS, "Rig": RIGS}


@pytest.fixture
def build(mini: tuple[Path, Path], tmp_path: Path) -> Iterator[Any]:
    """Builds a rig of a kind, with all that it has; closed, and its board off, at the end."""
    declared = plan.load(str(mini[0]))[0]

    with ExitStack() as open_:

        def built(kind: str) -> Rig:
            path, protocol = mini[1], declared
            if kind == "grbl":
                path = rig_file(tmp_path, open_.enter_context(powered()).port)
                protocol = declared.model_copy(update={"channels": frozenset(), "shear": None})
            settings, _ = config.load(str(path))
            recipe = load_recipe(protocol.specimen.pattern)
            air = kind != "virtual"
            of, sensor = kind_of(settings, path), SensorDimensions()
            view = of.camera(protocol, sensor)
            rig = of.build(RigSetup(protocol, sensor, recipe, view, 3, tmp_path / "run", air=air))
            open_.callback(rig.close)
            return rig

        yield built


def cases(table: dict[str, tuple[str, ...]]) -> list[Any]:
    pairs = [(name, kind) for name, kinds in table.items() for kind in kinds]
    return [pytest.param(kind, id=f"{name}-{kind}") for name, kind in pairs]


@pytest.mark.parametrize("name", CASES)
def test_every_implementation_is_held_against_its_interface(name: str) -> None:
    members = {m for m in vars(INTERFACES[name]) if not m.startswith("_")}
    found = set()
    for module in pkgutil.walk_packages(deltact_fab.__path__, "deltact_fab."):
        if module.name.startswith(("deltact_fab.rig.", "deltact_fab.virtual.")):
            loaded = importlib.import_module(module.name)
            classes = (c for _, c in inspect.getmembers(loaded, inspect.isclass))
            found |= {c.__name__ for c in classes if all(hasattr(c, m) for m in members)}
    assert found - {name} == set(CASES[name])


def over_the_sensor(devices: Devices) -> None:
    """With an indenter, in the air."""
    devices.change_indenter("sphere:10")
    devices.stage.connect()
    devices.stage.home()
    devices.stage.start_move((0.5, -0.5, 5.0), 1200.0)
    devices.stage.wait()


def assert_plain(identity: dict[str, Any]) -> None:
    """JSON, and not empty."""
    assert json.loads(json.dumps(identity, allow_nan=False))


@pytest.mark.slow
@pytest.mark.parametrize("kind", cases(RIGS))
def test_a_rig_names_its_devices_and_closes_twice(kind: str, build: Any) -> None:
    rig = build(kind)
    devices = rig.devices()
    identity = rig.identity()
    assert_plain(identity)
    for part in ("stage", "camera", "force"):
        assert (identity[part] is None) == (getattr(devices, part) is None)
    assert all(line.strip() for line in [*rig.left_out(), *rig.notes()])
    rig.close()
    rig.close()


@pytest.mark.usefixtures("no_boot_loader")
@pytest.mark.parametrize("kind", cases(STAGES))
def test_a_stage(kind: str, build: Any) -> None:
    devices = build(kind).devices()
    stage: Stage = devices.stage
    clock: Clock = devices.clock
    assert_plain(stage.identity())
    with pytest.raises(DeltactFabError):
        stage.start_move((0.0, 0.0, 10.0), 600.0)  # not connected
    stage.connect()
    with pytest.raises(DeltactFabError):
        stage.start_move((0.0, 0.0, 10.0), 600.0)  # not homed
    stage.home()
    assert_plain(stage.identity())

    times = []
    for target in ((0.0, 0.0, 30.0), (2.0, -1.0, 29.0), (2.0, -1.0, 29.0)):
        planned_s = stage.start_move(target, 1200.0)
        assert 0 <= planned_s < math.inf
        times.append(stage.wait().t_s)
        assert stage.position_mm() == pytest.approx(target, abs=2e-3)
    assert all(a < b for a, b in itertools.pairwise(times))
    assert times[-1] <= clock.now_s()

    for target, feed_mm_min in (
        ((0.0, 0.0, 500.0), 600.0),
        ((math.nan, 0.0, 10.0), 600.0),
        ((0.0, 0.0, 10.0), 1e9),
        ((0.0, 0.0, 10.0), 0.0),
    ):
        with pytest.raises(InputError):
            stage.start_move(target, feed_mm_min)
    stage.start_move((2.0, -1.0, 9.0), 600.0)
    clock.sleep_s(0.2)
    stage.stop()
    z_mm = stage.position_mm()[2]
    assert 9.0 < z_mm < 29.0
    stage.start_move((2.0, -1.0, z_mm + 1.0), 600.0)  # it can move again
    assert stage.wait().state == "Idle"

    stage.close()
    stage.close()
    with pytest.raises(DeltactFabError):
        stage.position_mm()


NOISY = """
import os, time
while True:
    os.write(1, os.urandom(3072))
    time.sleep(0.02)
"""


def a_camera(kind: str, build: Any, folder: Path) -> tuple[Camera, Clock]:
    """One that looks at something, and its clock."""
    if kind == "virtual":
        devices = build(kind).devices()
        assert_plain(devices.camera.identity())
        over_the_sensor(devices)
        return devices.camera, devices.clock
    for k in range(10):
        cv2.imwrite(str(folder / f"{k}.png"), np.full((32, 32, 3), k, np.uint8))
    source: dict[str, Any] = {"source": "."}
    if kind == "command":
        source = {"command": (sys.executable, "-c", NOISY), "width_px": 32, "height_px": 32}
    clock = WallClock()
    return open_camera(CameraConfig(**source), folder, clock), clock


@pytest.mark.parametrize("kind", cases(CAMERAS))
def test_a_camera(kind: str, build: Any, tmp_path: Path) -> None:
    camera, clock = a_camera(kind, build, tmp_path)
    assert_plain(camera.identity())
    (tmp_path / "run").mkdir()
    for press in ("one/p1", "two/p1"):
        camera.begin(press)
        frames = []
        for _ in range(3):
            frames.append(camera.capture())
            clock.sleep_s(0.1)
        first = frames[0].image
        assert first.dtype == np.uint8
        assert (first.ndim, first.shape[2]) == (3, 3)
        assert all(f.image.shape == first.shape for f in frames)
        assert all(a.t_s < b.t_s for a, b in itertools.pairwise(frames))
        assert frames[-1].t_s <= clock.now_s()
        camera.end({f"{press}#{k}": frame.t_s for k, frame in enumerate(frames)})
    if kind == "virtual":
        refuses_a_full_disk(camera, tmp_path)
    camera.close()
    camera.close()
    assert_plain(camera.identity())


def refuses_a_full_disk(camera: Camera, tmp_path: Path) -> None:
    """What a camera keeps of a stream has to come to rest somewhere."""
    (tmp_path / "run" / "truth").rename(tmp_path / "elsewhere")
    (tmp_path / "run" / "truth").write_text("in the way")
    camera.begin("three/p1")
    frame = camera.capture()
    with pytest.raises(RunFailed):
        camera.end({"three/p1#0": frame.t_s})


@contextmanager
def a_force_sensor(kind: str, name: str, build: Any) -> Iterator[tuple[ForceSensor, Clock]]:
    """One that nothing touches, and its clock."""
    if kind == "pty":
        with scale() as it:
            yield it.opened(), WallClock()
    elif kind in ("sockets", "process"):
        from deltact_fab.virtual.netft_server import NetFTServer

        with NetFTServer(lambda t_ns: np.zeros((len(t_ns), 6))) as box:
            way = {"host": box.host, "rdt_port": box.rdt_port, "http_port": box.http_port}
            config = ForceConfig(netft=NetFTConfig(**way, silent_s=2))
            if kind == "process":
                yield Watchdog(config, GuardLimits.of(None, config)), WallClock()
            else:
                yield open_force(config, WallClock()), WallClock()
    else:
        devices = build(kind).devices()
        over_the_sensor(devices)
        force = devices.force
        if "NetFTSensor" in name:
            from deltact_fab.rig.force.netft import NetFTSensor

            force = NetFTSensor(force._link, devices.clock)
        yield force, devices.clock


@pytest.mark.parametrize("kind", cases(FORCE_SENSORS))
def test_a_force_sensor(kind: str, build: Any, request: pytest.FixtureRequest) -> None:
    with a_force_sensor(kind, request.node.name, build) as (force, clock):
        assert_plain(force.identity())
        force.begin("one/p1")
        t_ns, force_n = [], []
        for _ in range(3):
            clock.sleep_s(0.01)
            samples = force.read()
            assert not samples.saturated.any()
            assert np.isfinite(samples.torque_nmm).all()
            t_ns += samples.t_ns.tolist()
            force_n += samples.force_n.tolist()
        assert all(a < b for a, b in itertools.pairwise(t_ns))
        assert t_ns[-1] <= clock.now_s() * 1e9
        assert np.abs(force_n).max() < 0.1  # nothing touches
        force.stop()
        force.start()
        clock.sleep_s(0.01)
        assert force.read().t_ns[0] > t_ns[-1]
        force.close()
        force.close()


def test_a_rig_whose_last_device_fails_closes_the_others(
    build: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from deltact_fab.rig.stage.grbl import GrblStage
    from deltact_fab.virtual import rig as virtual_rig

    closed = []

    class Broken:
        def __init__(self, *args: Any) -> None:
            raise SensorError("no power")

    for kind in (GrblStage, devices_module().VirtualCamera):
        real = kind.close

        def close(self: Any, real: Any = real, name: str = kind.__name__) -> None:
            closed.append(name)
            real(self)

        monkeypatch.setattr(kind, "close", close)
    monkeypatch.setattr(virtual_rig, "VirtualForce", Broken)
    with pytest.raises(SensorError, match="no power"):
        build("virtual")
    assert closed == ["VirtualCamera", "GrblStage"]


def devices_module() -> Any:
    return importlib.import_module("deltact_fab.virtual.devices")
