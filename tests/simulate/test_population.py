"""Sensors drawn from a population and their drift: in images and forces, and not in the record."""

from __future__ import annotations

import itertools
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from short_run import RIG, ShortRun

from deltact_fab.bench.protocols.limits import RunEstimate
from deltact_fab.bench.record.check import check_run
from deltact_fab.bench.record.files import LENS_FILE, SENSOR_FILE
from deltact_fab.bench.record.run import open_run
from deltact_fab.bench.rig.config import VirtualConfig, load_rig
from deltact_fab.common.errors import InputError
from deltact_fab.physics.gel.level_selection import poisson_limit
from deltact_fab.sensor.optics.camera import MovedPinhole, Pinhole
from deltact_fab.sensor.optics.fisheye import Fisheye
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment, run_presses
from deltact_fab.simulate.virtual.population import SensorDraw

POPULATION = """
[virtual.population]
modulus = 0.2
poisson = 0.005
thickness_mm = 0.2
sticker_mm = 0.2
sticker_deg = 1.0
spread_um = 5.0
light = 0.05
camera_mm = 0.3
camera_height_mm = 0.2
camera_roll_deg = 1.0
"""
QUIET = "[virtual.force]\nnoise_n = 0.0\n"
Rows = list[Any]


class Sensors(ShortRun):
    """Short runs on a rig with more tables, of sensors by number."""

    def __init__(self, folder: Path, tables: str) -> None:
        super().__init__(folder, tables=tables)

    def run(self, out: Path, sensor: int | None = None, **words: Any) -> Path:
        run_experiment(
            RunRequest(str(self.protocol), str(self.rig), out, 3, sensor=sensor), **words
        )
        return out


def images(run: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in sorted((run / "images").iterdir())}


def forces(run: Path, *presses: str) -> Rows:
    """Times since the tare and forces of a run, or of some of its presses."""
    table = open_run(run).force()
    table = table[table["press"].isin(presses)] if presses else table
    names = ["press", "t_press_s", "fx_n", "fy_n", "fz_n", "tx_nmm", "ty_nmm", "tz_nmm"]
    return table[names].to_numpy().tolist()


