"""A sensor that was made badly fails the row of what is wrong with it, and no other."""

from __future__ import annotations

import json
import shutil
import tomllib
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from called import called
from made_badly import BAD, SOUND
from spoiled_sensor import DESIGN, Made, bubble, photographs

from deltact_fab.errors import InputError
from deltact_fab.live.acceptance import Accepted, accept
from deltact_fab.live.known_step import known_steps
from deltact_fab.live.open import acceptance_file
from deltact_fab.live.source import KnownSensor
from deltact_fab.optics import Fisheye, Pinhole, Rectified
from deltact_fab.patterns import load_recipe
from deltact_fab.report.first_light import pairs
from deltact_fab.rig.interface import CameraFrame

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
