"""A sensor that was made badly fails the row of what is wrong with it, and no other.

Printer, lens, mosaic and noise are the product's own; what is spoiled is painted here.
"""

from __future__ import annotations

import json
import shutil
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from called import called

from deltact_fab.bench.record.ledger import SensorLedger
from deltact_fab.bench.rig.interface import CameraFrame
from deltact_fab.common.errors import InputError
from deltact_fab.estimate.measure.sensor_id import SensorModel
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.patterns.raster import pattern_albedo
from deltact_fab.fabricate.patterns.recipe import load_recipe
from deltact_fab.physics.imaging import print_colours
from deltact_fab.present.live.acceptance import Acceptance, accept_sensor
from deltact_fab.present.live.known_step import check_known_step
from deltact_fab.present.live.source import Source
from deltact_fab.present.report.first_light import render_examples
from deltact_fab.sensor.optics.camera import Pinhole
from deltact_fab.sensor.optics.fisheye import Fisheye
from deltact_fab.sensor.optics.lattice import SurfaceLattice
from deltact_fab.sensor.optics.rectified import Rectified
from deltact_fab.sensor.shapes.imaging import ImageSensor, Printer
from deltact_fab.simulate.virtual.picture import FrameRenderer, PictureGeometry, RawView

DESIGN = load_design("deltact")
LATTICE = SurfaceLattice(-20.0, -17.0, 0.5, 81, 69)
STEP_MM = Printer().mm_per_dot
Paint = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Made:
    """How one was made. paint: of (values, x_mm, y_mm) on the face; move: a 2 x 3 map of the print
    in mm; press: of each image, how deep a bump in the middle is, mm; lens: of the true lens."""

    recipe: str = "dense-with-dots"
    move: tuple[tuple[float, float, float], tuple[float, float, float]] = ((1, 0, 0), (0, 1, 0))
    paint: tuple[Paint, ...] = ()
    camera: ImageSensor = field(default_factory=ImageSensor)
    press_mm: tuple[float, ...] = ()
    lens: tuple[tuple[str, float], ...] = ()
    fisheye: bool = False
    images: int = 1
    seed: int = 0


def photographs(made: Made, n: int) -> list[np.ndarray]:
    """n images (h, w, 3) BGR as the camera gives them."""
    rng = np.random.default_rng(made.seed)
    print_ = print_colours(Printer(), pattern_albedo(load_recipe(made.recipe), STEP_MM), rng)
    side = len(print_)
    back = np.array([[1 / STEP_MM, 0, (side - 1) / 2], [0, 1 / STEP_MM, (side - 1) / 2], [0, 0, 1]])
    moved = back @ np.vstack((made.move, [0, 0, 1])) @ np.linalg.inv(back)
    values = cv2.warpPerspective(print_, moved, (side, side), borderValue=(0.9, 0.9, 0.9))
    at = (np.arange(side) - (side - 1) / 2) * STEP_MM
    x, y = np.meshgrid(at, at)
    for paint in made.paint:
        values = paint(values, x, y).astype(np.float32)
    camera: Pinhole | RawView = Pinhole.from_sensor(DESIGN)
    if made.fisheye or made.lens:
        nominal = Fisheye.from_sensor(DESIGN)
        numbers = dict(made.lens)
        true = replace(nominal, **{k: getattr(nominal, k) + v for k, v in numbers.items()})
        camera = RawView(true, Rectified.from_sensor(DESIGN, nominal))
    draw = FrameRenderer(PictureGeometry(camera, LATTICE), values, STEP_MM, made.camera)
    lattice_x, lattice_y = np.meshgrid(*LATTICE.axes_mm())
    bump = np.zeros((*lattice_x.shape, 3))
    bump[..., 2] = -np.exp(-(lattice_x**2 + lattice_y**2) / 18)
    images = []
    for k in range(n):
        deep = made.press_mm[k] if k < len(made.press_mm) else 0.0
        images.append(draw.render(bump * deep if deep else None, rng))
    return images


def turned(deg: float, x_mm: float = 0.0, y_mm: float = 0.0, scale: float = 1.0) -> tuple:
    c, s = scale * np.cos(np.radians(deg)), scale * np.sin(np.radians(deg))
    return ((c, -s, x_mm), (s, c, y_mm))


