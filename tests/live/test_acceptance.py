"""A sensor that was made badly fails the row of what is wrong with it, and no other."""

from __future__ import annotations

import json
import shutil
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from called import called
from spoiled_sensor import (
    DESIGN,
    Made,
    bubble,
    gone,
    light,
    lint,
    photographs,
    ring_without,
    turned,
)

from deltact_fab.errors import InputError
from deltact_fab.imaging import ImageSensor
from deltact_fab.live.acceptance import Accepted, accept
from deltact_fab.live.known_step import known_steps
from deltact_fab.live.open import acceptance_file
from deltact_fab.live.source import KnownSensor
from deltact_fab.optics import Fisheye, Pinhole, Rectified
from deltact_fab.patterns import load_recipe
from deltact_fab.report.first_light import pairs
from deltact_fab.rig.interface import CameraFrame

SOUND: dict[str, Made] = {
    "as designed": Made(images=12),
    "finest patches, fisheye": Made(recipe="dense", fisheye=True, seed=2),
    "little light, little sharpness": Made(
        camera=ImageSensor(blur_px=0.9, corner_blur_px=1.2, shading=0.4, full_well_electrons=4000),
        paint=(light(lambda x, y: 0.45 + 0 * x),), seed=4,
    ),
    "a webcam's sharpening and JPEG": Made(
        camera=ImageSensor(format="mjpeg-422", sharpening=0.6),
        paint=(light(lambda x, y: 0.7 + 0 * x),), seed=5,
    ),
    "lens put in by hand": Made(
        lens=(("tilt_x_deg", 0.6), ("tilt_y_deg", -0.4), ("x0_mm", 0.12), ("gel_mm", 0.03)), seed=6
    ),
    "film stretched, turned and aside": Made(move=turned(-0.8, -0.3, 0.5, 1.01), seed=8),
}  # fmt: skip


