"""Recordings made elsewhere become runs: what is known is kept, what is not is said."""

from __future__ import annotations

import json
import re
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner, Result
from numpy.typing import NDArray

from deltact_fab.app.cli.main import main
from deltact_fab.bench.record.images import encode_png
from deltact_fab.bench.record.importing import estimate_lag, motion_meter
from deltact_fab.bench.record.run import open_run
from deltact_fab.common.errors import InputError, RunFailed
from deltact_fab.estimate.measure.force.calibration import load_force
from deltact_fab.sensor.optics.flat import camera_toml
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment

# Half of the usual pixels: a quarter of the work.
DESIGN = "[optics]\nimage_width_px = 400\nimage_height_px = 300\n"
PROTOCOL = """
name = "elsewhere"
indenters = ["sphere:10"]
positions_mm = [[0.5, -0.5]]
depths_mm = [1.0]
channels = ["image", "force", "shear"]
[shear]
amplitude_mm = 0.5
axes = ["x"]
[capture]
rate_hz = 6.0
[specimen]
design = "design.toml"
"""
RECORDING = """
images = "images"
[times]
file = "times.csv"
time = "t"
[force]
file = "force.csv"
time = "stamp"
time_unit = "ms"
columns = {fx = "Fa", fy = "Fb", fz = "Fc", tx = "Ta", ty = "Tb", tz = "Tc"}
force_unit = "mN"
torque_unit = "N m"
acts_on = "indenter"
rotation = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]
[pose]
file = "pose.csv"
time = "t"
columns = {x = "x", y = "y", z = "z"}
unit = "m"
"""
TURN = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
WRENCH = ["fx_n", "fy_n", "fz_n", "tx_nmm", "ty_nmm", "tz_nmm"]


def command(*words: object) -> Result:
    return CliRunner().invoke(main, [*map(str, words)])


def written(folder: Path, images: NDArray[np.uint8]) -> None:
    folder.mkdir()
    for k, image in enumerate(images):
        cv2.imwrite(str(folder / f"{k}.png"), image)


def refusal(*words: object) -> str:
    """The one line that a command ends with."""
    done = command(*words)
    assert isinstance(done.exception, InputError | RunFailed), done.output
    assert "\n" not in str(done.exception)
    return str(done.exception)


@pytest.fixture(scope="module")
def elsewhere(
    mini: tuple[Path, Path], made_once: Callable[[str, Callable[[Path], object]], Path]
) -> Path:
    """A recording of a virtual run, in another's units, axes and sign, and the run itself."""

    def make(folder: Path) -> None:
        folder.mkdir()
        (folder / "design.toml").write_text(DESIGN)
        design = str(folder / "design.toml")
        (folder / "p.toml").write_text(PROTOCOL.replace("design.toml", design))
        run_folder = folder / "run"
        request = RunRequest(str(folder / "p.toml"), str(mini[1]), run_folder, seed=1)
        run_experiment(request)
        run = open_run(run_folder)
        frames, force, pose = run.frames(), run.force(), run.pose()
        (folder / "images").mkdir()
        for k, file in enumerate(frames["file"]):
            shutil.copy(run_folder / file, folder / "images" / f"{k}.png")
        frames[["t_s"]].rename(columns={"t_s": "t"}).to_csv(folder / "times.csv", index=False)
        six = -force[WRENCH].to_numpy()
        # The sensor's axes are the face's, turned: what it says is TURN' of what the face feels.
        three, torque = six[:, :3] @ TURN * 1e3, six[:, 3:] @ TURN / 1e3
        names = ["Fa", "Fb", "Fc", "Ta", "Tb", "Tc"]
        table = pd.DataFrame(np.hstack([three, torque]), columns=names)
        table.assign(stamp=1e3 * force["t_s"]).to_csv(folder / "force.csv", index=False)
        metres = pose[["x_mm", "y_mm", "z_mm"]].to_numpy() / 1e3
        table = pd.DataFrame(metres, columns=list("xyz")).assign(t=pose["t_s"])
        table.to_csv(folder / "pose.csv", index=False)
        (folder / "recording.toml").write_text(RECORDING)
        done = command("record", "import", folder / "recording.toml", "--out", folder / "imported")
        assert done.exit_code == 0, done.output

    return made_once("elsewhere", make)


