"""Sources: what is opened by which name, what each knows, and one line for what cannot be used."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from deltact_fab.bench.record.run import open_run
from deltact_fab.common.errors import DeltactFabError, SensorError
from deltact_fab.present.live.open import open_source
from deltact_fab.present.live.source import images
from deltact_fab.sensor.optics.camera import Pinhole
from deltact_fab.sensor.optics.flat import camera_toml


@pytest.fixture(scope="module")
def pinhole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A camera file of small images."""
    file = tmp_path_factory.mktemp("camera") / "camera.toml"
    file.write_text(camera_toml(Pinhole(0.1, 64, 48, 12.85)))
    return file


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    """Twelve images in a folder, each of one grey, written so that 10.png sorts before 2.png."""
    folder = tmp_path / "pictures"
    folder.mkdir()
    for k in range(12):
        cv2.imwrite(str(folder / f"{k}.png"), np.full((48, 64, 3), 20 * k, np.uint8))
    return folder


def test_folder_images_in_numeric_order(pictures: Path, pinhole: Path) -> None:
    frames = list(images(open_source(str(pictures), pinhole)))
    assert [int(f.image[0, 0, 0]) for f in frames] == [20 * k for k in range(12)]
    assert np.all(np.diff([f.t_s for f in frames]) > 0)


def test_run_gives_model_and_raw_images(mini_run: Path) -> None:
    source = open_source(str(mini_run))
    run = open_run(mini_run)
    table = run.frames()
    frames = list(images(source))
    assert [f.t_s for f in frames] == pytest.approx(table["t_s"])
    assert np.array_equal(frames[3].image, run.raw(table["file"].iloc[3]))
    known = source.model
    assert known.camera is not None
    assert known.camera.as_dict() == run.camera.as_dict()
    assert known.simulated == "simulated, seed 3"
    assert known.recipe == run.pattern["recipe"]


@pytest.mark.slow
def test_rig_images_equal_recorded_run(mini: tuple[Path, Path], mini_run: Path) -> None:
    """Through the camera's interface: the same images, at rest and on the way down."""
    protocol, rig = mini
    source = open_source(f"{rig}:{protocol}", seed=3)
    run = open_run(mini_run)
    files = run.frames()["file"]
    seen = images(source)
    for k in range(3):
        assert np.array_equal(next(seen).image, run.raw(files.iloc[k]))
    assert source.model.simulated == "simulated, seed 3"


def test_camera_file_overrides_source(mini_run: Path, tmp_path: Path) -> None:
    recorded = open_run(mini_run).camera
    other = Pinhole(0.05, recorded.width_px, recorded.height_px, 14)
    file = tmp_path / "camera.toml"
    file.write_text(camera_toml(other))
    source = open_source(str(mini_run), file, serial="B2")
    assert source.model.camera == other
    assert source.model.serial == "B2"
    assert source.model.design == "deltact"


RIG = """
kind = "grbl"
[stage]
port = "/dev/none"
origin_machine_mm = [-60.0, -60.0, -40.0]
travel_mm = [120.0, 120.0, 60.0]
max_feed_mm_min = [1500.0, 1500.0, 1200.0]
acceleration_mm_s2 = [50.0, 50.0, 50.0]
[camera]
"""
NOISE = """
import os, sys, time; time.sleep(0.5)  # images from before the first request are discarded
for k in range(3):
    sys.stdout.buffer.write(bytes([k]) + os.urandom(64 * 48 * 3 - 1))
sys.exit("the lens fell off")
"""


def test_real_rig_opens_camera_only(pinhole: Path, tmp_path: Path) -> None:
    """Its port is not even there. The camera ends with what it last said."""
    rig = tmp_path / "bench.toml"
    command = json.dumps([sys.executable, "-c", NOISE])
    size = "width_px = 64\nheight_px = 48"
    rig.write_text(f"{RIG}command = {command}\n{size}\nmodel = {json.dumps(str(pinhole))}\n")
    source = open_source(str(rig))
    seen = images(source)
    assert source.live
    assert [int(next(seen).image[0, 0, 0]) for _ in range(3)] == [0, 1, 2]
    with pytest.raises(SensorError, match="status 1; stderr: the lens fell off"):
        next(seen)
    source.close()


def _refusal(name: object, camera: Path | None = None) -> str:
    with pytest.raises(DeltactFabError) as why:
        list(images(open_source(str(name), camera)))
    assert "\n" not in str(why.value)
    return str(why.value)


def test_unusable_source_is_one_line(
    pictures: Path, pinhole: Path, tmp_path: Path, mini_run: Path
) -> None:
    assert "/dev/video63: cannot be opened" in _refusal("63", pinhole)
    assert "did you mean 'virtual'" in _refusal("virtul")
    assert "no protocol 'smok'" in _refusal("virtual:smok")
    assert "`measure` needs 'image'" in _refusal("virtual:first-moves")
    assert "has a real stage" in _refusal("grbl-bench:smoke")
    assert "camera: missing table" in _refusal("grbl-bench")
    assert "rtsp://127.0.0.1:9/none: no image stream" in _refusal(
        "rtsp://127.0.0.1:9/none", pinhole
    )
    empty = tmp_path / "empty"
    empty.mkdir()
    assert "no image in this folder" in _refusal(empty, pinhole)
    text = tmp_path / "film.mp4"
    text.write_text("no film")
    assert "not a video" in _refusal(text, pinhole)
    (pictures / "3.png").write_bytes(b"no image")
    assert "3.png: not a readable image" in _refusal(pictures, pinhole)
    cv2.imwrite(str(pictures / "3.png"), np.zeros((40, 64, 3), np.uint8))
    assert "image 3 has 64 x 40 px; the calibrated camera has 64 x 48 px" in _refusal(
        pictures, pinhole
    )
    assert "image 3 has 64 x 40 px; the first image has 64 x 48 px" in _refusal(pictures)
    damaged = tmp_path / "run"
    shutil.copytree(mini_run, damaged)
    (damaged / "run.json").write_text("{")
    assert "run.json" in _refusal(damaged)
