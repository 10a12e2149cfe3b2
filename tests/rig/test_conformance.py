"""What a stage and every force sensor keep to, and how a rig ends that cannot be built."""

from __future__ import annotations

import importlib
import itertools
import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scale_on_pty import scale

from deltact_fab.errors import DeltactFabError, InputError, SensorError
from deltact_fab.experiment import kind_of
from deltact_fab.patterns.recipe import load_recipe
from deltact_fab.protocols import plan
from deltact_fab.rig import config
from deltact_fab.rig.clock import WallClock
from deltact_fab.rig.config import ForceConfig
from deltact_fab.rig.force.config import NetFTConfig
from deltact_fab.rig.force.guard import GuardLimits
from deltact_fab.rig.force.open import open_force
from deltact_fab.rig.force.watchdog import Watchdog
from deltact_fab.rig.interface import Clock, ForceSensor
from deltact_fab.rig.job import Devices, RigSetup
from deltact_fab.shapes import SensorDimensions
from deltact_fab.virtual.netft_server import NetFTServer


@pytest.fixture
def build(mini: tuple[Path, Path], tmp_path: Path) -> Iterator[Callable[[], Devices]]:
    """Builds the devices of a virtual rig; closed at the end."""
    protocol, sensor = plan.load(str(mini[0]))[0], SensorDimensions()
    of = kind_of(config.load(str(mini[1]))[0], mini[1])
    recipe, view = load_recipe(protocol.specimen.pattern), of.camera(protocol, sensor)
    with ExitStack() as held:

        def built() -> Devices:
            rig = of.build(RigSetup(protocol, sensor, recipe, view, 3, tmp_path / "run"))
            held.callback(rig.close)
            return rig.devices()

        yield built


def test_a_stage(build: Callable[[], Devices]) -> None:
    devices = build()
    stage, clock = devices.stage, devices.clock
    for makes_ready in (stage.connect, stage.home):
        with pytest.raises(DeltactFabError):
            stage.start_move((0.0, 0.0, 10.0), 600.0)
        makes_ready()
    times = []
    for target in ((0.0, 0.0, 30.0), (2.0, -1.0, 29.0), (2.0, -1.0, 29.0)):
        assert 0 <= stage.start_move(target, 1200.0) < math.inf
        times.append(stage.wait().t_s)
        assert stage.position_mm() == pytest.approx(target, abs=2e-3)
    assert all(a < b for a, b in itertools.pairwise([*times, clock.now_s() + 1e-9]))
    for target, feed_mm_min in (
        ((0.0, 0.0, 500.0), 600.0), ((math.nan, 0.0, 10.0), 600.0), ((0.0, 0.0, 10.0), 1e9),
        ((0.0, 0.0, 10.0), 0.0),
    ):  # fmt: skip
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
    with pytest.raises(DeltactFabError):
        stage.position_mm()


@contextmanager
def a_force_sensor(kind: str, build: Callable[[], Devices]) -> Iterator[tuple[ForceSensor, Clock]]:
    """One that nothing touches, and its clock."""
    if kind == "pty":
        with scale() as it:
            yield it.opened(), WallClock()
    elif kind == "virtual":
        devices = build()
        devices.change_indenter("sphere:10")
        devices.stage.connect()
        devices.stage.home()
        assert devices.force is not None
        yield devices.force, devices.clock
    else:
        with NetFTServer(lambda t_ns: np.zeros((len(t_ns), 6))) as box:
            way = {"host": box.host, "rdt_port": box.rdt_port, "http_port": box.http_port}
            of = ForceConfig(netft=NetFTConfig(**way, silent_s=2))
            limits = GuardLimits.of(None, of)
            yield (
                Watchdog(of, limits) if kind == "process" else open_force(of, WallClock()),
                (WallClock()),
            )


@pytest.mark.parametrize("kind", ["virtual", "sockets", "pty", "process"])
def test_a_force_sensor(kind: str, build: Callable[[], Devices]) -> None:
    with a_force_sensor(kind, build) as (force, clock):
        force.begin("one/p1")
        t_ns, force_n = list[int](), list[list[float]]()
        for _ in range(3):
            clock.sleep_s(0.01)
            samples = force.read()
            assert not samples.saturated.any()
            t_ns += samples.t_ns.tolist()
            force_n += samples.force_n.tolist()
        assert all(a < b for a, b in itertools.pairwise(t_ns))
        assert t_ns[-1] <= clock.now_ns()
        assert np.abs(force_n).max() < 0.1  # nothing touches
        force.stop()
        force.start()
        clock.sleep_s(0.01)
        assert force.read().t_ns[0] > t_ns[-1]
        force.close()
        force.close()


def test_a_rig_whose_last_device_fails_closes_the_others(
    build: Callable[[], Devices], monkeypatch: pytest.MonkeyPatch
) -> None:
    from deltact_fab.rig.stage.grbl import GrblStage
    from deltact_fab.virtual import rig as virtual_rig

    closed = []

    def broken(*args: Any) -> None:
        raise SensorError("no power")

    camera = importlib.import_module("deltact_fab.virtual.devices").VirtualCamera
    for kind in (GrblStage, camera):
        monkeypatch.setattr(kind, "close", lambda self, kind=kind: closed.append(kind.__name__))
    monkeypatch.setattr(virtual_rig, "VirtualForce", broken)
    with pytest.raises(SensorError, match="no power"):
        build()
    assert closed == ["VirtualCamera", "GrblStage"]
