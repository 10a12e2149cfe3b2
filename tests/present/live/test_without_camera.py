"""Images and nothing else: what they show, in pixels; folders in the making; what is kept."""

from __future__ import annotations

import csv
import json
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from called import called
from numpy.typing import NDArray

from deltact_fab.app.schema import find_kind, rows
from deltact_fab.common import catalog
from deltact_fab.estimate.measure.health import RestPattern
from deltact_fab.fabricate.patterns.raster import raster_window
from deltact_fab.fabricate.patterns.recipe import load_recipe

Image = NDArray[np.uint8]
W, H = 304, 232
MAP = np.array([[1.03, 0.02], [0.0, 1.01]])
"""Of the last image: 4.03 % larger."""


def moved(image: Image, share: float = 1.0) -> Image:
    """By that share of MAP about the middle, without its border."""
    matrix = np.eye(2) + share * (MAP - np.eye(2))
    middle = np.array([image.shape[1], image.shape[0]]) / 2
    way = np.column_stack((matrix, middle - matrix @ middle))
    size = (image.shape[1], image.shape[0])
    return np.asarray(cv2.warpAffine(image, way, size, flags=cv2.INTER_CUBIC)[16:-16, 16:-16])


def noise(shape: tuple[int, ...], sigma: float) -> NDArray[np.float32]:
    return np.random.default_rng(1).normal(0, sigma, shape).astype(np.float32)


def speckle() -> Image:
    grain = cv2.GaussianBlur(noise((H + 32, W + 32, 3), 1), (0, 0), 1.6)
    return np.clip(128 + 45 * grain / grain.std(), 0, 255).astype(np.uint8)


def skin() -> Image:
    """Fifty-four dark markers on a plain ground with a camera's noise, under uneven light."""
    image = 150 + noise((H + 32, W + 32, 3), 1.2) + np.linspace(-30, 30, W + 32)[:, None]
    for x in range(40, W + 8, 30):
        for y in range(36, H + 8, 32):
            cv2.circle(image, (x, y), 5, (40, 40, 40), -1, cv2.LINE_AA)
    return np.clip(image, 0, 255).astype(np.uint8)


def plain() -> Image:
    return np.clip(120 + noise((H + 32, W + 32, 3), 1.2), 0, 255).astype(np.uint8)


def shots(folder: Path, face: Image, n: int = 4) -> Path:
    folder.mkdir()
    for k in range(n):
        cv2.imwrite(str(folder / f"{k}.png"), moved(face, k / (n - 1)))
    return folder


def film(file: Path, face: Image) -> Path:
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), 25, (W, H))
    for k in range(4):
        writer.write(moved(face, k / 3))
    writer.release()
    return file


@pytest.mark.parametrize(
    ("face", "kind"), [(speckle(), "dense"), (skin(), "markers"), (plain(), "nothing")]
)
def test_pattern_kinds_are_recognised(face: Image, kind: str) -> None:
    assert RestPattern.recognise(moved(face, 0)).kind == kind


@pytest.mark.parametrize(("name", "kind"), [("dense-with-dots", "dense"), ("dots", "markers")])
def test_dots_on_dense_pattern_are_ignored(name: str, kind: str) -> None:
    recipe = load_recipe(str(catalog.find_file("patterns", name)))
    found = RestPattern.recognise(
        np.ascontiguousarray(raster_window(recipe, 672.0, 480)[..., ::-1])
    )
    assert found.kind == kind
    assert found.markers > 20
    assert not 0.05 < found.between < 0.2, "the line between both is at 0.1"


@pytest.mark.parametrize("form", ["folder", "film"])
@pytest.mark.parametrize(("name", "face"), [("dense", speckle()), ("markers", skin())])
def test_unknown_camera_measures_in_pixels(
    name: str, face: Image, form: str, tmp_path: Path
) -> None:
    source = (shots if form == "folder" else film)(tmp_path / "x.avi", face)
    done = called("measure", str(source), "--jsonl")
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("--mm-per-px gives mm on the face") == 1
    told = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(told) == 4
    last = told[-1]
    assert last["trusted"]
    assert 5 < last["motion_px"] < 7  # 6.98 in the corner
    assert last["motion_mm"] is None
    assert ("no dense pattern: 54 markers" in done.stderr) == (last["markers"] == 54)
    assert (last["markers"] is None) == (name == "dense")


def test_scale_gives_mm(tmp_path: Path) -> None:
    source = str(shots(tmp_path / "x", skin()))
    done = called("measure", source, "--mm-per-px", "0.1", "--json")
    last = json.loads(done.stdout)["last"]
    assert last["markers_held"] >= 50
    assert last["motion_mm"] == pytest.approx(0.1 * last["motion_px"], abs=1e-4)
    assert "in pixels" not in done.stderr
    for words, says in (
        (["--show", "shape"], "--show shape: needs a scale: --mm-per-px or --camera"),
        (["--calibration", "f.toml"], "f.toml: a calibration is valid for its own"),
        (["--pictures"], "--pictures needs --out"),
        (["--out", source], "must be a new or empty folder"),
    ):
        done = called("measure", source, *words)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
        assert says in done.stderr


def write(folder: Path, n: int, end: str) -> None:
    """Each image in two halves, and half a one more."""
    for k in range(n):
        data = cv2.imencode(".png", np.roll(speckle()[:72, :96], k % 3, axis=1))[1].tobytes()
        with (folder / f"{k}.png").open("wb", buffering=0) as out:
            out.write(data[: len(data) // 2])
            time.sleep(0.01)
            out.write(data[len(data) // 2 :])
    if end == "half":
        (folder / f"{n}.png").write_bytes(data[: len(data) // 2])


@pytest.mark.parametrize(("end", "code"), [("silence", 0), ("half", 1)])
def test_growing_folder_is_measured_completely(end: str, code: int, tmp_path: Path) -> None:
    folder, n = tmp_path / "images", 12
    folder.mkdir()
    writer = threading.Thread(target=write, args=(folder, n, end))
    writer.start()
    done = called("measure", str(folder), "--follow", "2", "--jsonl")
    writer.join()
    told = [json.loads(line) for line in done.stdout.splitlines()]
    assert [row["frame"] for row in told] == list(range(n))
    assert [round(row["motion_median_px"]) for row in told] == [k % 3 for k in range(n)]
    assert done.returncode == code
    assert (f"{n}.png: incomplete image" in done.stderr) == (code == 1)


def test_results_are_saved_with_units(tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = called("measure", shots(tmp_path / "x", speckle()), "--out", out, "--pictures")
    assert done.returncode == 0, done.stderr
    with (out / "measured.csv").open() as lines:
        *_, last = csv.DictReader(lines)
    assert list(last) == [row.key for row in rows(find_kind("measured"))]
    assert 5 < float(last["motion_px"]) < 7
    assert last["fx_n"] == ""
    with np.load(out / last["fields"]) as arrays:
        assert set(arrays) <= {row.key for row in rows(find_kind("fields"))}
        assert arrays["flow_px"].shape == (H // 2, W // 2, 2)
    assert np.array_equal(cv2.imread(str(out / last["picture"])), moved(speckle()))
