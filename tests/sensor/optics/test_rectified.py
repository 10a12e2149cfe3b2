"""The view of the face out of a fisheye's image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from deltact_fab.common.errors import InputError
from deltact_fab.sensor.optics.camera import axes_mm
from deltact_fab.sensor.optics.fisheye import Fisheye
from deltact_fab.sensor.optics.rectified import Rectified
from deltact_fab.sensor.shapes.sensor import SensorDimensions

SENSOR = SensorDimensions()
LENS = Fisheye(
    k1=-0.02, cx_px=645.0, tilt_x_deg=1.5, tilt_y_deg=-2.0, roll_deg=1.0, x0_mm=0.3,
    air_gap_mm=2.8, pupil_shift_mm=-0.3,
)  # fmt: skip
VIEW = Rectified.from_sensor(SENSOR, LENS)


@pytest.mark.slow
def test_face_is_rectified_to_uniform_scale():
    def shade(xy_mm):
        return 128 + 60 * np.cos(2 * np.pi * xy_mm[..., 0] / 2.1) * np.sin(xy_mm[..., 1] * 2.3)

    pixels = np.stack(np.meshgrid(np.arange(1280.0), np.arange(720.0)), axis=-1)
    raw = np.nan_to_num(shade(LENS.rest_mm(pixels))).astype(np.float32)
    view = VIEW.rectify(raw)
    xs, ys = axes_mm(VIEW)
    wanted = shade(np.stack(np.meshgrid(xs, ys), axis=-1))
    assert VIEW.visible_pixels().all()
    # What cubic interpolation and the 1/32 px of its table leave, of an amplitude of 60.
    assert np.abs(view - wanted).max() < 1.5
    colour = VIEW.rectify(np.dstack([raw] * 3))
    assert np.array_equal(colour[..., 1], view)


def test_pixels_outside_raw_image_are_masked():
    view = Rectified.from_sensor(SENSOR, replace(LENS, cx_px=980.0))
    seen = view.visible_pixels()
    assert not seen[:, -5].any()
    assert seen[:, :600].all()
    picture = view.rectify(np.full((720, 1280), 200, np.uint8))
    assert (picture[:, -5] == 0).all()
    assert (picture[seen] == 200).all()


def test_invalid_views_are_refused():
    for z_mm in (-12.0, np.nan):
        with pytest.raises(InputError, match="in the gel"):
            VIEW.project_px(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, z_mm]]))
    with pytest.raises(InputError, match="image of 798 x 586 px; the lens has 1280 x 720 px"):
        VIEW.rectify(np.zeros((586, 798), np.uint8))


def test_raw_image_is_coarser_in_corners():
    view = Rectified.from_sensor(SENSOR)
    cx, cy = view.centre_px
    scales = view.raw_mm_per_px(np.array([[cx, cy], [0.0, cy], [0.0, 0.0]]))
    np.testing.assert_allclose(
        scales, [[0.0331, 0.0331], [0.053, 0.0386], [0.071, 0.0415]], atol=1e-4
    )


def test_papers_patch_is_mostly_aliased():
    view = Rectified.from_sensor(SENSOR)
    assert view.aliased_share(0.075) == pytest.approx(0.746, abs=0.005)
    assert view.aliased_share(0.15) == 0.0
    assert view.aliased_share(0.06) == 1.0