def bubble(x0: float, y0: float, mm: float) -> Paint:
    """Air in the gel: a lens that spreads what is behind it, with a bright spot and a dark rim."""

    def paint(values, x, y):
        r = np.hypot(x - x0, y - y0) / (mm / 2)
        # From the middle outwards less and less enlarged.
        pull = np.where(r < 1, 0.35 + 0.65 * r**2, 1.0)
        half = (len(values) - 1) / 2
        map_x = ((x0 + (x - x0) * pull) / STEP_MM + half).astype(np.float32)
        map_y = ((y0 + (y - y0) * pull) / STEP_MM + half).astype(np.float32)
        out = cv2.remap(values, map_x, map_y, cv2.INTER_LINEAR)
        rim = np.exp(-(((r - 0.92) / 0.08) ** 2))[..., None]
        spot = np.exp(-((np.hypot(x - x0 - 0.15 * mm, y - y0 + 0.15 * mm) / (0.12 * mm)) ** 2))
        return np.clip(out * (1 - 0.7 * rim) + 0.6 * spot[..., None], 0, 1)

    return paint


def lint(x0: float, y0: float, mm: float, wide_mm: float = 0.12) -> Paint:
    """A curved dark thread."""

    def paint(values, x, y):
        off = np.abs(y - y0 - 0.15 * mm * np.sin(3 * (x - x0) / mm))
        mask = np.clip((wide_mm / 2 - off) / 0.02, 0, 1) * (np.abs(x - x0) < mm / 2)
        return values * (1 - 0.85 * mask[..., None])

    return paint


def gone(where: Callable[[np.ndarray, np.ndarray], np.ndarray], colour: float) -> Paint:
    """No print where that is: white coat, black coat or frame."""
    return lambda values, x, y: np.where(where(x, y)[..., None], colour, values)


