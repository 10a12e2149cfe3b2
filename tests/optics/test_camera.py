"""A camera's axes at rest, and the camera of an old record."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np

from deltact_fab import record
from deltact_fab.optics import Pinhole, axes_mm
from deltact_fab.shapes import SensorDimensions

CAMERA = Pinhole.of(SensorDimensions())


def test_axes_are_where_the_pixels_are_at_rest() -> None:
    xs_mm, ys_mm = axes_mm(CAMERA, 2)
    assert (len(xs_mm), len(ys_mm)) == (CAMERA.width_px + 4, CAMERA.height_px + 4)
    corners_px = np.array([[-2.0, -2.0], [CAMERA.width_px + 1.0, CAMERA.height_px + 1.0]])
    ends_mm = np.array([[xs_mm[0], ys_mm[0]], [xs_mm[-1], ys_mm[-1]]])
    np.testing.assert_allclose(CAMERA.rest_mm(corners_px), ends_mm, rtol=1e-14)
    np.testing.assert_allclose(CAMERA.rest_px(ends_mm), corners_px, atol=1e-9)
    at_rest = np.concatenate((ends_mm, np.zeros((2, 1))), axis=1)
    np.testing.assert_allclose(CAMERA.project_px(at_rest), corners_px, atol=1e-9)


def test_a_run_from_before_models_had_names_is_read_as_a_pinhole(
    mini_run: Path, tmp_path: Path
) -> None:
    old = shutil.copytree(mini_run, tmp_path / "old")
    meta = json.loads((old / "run.json").read_text())
    assert meta["camera"].pop("model") == "pinhole"
    (old / "run.json").write_text(json.dumps(meta))
    assert record.open(old).camera == record.open(mini_run).camera == CAMERA
    truth = record.open(old).truth()
    assert truth is not None
    assert truth.camera == CAMERA