def _band(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return x < -13.6


BAD: dict[str, tuple[Made, tuple[str, ...], dict[str, Any]]] = {
    "far out of focus": (Made(camera=ImageSensor(blur_px=4.0)), ("focus",), {}),
    "lens tilted by 2.6 degrees": (
        Made(lens=(("tilt_x_deg", 2.6),)), ("lens square to the face",),
        {"keystone": pytest.approx(0.066, abs=0.01)}),
    "one LED dead": (
        Made(paint=(light(ring_without(3)),)), ("light, all LEDs", "light, even"), {}),
    "diffuser missing": (
        Made(paint=(light(lambda x, y: np.exp(-(x**2 + y**2) / 160)),)), ("light, even",), {}),
    "over-exposed": (
        Made(paint=(light(lambda x, y: 1.9 + 0 * x),)), ("saturation", "light, level"), {}),
    "bubble, fisheye": (
        Made(fisheye=True, paint=(bubble(9.0, 6.0, 1.0),)), ("bubbles, lint, dust",), {}),
    "lint, finest patches": (
        Made(recipe="dense", paint=(lint(5.0, 4.0, 2.5),)), ("bubbles, lint, dust",), {}),
    "film torn at a side": (
        Made(paint=(gone(lambda x, y: np.hypot(x, y - 11) < 3.0, 0.05),)), ("film",), {}),
    "sticker turned by 95 degrees": (
        Made(recipe="dense", move=turned(95.0)), ("turn",),
        {"turned_deg": pytest.approx(95, abs=0.05)}),
    "mirrored": (Made(recipe="dense", move=((-1, 0, 0), (0, 1, 0))), ("mirror",), {}),
    "sticker aside, dots out of view": (
        Made(move=turned(0.0, 0.3, -2.0)), ("place",),
        {"place_mm": pytest.approx((0.3, -2.0), abs=0.03)}),
    "film stretched": (
        Made(recipe="dense", move=turned(0.0, scale=1.06)), ("scale",),
        {"scale": pytest.approx(1.06, abs=0.001)}),
    "wrong pattern": (Made(recipe="iid"), ("recipe",), {}),
    "frame in view": (
        Made(paint=(gone(_band, 0.03),)), ("edges of the view",),
        {"edges": {"-x": pytest.approx(1.5, abs=0.1)}}),
    "touched at rest": (
        Made(images=12, press_mm=(0.0,) * 9 + (0.1, 0.2, 0.3)), ("at rest",), {}),
    "noisy": (
        Made(images=12, camera=ImageSensor(full_well_electrons=150.0, read_noise_electrons=10.0),
             paint=(light(lambda x, y: 0.5 + 0 * x),)),
        ("noise at rest", "at rest"), {}),
}  # fmt: skip
SPOILED = "film", "bubbles, lint, dust", "light, all LEDs", "light, even"


class Given:
    """Images that are there already, as a source."""

    live, name = False, "given"

    def __init__(self, images: list[np.ndarray], camera: Pinhole | Rectified) -> None:
        self.known, self._images = KnownSensor(camera), images

    def frames(self) -> Iterator[CameraFrame]:
        for k, image in enumerate(self._images):
            yield CameraFrame(image, k / 10, k)

    at_rest = frames

    def close(self) -> None:
        pass


def judged(made: Made, images: int = 2, recipe: str = "") -> Accepted:
    through_lens = made.fisheye or made.lens
    camera = Rectified.of(DESIGN, Fisheye.of(DESIGN)) if through_lens else Pinhole.of(DESIGN)
    source = Given(photographs(made, max(images, made.images)), camera)
    return accept(source, load_recipe(recipe or made.recipe), DESIGN)


def failed(done: Accepted) -> set[str]:
    return {row.check for row in done.rows if not row.passed}


def test_a_bubble_is_found_where_it_is_and_nothing_else_is_wrong():
    done = judged(Made(paint=(bubble(4.0, -3.0, 1.0),)))
    assert failed(done) == {"bubbles, lint, dust"}
    ((x, y, long_mm),) = done.found.places
    assert (x, y) == pytest.approx((4.0, -3.0), abs=0.2)
    assert long_mm == pytest.approx(1.0, abs=0.4)
    assert done.found.noise_mm is None  # of two images nothing is said


@pytest.mark.slow
@pytest.mark.parametrize("name", SOUND)
def test_a_sound_sensor_is_accepted(name):
    assert failed(judged(SOUND[name])) == set()


@pytest.mark.slow
@pytest.mark.parametrize("name", BAD)
def test_a_bad_sensor_fails_its_own_row_and_no_other_without_cause(name):
    made, (own, *follow), painted = BAD[name]
    done = judged(made, recipe="dense-with-dots" if name == "wrong pattern" else "")
    assert own in failed(done) <= {own, *follow}
    assert {key: getattr(done.found, key) for key in painted} == painted
    if name == "far out of focus":  # print, mosaic and demosaicing have nearly a pixel of their own
        blur_px = np.median([b for row in done.found.blur_px for b in row if b is not None])
        assert 4 <= blur_px <= np.hypot(4, 0.95) + 0.6


@pytest.mark.slow
def test_the_guide_s_pictures_are_what_they_are_said_to_be():
    pair = pairs(DESIGN, load_recipe("recommended"))["sensor"]
    for jpeg, rows in zip(pair, (set(), set(SPOILED)), strict=True):
        image = np.asarray(cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR))
        done = accept(Given([image], Pinhole.of(DESIGN)), load_recipe("recommended"), DESIGN)
        assert failed(done) == rows


