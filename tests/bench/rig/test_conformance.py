"""What a stage keeps to, and how a rig ends that cannot be built."""

from __future__ import annotations

import importlib
import itertools
import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from deltact_fab.bench.protocols import plan
from deltact_fab.bench.rig import config
from deltact_fab.bench.rig.interface import Devices, RigSetup
from deltact_fab.common.errors import DeltactFabError, InputError, SensorError
from deltact_fab.fabricate.patterns.recipe import load_recipe
from deltact_fab.sensor.shapes.sensor import SensorDimensions
from deltact_fab.simulate.experiment.request import rig_kind


@pytest.fixture
def build(mini: tuple[Path, Path], tmp_path: Path) -> Iterator[Callable[[], Devices]]:
    """Builds the devices of a virtual rig; closed at the end."""
    protocol, sensor = plan.load_protocol(str(mini[0]))[0], SensorDimensions()
    of = rig_kind(config.load_rig(str(mini[1]))[0], mini[1])
    recipe, view = load_recipe(protocol.specimen.pattern), of.camera(protocol, sensor)
    with ExitStack() as held:

        def built() -> Devices:
            rig = of.build(RigSetup(protocol, sensor, recipe, view, 3, tmp_path / "run"))
            held.callback(rig.close)
            return rig

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


def test_failing_last_device_closes_the_others(
    build: Callable[[], Devices], monkeypatch: pytest.MonkeyPatch
) -> None:
    from deltact_fab.bench.rig.stage.grbl import GrblStage
    from deltact_fab.simulate.virtual import rig as virtual_rig

    closed = []

    def broken(*args: Any) -> None:
        raise SensorError("no power")

    camera = importlib.import_module("deltact_fab.simulate.virtual.drawing").VirtualCamera
    for kind in (GrblStage, camera):
        monkeypatch.setattr(kind, "close", lambda self, kind=kind: closed.append(kind.__name__))
    monkeypatch.setattr(virtual_rig, "VirtualForce", broken)
    with pytest.raises(SensorError, match="no power"):
        build()
    assert closed == ["VirtualCamera", "GrblStage"]