def test_force_and_pose_are_converted(elsewhere: Path) -> None:
    run, truth = open_run(elsewhere / "imported"), open_run(elsewhere / "run")
    assert run.imported
    assert not run.simulated
    frames, was = run.frames(), truth.frames()
    assert len(frames) == len(was) > 40
    assert np.abs(run.raw(frames["file"][9]) - truth.raw(was["file"][9])).max() == 0
    pressed = (was["kind"] != "travel").to_numpy()
    for names, within in ((WRENCH, 0.05), (["x_mm", "y_mm", "z_mm"], 0.02)):
        off = frames[names].to_numpy() - was[names].to_numpy()
        assert np.abs(off[pressed]).max() < within
    assert set(frames["kind"]) | set(frames["indenter"]) == {"unknown"}
    assert len(run.steps()) == 0
    assert run.force()["saturated"].isna().all()


@pytest.mark.parametrize("lag_s", [0.0, 0.1])
def test_lag_is_estimated_within_a_frame(elsewhere: Path, lag_s: float) -> None:
    run = open_run(elsewhere / "imported")
    frames, force, moved = run.frames(), run.force(), motion_meter()
    moved_px = np.array([moved(run.raw(file)) for file in frames["file"]])
    forces = force[WRENCH[:3]].to_numpy()
    force_t_s = force["t_s"].to_numpy() + lag_s
    found = estimate_lag(frames["t_s"].to_numpy(), moved_px, force_t_s, forces)
    assert found.lag_s is not None
    assert found.between_s is not None
    assert abs(found.lag_s - lag_s) < found.frame_s / 2
    assert found.between_s[0] < found.lag_s < found.between_s[1]
    assert found.between_s[1] - found.between_s[0] < 2 * found.frame_s


@pytest.mark.slow
def test_unknown_import_values_are_one_line(elsewhere: Path, tmp_path: Path) -> None:
    run = tmp_path / "imported"
    shutil.copytree(elsewhere / "imported", run)
    assert "intact, finished" in command("record", "check", run).output
    shown = command("record", "show", run).output
    assert re.search(r"^kind +imported$", shown, re.M)
    assert command("record", "export", run, "--format", "csv", "--out", run / "t").exit_code == 0
    assert (pd.read_csv(run / "t" / "frames.csv")["fz_n"].notna()).all()
    shutil.rmtree(run / "t")
    done = command("analyze", "force", run)
    assert done.exit_code == 0, done.output
    assert "camera unknown" in done.output
    assert not (run / "analysis" / "calibration.toml").exists()
    assert command("report", run).exit_code == 0
    page = (run / "report.html").read_text()
    assert "imported" in page
    assert "simulated" not in page
    for words in (("analyze", "shape", run), ("analyze", "tracking", run), ("measure", run)):
        assert "imported" in refusal(*words)


@pytest.mark.slow
def test_complete_import_is_analysed_like_run(elsewhere: Path, tmp_path: Path) -> None:
    view = open_run(elsewhere / "run").camera
    (tmp_path / "camera.toml").write_text(camera_toml(view))
    text = RECORDING.replace('"images"', f'"{elsewhere}/images"')
    for name in ("times", "force", "pose"):
        text = text.replace(f"{name}.csv", f"{elsewhere}/{name}.csv")
    above = f'camera = "camera.toml"\ndesign = "{elsewhere}/design.toml"\nserial = "A1"\n'
    (tmp_path / "recording.toml").write_text(above + text)
    run = tmp_path / "out"
    assert command("record", "import", tmp_path / "recording.toml", "--out", run).exit_code == 0
    assert command("analyze", "shape", run).exit_code == 0
    deepest = max(row["peak_depth_mm"] for row in json.loads(
        (run / "analysis" / "shape.json").read_text())["frames"])  # fmt: skip
    assert 0.4 < deepest < 1.0  # of 1.0 mm, uncalibrated
    done = command("analyze", "force", run, "--model", "sums")
    assert done.exit_code == 0, done.output
    force = load_force(run / "analysis" / "calibration.toml")
    assert force.head.sensor.serial == "A1"
    assert force.error["normal"]["rmse_left_out_press_n"] < 0.5


