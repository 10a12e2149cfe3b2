"""The flat field: light that falls off is made even, and the file beside the camera's."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from deltact_fab.common.errors import InputError
from deltact_fab.physics.imaging import Exposure, view_grid
from deltact_fab.sensor.optics.fisheye import Fisheye
from deltact_fab.sensor.optics.flat import FlatField, camera_toml
from deltact_fab.sensor.optics.rectified import Rectified
from deltact_fab.sensor.shapes.imaging import ImageSensor

LENS = Fisheye(f_px=194, cx_px=319.5, cy_px=179.5, width_px=640, height_px=360)
VIEW = Rectified(LENS, mm_per_px=0.0756, width_px=399, height_px=293)
SENSOR = ImageSensor(shading=0.5)


def lit(level: float, seed: int) -> NDArray[np.uint8]:
    exposure = Exposure(SENSOR, view_grid(LENS.height_px, LENS.width_px))
    even = np.full((LENS.height_px, LENS.width_px, 3), level, np.float32)
    return exposure.expose(even, np.random.default_rng(seed))


@pytest.fixture
def camera(tmp_path: Path) -> Path:
    flat = FlatField.from_blank(lit(0.6, 1), "blank.png")
    (tmp_path / "camera.flat.png").write_bytes(flat.to_png())
    path = tmp_path / "camera.toml"
    path.write_text(camera_toml(LENS, {"flat": {"file": "camera.flat.png"}}))
    return path


def coarse(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Means over blocks, without their noise."""
    return cv2.resize(image, (16, 9), interpolation=cv2.INTER_AREA).astype(float)


def test_vignetting_is_corrected(camera: Path) -> None:
    flat = FlatField.from_camera_file(camera)
    assert flat is not None
    image = lit(0.35, 2)
    before, after = coarse(image), coarse(flat.apply(image))
    assert np.ptp(before) > 25
    assert np.ptp(after) < 3
    assert after.mean() == pytest.approx(before.max(), abs=3)
    grey = flat.apply(np.ascontiguousarray(image[..., 1]))
    assert np.ptp(cv2.resize(grey, (16, 9), interpolation=cv2.INTER_AREA)) < 3


def test_the_colour_of_the_light_stays(camera: Path) -> None:
    colour = np.array([0.5, 0.8, 1.0])
    blank = FlatField.from_blank((lit(0.6, 1) * colour).astype(np.uint8), "blank.png")
    even = FlatField.from_camera_file(camera)
    assert even is not None
    assert np.abs(blank.share - even.share).max() < 0.05


def test_rectified_first_is_the_same(camera: Path) -> None:
    flat = FlatField.from_camera_file(camera)
    assert flat is not None
    image = cv2.GaussianBlur(lit(0.35, 3), (0, 0), 2)
    first = VIEW.rectify(flat.apply(image)).astype(int)
    later = flat.for_view(VIEW).apply(VIEW.rectify(image)).astype(int)
    assert np.abs(first - later).max() <= 2


def test_invalid_flat_field_is_refused(camera: Path) -> None:
    for level, says in ((255, "over-exposed"), (3, "too dark")):
        with pytest.raises(InputError, match=f"^blank.png: {says}"):
            FlatField.from_blank(np.full((360, 640, 3), level, np.uint8), "blank.png")
    flat = FlatField.from_camera_file(camera)
    assert flat is not None
    with pytest.raises(InputError, match="flat field of 640 x 360 px, image of 8 x 8"):
        flat.apply(np.zeros((8, 8, 3), np.uint8))
    (camera.parent / "camera.flat.png").unlink()
    with pytest.raises(
        InputError, match=r"camera.toml: flat.file: .*: not a 16-bit flat field image"
    ):
        FlatField.from_camera_file(camera)
    camera.write_text(camera_toml(LENS))
    assert FlatField.from_camera_file(camera) is None
