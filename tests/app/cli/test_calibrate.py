"""`rig photograph` and `calibrate lens`, one after the other, as their user calls them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner, Result

from deltact_fab.app.cli.calibrate import lens as calibrate
from deltact_fab.app.cli.rig import rig
from deltact_fab.common.errors import InputError
from deltact_fab.sensor.optics.fisheye import Fisheye
from deltact_fab.sensor.optics.flat import FlatField, load_camera
from deltact_fab.sensor.optics.rectified import Rectified

RIG = """
kind = "virtual"
[stage]
origin_machine_mm = [-60.0, -60.0, -40.0]
travel_mm = [120.0, 120.0, 60.0]
max_feed_mm_min = [1500.0, 1500.0, 1200.0]
acceleration_mm_s2 = [50.0, 50.0, 50.0]
[virtual.lens]
f_px = 192.0
k1 = -0.01
cx_px = 322.0
cy_px = 178.0
width_px = 640
height_px = 360
tilt_x_deg = 0.5
roll_deg = -0.4
x0_mm = 0.1
air_gap_mm = 3.1
pupil_shift_mm = 0.1
"""


def say(command: object, *words: str | Path) -> Result:
    done = CliRunner().invoke(command, [str(w) for w in words])  # type: ignore[arg-type]
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bench")
    (folder / "bench.toml").write_text(RIG)
    words = ("--board", "skin", "--air", "1", "--air-board", "9x7x3", "--seed", "3")
    said = say(rig, "photograph", folder / "bench.toml", *words, "--out", folder / "photos")
    assert "simulated, seed 3" in said.output
    return folder / "photos"


@pytest.fixture
def place(photos: Path, tmp_path: Path) -> Path:
    shutil.copytree(photos, tmp_path / "photos")
    return tmp_path


def test_from_photographs_to_a_camera_file(place: Path) -> None:
    out = place / "camera.toml"
    photos = place / "photos"
    words = ("--board", "skin", "--flat", photos / "blank.png", "-o", out, "--json")
    told = json.loads(say(calibrate, photos / "contact", *words).output)
    assert told["simulated"]
    assert told["seeds"] == [3]
    assert told["n_images"] == 1
    lens, tables = load_camera(out)
    true, _ = load_camera(photos / "truth" / "lens.toml")
    assert isinstance(lens, Fisheye)
    assert isinstance(true, Fisheye)
    assert told["camera"] == lens.as_dict()
    assert tables["calibration"]["sigma_face_px"] == told["sigma_face_px"]
    assert tables["calibration"]["parameters"]["f_px"]["sigma"] > 0
    # The calibrated lens serves to rectify: half a raw pixel is 0.03 mm.
    view = Rectified(lens, mm_per_px=0.0756, width_px=399, height_px=293)
    x, y = np.meshgrid(np.linspace(-15, 15, 9), np.linspace(-11, 11, 7))
    at = np.stack((x, y), -1)
    assert np.abs(view.rest_px(lens.rest_mm(true.rest_px(at))) - view.rest_px(at)).max() < 0.1
    flat = FlatField.from_camera_file(out)
    assert flat is not None
    assert flat.share.shape == (360, 640, 3)
    # A person reads the same.
    said = say(calibrate, photos / "contact" / "1.png", *words[:-1]).output
    assert f"face {told['sigma_face_px']:.3f}" in said
    assert "simulated images, seed 3" in said
    assert "note: not determined by these images, kept at design values: " in said


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "no contact image: "),
        (["photos/contact/2.png"], r"photos/contact/2.png: no such file"),
        (["photos/contact/1.png", "small.png"], r"small.png: 320 x 180 px, and .*1.png has 640 x"),
        (["photos/contact", "text.png"], r"text.png: not a readable image"),
        (["empty"], r"empty: no image in this folder"),
        (["photos/blank.png"], r"blank.png: a skin was not found in any contact image"),
        (["photos/contact", "--air", "photos/air"], r"--air: a skin cannot be held .* --air-board"),
        (["photos/contact", "--air-board", "9x7"], r"--air-board: '9x7'; as in 9x7x3"),
        (["photos/contact", "--board", "9x7x3"], r"1.png: .* inner corners found, but a board of"),
        (["photos/contact", "--flat", "small.png"], r"--flat small.png: 320 x 180 px, and"),
        (["photos/contact", "--design", "delt"], r"no design 'delt'"),
    ],
    ids=lambda w: "-".join(Path(x).stem for x in w) or "none" if isinstance(w, list) else "",
)
def test_unusable_input_writes_nothing(
    place: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], says: str
) -> None:
    monkeypatch.chdir(place)
    cv2.imwrite("small.png", np.zeros((180, 320, 3), np.uint8))
    Path("text.png").write_text("no image")
    Path("empty").mkdir()
    asked = words if "--board" in words else ["--board", "skin", *words]
    with pytest.raises(InputError, match=says) as refused:
        say(calibrate, *asked, "-o", "camera.toml")
    assert "\n" not in str(refused.value)
    assert not list(place.glob("camera*"))


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["virtual", "--board", "skin"], "needs .virtual.lens."),
        (["grbl-bench", "--board", "skin"], "camera: missing table"),
        (["bench.toml", "--board", "60x60x1"], "--board 60x60x1: not completely in view"),
        (["bench.toml", "--board", "skin", "--air", "2"], "--air: not possible with a skin"),
        (["bench.toml", "--board", "9x7x3", "--contact", "-1"], "0 to 200 images of each"),
        (["bench.toml", "--board", "skin", "--out", "photos"], "photos: already exists"),
    ],
    ids=lambda w: w[0] + w[2] if isinstance(w, list) else "",
)
def test_photographs_that_cannot_be_taken(
    photos: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], says: str
) -> None:
    monkeypatch.chdir(photos.parent)
    asked = words if "--out" in words else [*words, "--out", "new"]
    with pytest.raises(InputError, match=says):
        say(rig, "photograph", *asked)
    assert not Path("new").exists()