@pytest.fixture
def few(elsewhere: Path, tmp_path: Path) -> Path:
    """The first four images of the recording, that a test may spoil."""
    for name in ("recording.toml", "force.csv", "pose.csv"):
        shutil.copy(elsewhere / name, tmp_path)
    rows = (elsewhere / "times.csv").read_text().splitlines()
    (tmp_path / "times.csv").write_text("\n".join(rows[:5]))
    (tmp_path / "images").mkdir()
    for k in range(4):
        shutil.copy(elsewhere / "images" / f"{k}.png", tmp_path / "images")
    return tmp_path


def edit(name: str, old: str, new: str) -> Callable[[Path], object]:
    def spoil(folder: Path) -> None:
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_text(text.replace(old, new, 1))

    return spoil


def lines(name: str, change: Callable[[list[str]], list[str]]) -> Callable[[Path], object]:
    def spoil(folder: Path) -> None:
        (folder / name).write_text("\n".join(change((folder / name).read_text().splitlines())))

    return spoil


TOML = "recording.toml"
WRONG: dict[str, tuple[Callable[[Path], object], str]] = {
    "column": (edit(TOML, '"Fc"', '"Fz"'), r"force.csv: fz = 'Fz': no such column; .*Fa"),
    "unit": (edit(TOML, '"mN"', '"lbf"'), r"recording.toml: force.force_unit: .*'N' or 'mN' .*lbf"),
    "mirror": (edit(TOML, "[0, 0, 1]", "[0, 0, -1]"), r"force: rotation: a reflection"),
    "no rate": (
        edit(TOML, '[times]\nfile = "times.csv"\ntime = "t"\n', ""),
        r"recording.toml: rate_hz: missing key, .*images has no times",
    ),
    "times back": (
        lines("times.csv", lambda r: [*r[:2], *r[:0:-1][:3]]),
        r"times.csv: line 4: t = ",
    ),
    "a row less": (lines("times.csv", lambda r: r[:-1]), r"times.csv: t: 3 rows, but .* 4 images"),
    "ms are s": (edit("times.csv", "t\n", "t\n1e12\n"), r"times.csv: t: up to 1.0e\+12 s; .*'ns'"),
    "no file": (lambda f: (f / "pose.csv").unlink(), r"pose.csv: cannot be read: No such file"),
    "image": (lambda f: (f / "images/2.png").write_bytes(b"x"), r"2.png: not a readable image"),
    "size": (
        lambda f: (f / "images/3.png").write_bytes(encode_png(np.zeros((9, 8, 3), np.uint8))),
        r"image 4 has 8 x 9 px, the first has 400 x 300",
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_invalid_recording_writes_nothing(few: Path, what: str) -> None:
    spoil, words = WRONG[what]
    spoil(few)
    before = sorted(few.rglob("*"))
    told = refusal("record", "import", few / TOML, "--out", few / "out")
    assert re.search(words, told), told
    assert sorted(few.rglob("*")) == before


def sql(text: str) -> Callable[[Path], object]:
    def spoil(run: Path) -> None:
        with closing(sqlite3.connect(run / "journal.sqlite")) as db, db:
            assert db.execute(text).rowcount > 0

    return spoil


DAMAGED: dict[str, tuple[Callable[[Path], object], str]] = {
    "row": (sql("DELETE FROM frames WHERE k = 2"), "not listed in the journal"),
    "stream": (sql("DELETE FROM samples WHERE stream = 'pose'"), "None of pose, but"),
    "image": (lambda r: next((r / "images").iterdir()).unlink(), "No such file"),
    "summary": (lambda r: (r / "summary.json").unlink(), "summary.json  needed to verify"),
}


@pytest.mark.parametrize("what", DAMAGED)
def test_a_damaged_import_fails_its_check(few: Path, what: str) -> None:
    done = command("record", "import", few / TOML, "--out", few / "out")
    assert done.exit_code == 0, done.output
    assert "undetermined" in done.output  # four images are too few for a lag
    spoil, words = DAMAGED[what]
    spoil(few / "out")
    done = command("record", "check", few / "out")
    assert done.exit_code == 1
    assert words in done.output


def test_images_and_a_rate_are_enough(tmp_path: Path) -> None:
    images = np.random.default_rng(0).integers(0, 255, (3, 40, 60, 3), np.uint8)
    written(tmp_path / "images", images)
    (tmp_path / TOML).write_text('images = "images"\nrate_hz = 20\n')
    done = command("record", "import", tmp_path / TOML, "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    run = open_run(tmp_path / "out")
    frames = run.frames()
    assert np.allclose(frames["t_s"], [0, 0.05, 0.1])
    assert np.array_equal(run.raw(frames["file"][1]), images[1])
    assert "no force recorded" in refusal("analyze", "force", tmp_path / "out")


def test_import_exports_to_lerobot_and_mcap(few: Path) -> None:
    """Its times begin before its first image, and before 1970."""
    pytest.importorskip("av")
    rows = (few / "times.csv").read_text().splitlines()
    first_s = float(rows[1])
    moved = [rows[0], *(str(float(row) - first_s - 1) for row in rows[1:])]
    (few / "times.csv").write_text("\n".join(moved))
    force = pd.read_csv(few / "force.csv")
    force.assign(stamp=force["stamp"] - 1e3 * (first_s + 1)).to_csv(few / "force.csv", index=False)
    edit(TOML, RECORDING[RECORDING.index("[pose]") :], "")(few)
    run = few / "out"
    assert command("record", "import", few / TOML, "--out", run).exit_code == 0
    done = command("record", "export", run, "--format", "lerobot", "--out", few / "dataset")
    assert done.exit_code == 0, done.output
    info = json.loads((few / "dataset" / "meta" / "info.json").read_text())
    frames = open_run(run).frames()
    assert info["fps"] == round(1 / np.median(np.diff(frames["t_s"])))
    data = pd.read_parquet(few / "dataset" / "data")
    assert np.allclose(np.stack(data["observation.wrench"])[:, 2], frames["fz_n"], atol=1e-6)
    assert np.isnan(np.stack(data["observation.state"])).all()
    done = command("record", "export", run, "--format", "mcap", "-o", few / "run.mcap")
    assert done.exit_code == 0, done.output


def test_no_force_calibration_on_interpolated_motion(tmp_path: Path) -> None:
    face = np.full((240, 320, 3), 150, np.uint8)
    for x in range(25, 320, 30):
        for y in range(24, 240, 32):
            cv2.circle(face, (x, y), 5, (40, 40, 40), -1, cv2.LINE_AA)
    written(tmp_path / "images", np.stack([np.roll(face, k, 1) for k in range(12)]))
    stamps = pd.DataFrame({"t": np.arange(-1, 3, 0.01)})
    stamps.assign(f=np.maximum(stamps["t"], 0)).to_csv(tmp_path / "f.csv", index=False)
    force = '[force]\nfile = "f.csv"\ntime = "t"\ncolumns = {fz = "f"}\nforce_unit = "N"\n'
    about = f'images = "images"\nrate_hz = 20\n{force}acts_on = "indenter"\n'
    (tmp_path / TOML).write_text(about)
    done = command("record", "import", tmp_path / TOML, "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert "no dense pattern: 70 markers" in refusal("calibrate", "force", tmp_path / "out")