def peaks_n(run: Path) -> np.ndarray:
    return open_run(run).force().groupby("press", sort=False)["fz_n"].min().to_numpy()


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Runs of the nominal sensor and of sensors 1, 2 and again 1."""
    folder = tmp_path_factory.mktemp("drawn")
    sensors = Sensors(folder, POPULATION)
    runs = {name: folder / name / "run" for name in ("nominal", "1", "2", "1 again")}
    for name, out in runs.items():
        sensors.run(out, None if name == "nominal" else int(name[0]))
    return {**runs, "plain": ShortRun(folder).finished}


@pytest.mark.slow
def test_a_draw_changes_truth_alone(drawn: dict[str, Path]) -> None:
    one, two, again = (drawn[name] for name in ("1", "2", "1 again"))
    for name in ("run.json", "pattern.json", "protocol.toml"):
        assert (one / name).read_bytes() == (two / name).read_bytes()
        assert (one / name).read_bytes() == (drawn["nominal"] / name).read_bytes()
    summaries = [open_run(run).summary() for run in (one, two, drawn["nominal"])]
    for key in ("devices", "left_out", "frame_counts"):
        assert summaries[0][key] == summaries[1][key] == summaries[2][key]
    assert images(one).keys() == images(two).keys()
    assert not any(data == images(two)[name] for name, data in images(one).items())
    assert np.abs(peaks_n(one) / peaks_n(two) - 1).min() > 0.01
    assert images(one) == images(again)
    assert forces(one) == forces(again)
    assert images(drawn["nominal"]) == images(drawn["plain"])
    assert forces(drawn["nominal"]) == forces(drawn["plain"])
    assert json.loads((one / SENSOR_FILE).read_bytes())["number"] == 1
    assert not (drawn["plain"] / SENSOR_FILE).exists()
    check_run(one).require_intact()
    hidden = json.loads((one / "run.json").read_bytes())["rig"]["virtual"]
    assert list(hidden["population"]) == ["sha256"]


@pytest.mark.slow
def test_true_camera_projects_the_truth(drawn: dict[str, Path], tmp_path: Path) -> None:
    """A tracker agrees with the truth, and not with that of the recorded camera."""
    import cv2

    run, errors_px = shutil.copytree(drawn["1"], tmp_path / "run"), []
    table = open_run(run).frames("sphere-8/p1")
    rest, last = (open_run(run).image(str(table["file"].iloc[k])) for k in (0, -3))
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    found = flow.calc(*(cv2.cvtColor(x, cv2.COLOR_BGR2GRAY) for x in (rest, last)), None)
    for _ in range(2):
        truth = open_run(run).truth()
        assert truth is not None
        true = truth.flow_px(str(table["frame_id"].iloc[-3]))
        errors_px.append(np.linalg.norm(found - true, axis=-1)[10:-10, 10:-10].mean())
        (run / LENS_FILE).unlink(missing_ok=True)
    assert errors_px[0] < 0.6 * errors_px[1]


def test_moved_pinhole_turns_like_a_lens() -> None:
    view = Pinhole(0.04, 160, 120, 14.0)
    moved = view.with_pose((0.3, -0.2), 0.5, 0.1, 2.0)
    assert isinstance(moved, MovedPinhole)
    px = np.array([[0.0, 0.0], [100.0, 30.0], [159.0, 119.0]])
    assert np.allclose(moved.rest_px(moved.rest_mm(px)), px)
    origins, towards = moved.ray(px)
    assert np.allclose(moved.project_px(origins - 2.0 * towards), px)
    assert np.allclose(moved.crossing_mm(origins - 2.0 * towards), origins[:, :2])
    turns = []
    for camera in (moved, Fisheye(cx_px=79.5, cy_px=59.5, x0_mm=0.3, y0_mm=-0.2, roll_deg=2.0)):
        x, y = np.diff(camera.rest_px(np.array([[0.3, -0.2], [0.4, -0.2]])), axis=0)[0]
        turns.append(np.degrees(np.arctan2(y, x)))
    assert turns[0] == pytest.approx(turns[1])


def test_keys_are_drawn_apart(tmp_path: Path) -> None:
    """Another key changes no value; Poisson's ratio stays within the level's limit."""
    tables = dict(line.split(" = ") for line in POPULATION.split("\n") if " = " in line)
    whole = SensorDraw.from_population(rig_of(Sensors(tmp_path, POPULATION)), 7, "rig")
    for key, value in tables.items():
        alone = Sensors(tmp_path, f"[virtual.population]\n{key} = {value}\n")
        draw = SensorDraw.from_population(rig_of(alone), 7, "rig")
        assert getattr(draw, key) == getattr(whole, key) != getattr(SensorDraw(), key)
    wide = rig_of(Sensors(tmp_path, "[virtual.population]\npoisson = 0.1\n"))
    protocol = RunRequest(str(alone.protocol), str(alone.rig)).protocol
    gels = [
        SensorDraw.from_population(wide, n, "rig").protocol(protocol).specimen for n in range(9)
    ]
    assert max(gel.poisson for gel in gels) == poisson_limit("linear")


def rig_of(sensors: Sensors) -> VirtualConfig:
    config = load_rig(str(sensors.rig))[0]
    assert isinstance(config, VirtualConfig)
    return config


@pytest.mark.parametrize(
    ("tables", "sensor", "said"),
    [
        ("", 1, "--sensor: 1; .*bench.toml has no .virtual.population."),
        (POPULATION, -1, "--sensor: -1; expected 0 or more"),
        ("[virtual.population]\nmodulus = -0.1", None, "population.modulus: .*-0.1"),
        (
            "[virtual.population]\ncamera_tilt_deg = 1.0",
            None,
            "camera_tilt_deg: must be 0 for a pin",
        ),
        ("[virtual.drift]\nresidual = 1.0", None, "virtual.drift.residual: .*1"),
        ("[virtual.population]\ncamera_mm = 2.0", 3, "sensor 3: the view's border is up to"),
    ],
)
def test_bad_population_is_refused(
    tmp_path: Path, tables: str, sensor: int | None, said: str
) -> None:
    with pytest.raises(InputError, match=said):
        Sensors(tmp_path, tables).run(tmp_path / "run", sensor)
    assert not (tmp_path / "run").exists()


def test_drawn_gel_is_checked(tmp_path: Path) -> None:
    """A press that the design's gel bears and that is deeper than the drawn one is thick."""
    sensors = Sensors(tmp_path, "[virtual.population]\nthickness_mm = 5.0\n")
    text = sensors.protocol.read_text().replace("depths_mm = [0.4]", "depths_mm = [7.0]")
    sensors.protocol.write_text(text + 'gel_model = "hyperelastic"\n')
    for number, thick in ((2, True), (3, False)):
        chosen = RunRequest(str(sensors.protocol), str(sensors.rig), sensor=number)
        lines = chosen.kind.refusals(chosen.protocol, chosen.design, "p.toml")
        assert (not lines) == thick
    assert "sensor 3 of [virtual.population]: depths_mm: 7 mm is not less than the" in lines[0]