@pytest.mark.slow
def test_an_accepted_sensor_is_kept_and_later_health_starts_from_it(tmp_path):
    words = ["rig", "accept", "virtual", "--frames", "12", "--serial", "A1"]
    done = called(*words, "--picture", "face.png", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("virtual: accepted\n")
    assert "simulated, seed 0" in done.stdout
    kept = tomllib.loads((tmp_path / "sensors" / "A1.toml").read_text())
    assert kept["kind"] == "acceptance"
    assert kept["sensor"] == {"design": "deltact", "serial": "A1"}
    assert cv2.imread(str(tmp_path / "face.png")) is not None
    again = called(*words, cwd=tmp_path)
    assert again.returncode == 2
    assert "sensors/A1.toml: already there; name another file" in again.stderr
    rest = cv2.imread(str(tmp_path / "sensors" / "A1.rest.png"))
    folder = tmp_path / "later"
    folder.mkdir()
    cv2.imwrite(str(folder / "0.png"), np.roll(rest, 12, axis=1))
    camera = tmp_path / "camera.toml"
    numbers = Pinhole.of(DESIGN).as_dict()
    camera.write_text(
        "[camera]\n" + "".join(f"{k} = {json.dumps(v)}\n" for k, v in numbers.items())
    )
    look = ["measure", str(folder), "--camera", str(camera), "--serial", "A1"]
    told = called(*look, cwd=tmp_path)
    assert "the pattern moved by 0.45 mm" in told.stderr
    (tmp_path / "sensors" / "A1.rest.png").write_bytes(b"no")
    told = called(*look, cwd=tmp_path)
    assert told.returncode == 2
    assert "A1.rest.png: differs from the hash in sensors/A1.toml" in told.stderr
    file = tmp_path / "sensors" / "A1.toml"
    file.write_text(file.read_text().partition("[rest]")[0])
    told = called(*look, cwd=tmp_path)
    assert told.returncode == 2
    assert "sensors/A1.toml: rest.file: no image of the face at rest" in told.stderr


def test_what_cannot_be_judged_is_one_line(tmp_path):
    (tmp_path / "images").mkdir()
    cv2.imwrite(str(tmp_path / "images" / "0.png"), np.full((48, 64, 3), 90, np.uint8))
    for words, says in (
        (["images"], "RECIPE: missing; a name of `pattern list` or a recipe's file"),
        (["images", "dens"], "did you mean 'dense'?"),
        (["images", "dense", "--serial", "../x"], "--serial '../x': letters, digits"),
        (
            ["images", "dense"],
            "image 0 has 64 x 48 px; the camera of the design makes 1280 x 720 px",
        ),
        (["images", "chessboard"], "chessboard: no dense pattern"),
        (["images", "dense", "--step", "images"], "images: not a run folder"),
    ):
        done = called("rig", "accept", *words, cwd=tmp_path)
        assert done.returncode == 2
        assert says in done.stderr
        assert done.stderr.count("\n") == 1
    assert acceptance_file("Δ-1").name == "Δ-1.toml"


@pytest.mark.slow
def test_a_known_step_is_recovered_and_a_wrong_scale_is_not(tmp_path):
    """Truth and camera share their projection here; the solver moves the face."""
    done = called("run", "known-step", "--rig", "virtual", "--out", "step", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = known_steps(tmp_path / "step")
    assert [row.check for row in rows] == ["known step, x", "known step, y"]
    for row in rows:
        seen, made = (
            float(word) for word in row.found.removesuffix(", simulated").split(" mm of ")
        )
        assert row.passed
        assert row.found.endswith(", simulated")
        assert made == pytest.approx(0.6, abs=1e-3)
        assert seen == pytest.approx(made, abs=0.004)
    wrong = tmp_path / "wrong"
    shutil.copytree(tmp_path / "step", wrong)
    told = json.loads((wrong / "run.json").read_text())
    told["camera"]["mm_per_px"] *= 1.03
    (wrong / "run.json").write_text(json.dumps(told))
    assert not any(row.passed for row in known_steps(wrong))
    shutil.rmtree(wrong)
    with pytest.raises(InputError, match="no such folder"):
        known_steps(Path(wrong))
