"""Dead weights by hand: what is asked, what is recorded, and what a calibration makes of it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from deltact_fab.bench.protocols.plan import Protocol
from deltact_fab.bench.protocols.tables import DeadWeights
from deltact_fab.bench.record.check import check_run
from deltact_fab.bench.record.run import open_run
from deltact_fab.bench.rig import config, weights
from deltact_fab.bench.rig.bench import GrblKind
from deltact_fab.bench.rig.interface import Camera, CameraFrame, Devices, RigSetup, move_to
from deltact_fab.bench.rig.tables import CameraConfig
from deltact_fab.common.catalog import toml_text
from deltact_fab.common.errors import InputError, Stopped
from deltact_fab.estimate.analysis.force.calibrate import calibrate
from deltact_fab.estimate.analysis.shape.run import analyse_shape
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.patterns.recipe import load_recipe
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment
from deltact_fab.simulate.virtual.rig import VirtualKind

SEEN = CameraConfig(source=0, width_px=640, height_px=480)
STATIC = {"settle_s": 0.01}


def protocol(**own: object) -> Protocol:
    return Protocol.model_validate(
        {
            "name": "w", "indenters": ["sphere:15"], "positions_mm": [[0, 0], [4, -2]],
            "channels": ["force"], "capture": STATIC, "weights": {"masses_g": [100, 50]}, **own,
        }
    )  # fmt: skip


class Hand:
    """Answers everything; stops when it has been asked so often."""

    def __init__(self, stops_after: int = 1000) -> None:
        self.asked: list[str] = []
        self.stops_after = stops_after

    def tell(self, text: str) -> None:
        pass

    def ask(self, text: str) -> str:
        if len(self.asked) == self.stops_after:
            raise KeyboardInterrupt
        self.asked.append(text)
        return ""


@pytest.fixture
def weigh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[str]]:
    def weigh(
        of: Protocol, hand: Hand, view: Any = None, lens: Any = None, **own: Any
    ) -> list[str]:
        """A run of it by this hand, taken up where there is one; its notes."""
        monkeypatch.setattr(weights, "TerminalOperator", lambda: hand)
        monkeypatch.setattr(weights, "open_camera", lambda *about: lens)
        file = tmp_path / "w.toml"
        if not file.exists():
            file.write_text(toml_text(of.model_dump(mode="json", exclude_unset=True)))
        request = RunRequest(str(file), "grbl-bench", tmp_path / "r")
        assert isinstance(request.rig, config.GrblConfig)
        request.rig = request.rig.model_copy(update=own)
        request.kind = GrblKind(request.rig, request.rig_path)
        request.__dict__["view"] = view
        notes: list[str] = run_experiment(request, resume=True)["notes"]
        return notes

    return weigh


def test_weight_is_wrench_with_errors() -> None:
    level = DeadWeights(masses_g=(200.0,), error_g=1.0)
    fx, fy, fz, tx, ty, tz = level.wrench(200.0, (4.0, -2.0))
    assert (fx, fy) == (0.0, 0.0)
    assert fz == pytest.approx(-1.96133)
    assert (tx, ty, tz) == pytest.approx((2 * 1.96133, 4 * 1.96133, 0.0))
    tilted = level.model_copy(update={"tilt_deg": (10.0, 0.0), "height_mm": 30.0})
    fx, _, fz, _, ty, tz = tilted.wrench(200.0, (0.0, 5.0))
    assert fx == pytest.approx(1.96133 * math.sin(math.radians(10)))
    assert fz == pytest.approx(-1.96133 * math.cos(math.radians(10)))
    assert (ty, tz) == pytest.approx((30 * fx, -5 * fx))
    normal_n, shear_n = tilted.error_n()
    assert normal_n == pytest.approx(0.0098 + 1.96 * 0.00349 * (0.1736 + 0.00349), rel=0.01)
    assert shear_n == pytest.approx(0.0098 * 0.1736 + 1.96 * 0.00349, rel=0.01)


@pytest.mark.parametrize(
    ("own", "why"),
    [
        ({"depths_mm": [1.0]}, "either depths_mm"),
        ({"weights": None}, "either depths_mm"),
        ({"capture": {"rate_hz": 1.0}}, "need capture.settle_s"),
        ({"weights": {"masses_g": [50], "tilt_deg": [41, 0]}}, "less than or equal to 40"),
        ({"shear": {"amplitude_mm": 1.0}, "channels": ["force", "shear"]}, "tilt the face"),
    ],
)
def test_inconsistent_weights_are_refused(own: dict[str, object], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        protocol(**own)


Weigh = Callable[..., list[str]]


def test_weights_run_prompts_and_records(weigh: Weigh, tmp_path: Path) -> None:
    hand = Hand()
    notes = weigh(protocol(), hand)
    assert hand.asked[:4] == [
        "take sphere:15; press Enter when ready",
        "clear the face, next is (0, 0) mm; press Enter when nothing touches it",
        "place 100 g on sphere:15 at (0, 0) mm; press Enter when it rests",
        "place 50 g on sphere:15 at (0, 0) mm; press Enter when it rests",
    ]
    assert "uncertainty 0.001 N normal" in notes[0]
    run = open_run(tmp_path / "r")
    frames = run.frames("sphere-15/p2")
    assert frames["fz_n"].tolist() == pytest.approx([0, -0.980665, -0.4903325, 0], abs=1e-6)
    assert frames["tx_nmm"].tolist() == pytest.approx([0, 1.96133, 0.980665, 0], abs=1e-5)
    assert frames["settled"].tolist() == [True, True, True, False]
    assert (frames["t_step_s"][frames["settled"]] >= STATIC["settle_s"]).all()
    assert frames[["x_mm", "z_mm"]].isna().all(axis=None)  # nobody knows how deep it went
    assert (run.events()["kind"] == "weight").sum() == 4
    assert check_run(tmp_path / "r").intact


def test_weights_resume_after_last_press(weigh: Weigh, tmp_path: Path) -> None:
    with pytest.raises(Stopped, match="sphere-15/p2/m1/press; complete presses are kept"):
        weigh(protocol(), Hand(stops_after=6))
    again = Hand()
    weigh(protocol(), again)
    assert len(again.asked) == 4  # the second place, whole
    assert len(open_run(tmp_path / "r").frames()) == 8


@pytest.mark.parametrize("option", ["air", "unattended"])
def test_weights_need_a_manual_bench(option: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"--{option}: not available with weights"):
        run_experiment(RunRequest("dead-weights", "grbl-bench", tmp_path / "r", **{option: True}))  # type: ignore[arg-type]
    assert not any(tmp_path.iterdir())
    with pytest.raises(InputError, match="weights: not available on a virtual rig"):
        RunRequest("dead-weights", "virtual").require()


class VirtualHand(Hand):
    """Lowers a simulated stage until the gel carries the weight."""

    def __init__(self, devices: Devices) -> None:
        super().__init__()
        self.stage, self.force, self.clock = devices.stage, devices.force, devices.clock

    def ask(self, text: str) -> str:
        if "(" in text:
            x, y = (float(v) for v in text.split("(")[1].split(")")[0].split(","))
            now = self.stage.position_mm()
            move_to(self.stage, (now[0], now[1], 5.0), 600)
            move_to(self.stage, (x, y, 5.0), 600)
        if text.startswith("place"):
            weight_n = float(text.split()[1]) * 9.80665e-3
            assert self.force is not None
            self.force.start()
            depth = brentq(lambda d: self.felt_n((x, y, -d)) - weight_n, 0.1, 1.5, xtol=0.01)
            self.felt_n((x, y, -depth))
            self.force.stop()
        return ""

    def felt_n(self, at_mm: tuple[float, float, float]) -> float:
        move_to(self.stage, at_mm, 60)
        assert self.force is not None
        self.force.read()
        self.clock.sleep_s(0.02)
        return -float(self.force.read().force_n[:, 2].mean())


class Lens:
    """The simulated camera, at the time of the wall."""

    def __init__(self, camera: Camera) -> None:
        self.begin, self._camera = camera.begin, camera

    def capture(self) -> CameraFrame:
        return replace(self._camera.capture(), t_s=time.monotonic())

    def end(self, frames: object) -> None:
        pass

    def identity(self) -> dict[str, Any]:
        return {}

    def close(self) -> None:
        pass


@pytest.mark.slow
def test_weights_calibrate_normal_force_not_shear(weigh: Weigh, tmp_path: Path) -> None:
    own = {
        "channels": ["image", "force"], "positions_mm": [[0, 0], [5, 3], [-4, 4]],
        "specimen": {"pattern": "dense", "gel_model": "linear"},
    }  # fmt: skip
    by_hand = protocol(weights={"masses_g": [100, 200]}, **own)
    by_stage = Protocol.model_validate(
        {**by_hand.model_dump(exclude={"weights"}), "depths_mm": [2.0]}
    )
    bench, path = config.load_rig("virtual")
    assert isinstance(bench, config.VirtualConfig)
    view = VirtualKind(bench, path).camera(by_stage, load_design("deltact"))
    job = RigSetup(by_stage, load_design("deltact"), load_recipe("dense"), view, 0, tmp_path / "v")
    with closing(VirtualKind(bench, path).build(job)) as rig:
        devices = rig
        devices.stage.connect()
        devices.stage.home()
        devices.change_indenter("sphere:15")
        assert devices.camera is not None
        weigh(by_hand, VirtualHand(devices), view, Lens(devices.camera), camera=SEEN)
    found = calibrate([tmp_path / "r"], ["sums"])
    assert "shear not calibrated (no shear in the data)" in found.line
    assert any("weights placed by hand: force known to" in w for w in found.notes)
    features = found.data.features[found.best.name]
    for x, measured in zip(features, found.data.wrench, strict=True):
        wrench = found.calibration.model.wrench(x, 1.0)
        assert np.isnan(wrench.force_n[:2]).all()
        assert wrench.force_n[2] == pytest.approx(measured[2], abs=0.6)
    assert found.figures()["sums"]["normal"]["rmse_left_out_position_n"] < 0.3
    with pytest.raises(InputError, match="no stage position recorded"):
        analyse_shape(tmp_path / "r")