def test_real_rig_has_its_own_sensor() -> None:
    with pytest.raises(InputError, match=r"--sensor: 1; .* is a real rig"):
        RunRequest("smoke", "grbl-bench", sensor=1)


@pytest.mark.slow
def test_resume_needs_the_same_sensor(drawn: dict[str, Path], tmp_path: Path) -> None:
    sensors = Sensors(tmp_path, POPULATION)
    sensors.finished = drawn["1"]
    out = sensors.unfinished(tmp_path / "run", sensors.presses[-1])
    for other, said in ((2, "2 now"), (None, "nothing now")):
        with pytest.raises(InputError, match=f"--sensor: 1 in the folder, {said}"):
            run_experiment(request(drawn, sensors, out, other), resume=True)
    run_experiment(request(drawn, sensors, out, 1), resume=True)
    assert images(out) == images(drawn["1"])
    assert forces(out) == forces(drawn["1"])


def request(drawn: dict[str, Path], sensors: Sensors, out: Path, number: int | None) -> RunRequest:
    """Of the drawn runs' own protocol, of which the text counts."""
    protocol = drawn["1"] / "protocol.toml"
    return RunRequest(str(protocol), str(sensors.rig), out, 3, sensor=number)


DRIFT = """
[virtual.drift]
force_gain_per_h = {gain}
light_per_h = -0.9
residual = {residual}
recovery_s = 20.0
"""


@pytest.mark.slow
def test_drift_does_not_depend_on_order(tmp_path: Path) -> None:
    """A run resumed after its second press, and presses carried out alone, equal the whole."""
    sensors = Sensors(tmp_path, POPULATION + DRIFT.format(gain=0.9, residual=0.3))
    whole = sensors.finished = sensors.run(tmp_path / "whole", 1)
    resumed = sensors.unfinished(tmp_path / "resumed", "sphere-8/p1")
    assert sensors.run(resumed, 1, resume=True) == resumed
    assert images(resumed) == images(whole)
    assert forces(resumed) == forces(whole)
    job = RunRequest(str(sensors.protocol), str(sensors.rig), seed=3)
    for number, press in enumerate(("sphere-8/p2", "sphere-6/p2")):
        out = tmp_path / f"alone-{number}"
        run_presses(job.setup(out), rig_of(sensors), sensors.rig, [press], sensor=1)
        own = press.replace("/", "_")
        assert images(out) == {k: v for k, v in images(whole).items() if k.startswith(own)}
        assert forces(out) == forces(whole, press)
    levels = [
        open_run(whole).image(name).mean()
        for name in (f"images/{press}_rest_001.png" for press in ("sphere-6_p1", "sphere-8_p2"))
    ]
    assert levels[1] < levels[0] - 1.0
    hidden = json.loads((whole / "run.json").read_bytes())["rig"]["virtual"]["drift"]
    assert list(hidden) == ["sha256"]


@pytest.mark.slow
def test_drift_follows_the_planned_time(tmp_path: Path) -> None:
    """A gain of 5 % over the run, and the dent of the press before, whose place is near."""
    sensors = Sensors(tmp_path, QUIET)
    names = ["press", "step_id", "t_press_s", "fz_n"]
    still = open_run(sensors.run(tmp_path / "still")).force()[names]
    ends_s = dict(zip(
        ["homed", *(step.id for step in sensors.steps)],
        RunEstimate.planned_ends_s(sensors.steps, rig_of(sensors).stage), strict=True,
    ))  # fmt: skip
    length_s, presses = max(ends_s.values()), list(dict.fromkeys(still["press"]))
    time_s = still["press"].map(lambda press: ends_s[f"{press}/rest"]) + still["t_press_s"]
    touches, stops = still["fz_n"] < -0.3, still["step_id"].str.endswith("/d0.40/press")
    left_s = still["press"].map({
        press: ends_s[f"{last}/retract"] for last, press in itertools.pairwise(presses)
    })  # fmt: skip
    dent = 0.3 * np.exp(-(time_s - left_s.fillna(-np.inf)) / 20.0)
    cases = (
        (0.05 / length_s * 3600, 0.0, touches, 1 + 0.05 * time_s / length_s),
        (0.0, 0.3, touches & stops & ~still["step_id"].duplicated(keep="last"), 1 - dent),
    )
    for gain, residual, rows, expected in cases:
        sensors.rig.write_text(RIG + QUIET + DRIFT.format(gain=gain, residual=residual))
        changed = open_run(sensors.run(tmp_path / f"gain-{gain}")).force()["fz_n"]
        ratio = (changed / still["fz_n"])[rows].to_numpy()
        assert len(ratio) >= 4
        assert ratio == pytest.approx(expected[rows].to_numpy(), abs=1e-4)
        assert np.ptp(ratio) > 0.03
