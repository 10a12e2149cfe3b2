"""Camera models as plain data, and camera files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from deltact_fab.common.errors import InputError
from deltact_fab.sensor.optics.camera import CameraModel, Pinhole, axes_mm
from deltact_fab.sensor.optics.fisheye import Fisheye
from deltact_fab.sensor.optics.flat import camera_toml, load_camera, restore_camera
from deltact_fab.sensor.optics.rectified import Rectified
from deltact_fab.sensor.shapes.sensor import SensorDimensions

LENS = Fisheye(k1=-0.02, air_gap_mm=2.7, pupil_shift_mm=-0.3)
MODELS: list[CameraModel] = [
    Pinhole.from_sensor(SensorDimensions()),
    LENS,
    Rectified.from_sensor(SensorDimensions(), LENS),
]


@pytest.mark.parametrize("camera", MODELS, ids=lambda camera: type(camera).__name__.lower())
def test_camera_models_round_trip(camera: CameraModel, tmp_path: Path) -> None:
    data = json.loads(json.dumps(camera.as_dict()))
    assert data["model"] == type(camera).__name__.lower()
    assert restore_camera(data) == camera
    file = tmp_path / "camera.toml"
    file.write_text(camera_toml(camera))
    assert load_camera(file) == (camera, {})


@pytest.mark.parametrize(
    ("data", "says"),
    [
        ({"model": "pinhoel"}, "model: 'pinhoel'; did you mean 'pinhole'"),
        ({**MODELS[0].as_dict(), "width_px": "wide"}, "width_px: .*'wide'"),
        ({**LENS.as_dict(), "f_pix": 3.0}, "f_pix: unknown key; did you mean 'f_px'"),
        ({**MODELS[2].as_dict(), "lens": {"model": "pinhole"}}, "lens.model: 'pinhole'; valid: "),
        ({**MODELS[2].as_dict(), "lens": {"k7": 1.0}}, "lens.k7: unknown key"),
    ],
)
def test_invalid_camera_data_is_one_line(data: dict[str, object], says: str) -> None:
    with pytest.raises(InputError, match=rf"^run\.json: {says}") as refused:
        restore_camera(data, "run.json")
    assert "\n" not in str(refused.value)


def test_camera_file_keeps_other_tables(tmp_path: Path) -> None:
    tables = {
        "calibration": {
            "free": ["f_px", "k1"],
            "covariance": [[1e-9, -2.5e-12], [-2.5e-12, 3e-7]],
            "rms_px": 0.04,
            "face": {"sigma_px": 0.021, "wetted": True},
        }
    }
    file = tmp_path / "camera.toml"
    file.write_text(camera_toml(LENS, tables, ["of a chessboard skin", 'by "hand"']))
    assert load_camera(file) == (LENS, tables)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("f_px = 388.0", "camera: missing table"),
        ("[camera]\nf_px = 388.0", "camera.model: missing key; valid: fisheye, pinhole, rectified"),
        ('[camera]\nmodel = "fisheye"\nf_px = "long"', "camera: f_px: .*'long'"),
        (
            '[camera]\nmodel = "fisheye"\nn_gel = 0.5',
            "camera: n_gel: 0.5; expected 1 <= n_gel <= 3",
        ),
        ("[camera", "not valid TOML"),
    ],
)
def test_invalid_camera_file_is_one_line(tmp_path: Path, text: str, says: str) -> None:
    file = tmp_path / "camera.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=rf"camera\.toml: {says}") as refused:
        load_camera(file)
    assert "\n" not in str(refused.value)


def test_model_without_name_is_pinhole() -> None:
    data = {key: value for key, value in MODELS[0].as_dict().items() if key != "model"}
    assert restore_camera(data) == MODELS[0]


def test_axes_match_pixels_at_rest() -> None:
    camera = MODELS[0]
    xs_mm, ys_mm = axes_mm(camera, 2)
    corners_px = np.array([[-2.0, -2.0], [camera.width_px + 1.0, camera.height_px + 1.0]])
    ends_mm = np.array([[xs_mm[0], ys_mm[0], 0.0], [xs_mm[-1], ys_mm[-1], 0.0]])
    np.testing.assert_allclose(camera.rest_mm(corners_px), ends_mm[:, :2], rtol=1e-14)
    np.testing.assert_allclose(camera.project_px(ends_mm), corners_px, atol=1e-9)
    with pytest.raises(ValueError, match="has distortion"):
        axes_mm(LENS)