def light(of: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Paint:
    return lambda values, x, y: values * of(x, y)[..., None]


def ring_without(cut: int) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Two cuts of three bulbs on a circle of 9 mm, 10 mm behind the face, falling off as cos^4."""

    def of(x, y):
        light, whole = np.zeros_like(x), np.zeros_like(x)
        for k in range(6):
            a = 2 * np.pi * k / 6
            d2 = (x - 9 * np.cos(a)) ** 2 + (y - 9 * np.sin(a)) ** 2 + 100
            whole += 1 / d2**2
            light += (k // 3 != cut) / d2**2
        return light / whole.max()

    return of


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
    "one cut dark": (
        Made(paint=(light(ring_without(1)),)), ("light, all LEDs", "light, even"), {}),
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
        Made(images=12, camera=ImageSensor(full_well_electrons=120.0, read_noise_electrons=10.0),
             paint=(light(lambda x, y: 0.5 + 0 * x),)),
        ("noise at rest", "at rest"), {}),
}  # fmt: skip
SPOILED = "film", "bubbles, lint, dust", "light, all LEDs", "light, even"


def given(images: list[np.ndarray], camera: Pinhole | Rectified) -> Source:
    """Images that are there already, as a source."""
    frames = [CameraFrame(image, k / 10, k) for k, image in enumerate(images)]
    return Source("given", SensorModel(camera), lambda _: iter(frames))


def judged(made: Made, images: int = 2, recipe: str = "") -> Acceptance:
    through_lens = made.fisheye or made.lens
    camera = (Rectified if through_lens else Pinhole).from_sensor(DESIGN)
    source = given(photographs(made, max(images, made.images)), camera)
    return accept_sensor(source, load_recipe(recipe or made.recipe), DESIGN)


def failed(done: Acceptance) -> set[str]:
    return {row.name for row in done.rows if row.failed}


def test_bubble_is_located():
    done = judged(Made(paint=(bubble(4.0, -3.0, 1.0),)))
    assert failed(done) == {"bubbles, lint, dust"}
    ((x, y, long_mm),) = done.findings.places
    assert (x, y) == pytest.approx((4.0, -3.0), abs=0.2)
    assert long_mm == pytest.approx(1.0, abs=0.4)
    assert done.findings.noise_mm is None  # of two images nothing is said


@pytest.mark.slow
@pytest.mark.parametrize("name", SOUND)
def test_a_sound_sensor_is_accepted(name):
    assert failed(judged(SOUND[name])) == set()


@pytest.mark.slow
@pytest.mark.parametrize("name", BAD)
def test_bad_sensor_fails_its_row_only(name):
    made, (own, *follow), painted = BAD[name]
    done = judged(made, recipe="dense-with-dots" if name == "wrong pattern" else "")
    assert own in failed(done) <= {own, *follow}
    assert {key: getattr(done.findings, key) for key in painted} == painted
    if name == "far out of focus":  # print, mosaic and demosaicing have nearly a pixel of their own
        blur_px = np.median([b for row in done.findings.blur_px for b in row if b is not None])
        assert 4 <= blur_px <= np.hypot(4, 0.95) + 0.6


@pytest.mark.slow
def test_guide_pictures_match_their_captions():
    pair = render_examples(DESIGN, load_recipe("recommended"))["sensor"]
    for jpeg, rows in zip(pair, (set(), set(SPOILED)), strict=True):
        image = np.asarray(cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR))
        source = given([image], Pinhole.from_sensor(DESIGN))
        done = accept_sensor(source, load_recipe("recommended"), DESIGN)
        assert failed(done) == rows


@pytest.mark.slow
def test_health_starts_from_acceptance(tmp_path):
    assert called("rig", "sensors", "--new", "A1", cwd=tmp_path).returncode == 0
    words = ["rig", "accept", "virtual", "--frames", "12", "--serial", "A1"]
    done = called(*words, "--picture", "face.png", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("virtual: accepted\n")
    assert "simulated, seed 0" in done.stdout
    kept = tomllib.loads((tmp_path / "sensors" / "A1.toml").read_text())
    assert (kept["kind"], kept["gel_batch"]) == ("acceptance", "")
    assert [key.split()[0] for key in kept["events"]] == ["accepted"]
    assert kept["sensor"] == {"design": "deltact", "serial": "A1"}
    assert cv2.imread(str(tmp_path / "face.png")) is not None
    again = called(*words, cwd=tmp_path)
    assert again.returncode == 2
    assert (
        "sensors/A1.toml: has an acceptance; name another file with -o, or remove accep"
        in again.stderr
    )
    rest = cv2.imread(str(tmp_path / "sensors" / "A1.rest.png"))
    folder = tmp_path / "later"
    folder.mkdir()
    cv2.imwrite(str(folder / "0.png"), np.roll(rest, 12, axis=1))
    camera = tmp_path / "camera.toml"
    numbers = Pinhole.from_sensor(DESIGN).as_dict()
    camera.write_text(
        "[camera]\n" + "".join(f"{k} = {json.dumps(v)}\n" for k, v in numbers.items())
    )
    look = ["measure", str(folder), "--camera", str(camera), "--serial", "A1"]
    told = called(*look, cwd=tmp_path)
    assert "the pattern moved by 0.45 mm" in told.stderr
    (row,) = json.loads(called("rig", "sensors", "--json", cwd=tmp_path).stdout)
    assert "the pattern moved by 0.45 mm" in row["health"]
    (tmp_path / "sensors" / "A1.rest.png").write_bytes(b"no")
    told = called(*look, cwd=tmp_path)
    assert told.returncode == 2
    assert "A1.rest.png: differs from the hash in sensors/A1.toml" in told.stderr
    file = tmp_path / "sensors" / "A1.toml"
    file.write_text(file.read_text().partition("[rest]")[0])
    told = called(*look, cwd=tmp_path)
    assert told.returncode == 2
    assert "sensors/A1.toml: rest.file: not an image of the face at rest" in told.stderr


def test_invalid_input_is_one_line(tmp_path):
    (tmp_path / "images").mkdir()
    cv2.imwrite(str(tmp_path / "images" / "0.png"), np.full((48, 64, 3), 90, np.uint8))
    for words, says in (
        (["images"], "RECIPE: missing; a name of `pattern list` or a recipe's file"),
        (["images", "dens"], "did you mean 'dense'?"),
        (["images", "dense", "--serial", "../x"], "--serial '../x': use letters, digits"),
        (["images", "dense"], "image 0 has 64 x 48 px; the design camera has 1280 x 720 px"),
        (["images", "chessboard"], "chessboard: not a dense pattern"),
        (["images", "dense", "--step", "images"], "images: not a run folder"),
    ):
        done = called("rig", "accept", *words, cwd=tmp_path)
        assert done.returncode == 2
        assert says in done.stderr
        assert done.stderr.count("\n") == 1
    assert SensorLedger.file("Δ-1").name == "Δ-1.toml"


@pytest.mark.slow
def test_known_step_detects_wrong_scale(tmp_path):
    """Truth and camera share their projection here; the solver moves the face."""
    done = called("run", "known-step", "--rig", "virtual", "--out", "step", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = check_known_step(tmp_path / "step")
    assert [row.name for row in rows] == ["known step, x", "known step, y"]
    for row in rows:
        seen, made = (
            float(word) for word in row.value.removesuffix(" mm, simulated").split(" of ")
        )
        assert not row.failed
        assert row.value.endswith(", simulated")
        assert made == pytest.approx(0.6, abs=1e-3)
        assert seen == pytest.approx(made, abs=0.004)
    wrong = tmp_path / "wrong"
    shutil.copytree(tmp_path / "step", wrong)
    told = json.loads((wrong / "run.json").read_text())
    told["camera"]["mm_per_px"] *= 1.03
    (wrong / "run.json").write_text(json.dumps(told))
    assert all(row.failed for row in check_known_step(wrong))
    shutil.rmtree(wrong)
    with pytest.raises(InputError, match="no such folder"):
        check_known_step(Path(wrong))
