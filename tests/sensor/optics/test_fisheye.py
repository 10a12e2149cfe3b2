"""The lens's own image: what it refuses, what it cannot see, and its conventions."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from deltact_fab.common import catalog
from deltact_fab.common.errors import InputError
from deltact_fab.sensor.optics.fisheye import Fisheye
from deltact_fab.sensor.shapes.sensor import SensorDimensions

LENS = Fisheye.from_sensor(SensorDimensions())


def test_nominal_lens_has_designs_layers():
    data = {"optics": {"air_gap_mm": 4.0, "acrylic_mm": 3.0}, "skin": {"thickness_mm": 10.0}}
    lens = Fisheye.from_sensor(catalog.validate(SensorDimensions, data, "mine.toml"))
    assert (lens.air_gap_mm, lens.acrylic_mm, lens.gel_mm) == (4.0, 3.0, 10.0)
    assert lens.mm_per_px == pytest.approx((4 + 3 / 1.49 + 10 / 1.41) / lens.f_px, rel=1e-12)
    apart = lens.rest_px(np.array([[0.005, 0.0], [-0.005, 0.0]]))
    assert 0.01 / (apart[0, 0] - apart[1, 0]) == pytest.approx(lens.mm_per_px, rel=1e-6)


def test_image_axes_match_sensor_axes():
    right, below = LENS.rest_px(np.array([[2.0, 0.0], [0.0, 2.0]])) - LENS.centre_px
    assert right == pytest.approx((right[0], 0), abs=1e-9)
    assert right[0] > 0
    assert below == pytest.approx((0, right[0]), abs=1e-9)


def test_a_positive_turn_is_right_handed():
    """About x the axis swings to -y, about y to +x, and a turned camera turns the image back."""
    for change, axis_meets in (
        ({"tilt_x_deg": 2.0}, (0.0, -1.0)),
        ({"tilt_y_deg": 2.0}, (1.0, 0.0)),
    ):
        lens = dataclasses.replace(LENS, **change)
        met = lens.rest_mm(np.asarray(lens.centre_px))
        np.testing.assert_allclose(met / np.linalg.norm(met), axis_meets, atol=1e-9)
    rolled = dataclasses.replace(LENS, roll_deg=90.0)
    seen = rolled.rest_px(np.array([0.0, 3.0])) - rolled.centre_px
    assert seen == pytest.approx(LENS.rest_px(np.array([3.0, 0.0])) - LENS.centre_px, abs=1e-9)


def test_points_outside_the_field_are_nan():
    beyond = np.array([[1279.0, 719.0], [1260.0, 359.5]])  # beyond the field; rays that rise
    assert np.isnan(LENS.rest_mm(beyond)).all()
    origin, way = LENS.ray(beyond)
    assert np.isnan(origin[:, :2]).all()
    assert np.isnan(way[:, :2]).all()
    assert np.isfinite(LENS.rest_mm(np.array([[1200.0, 359.5]]))).all()


@pytest.mark.parametrize(
    ("point", "medium", "says"),
    [
        ([0.0, 0.0, -12.0], "gel", "in the gel, z > -12"),
        ([0.0, 0.0, -0.1], "air", "in air, z >= 0"),
        ([0.0, np.nan, 0.0], "gel", "in the gel"),
    ],
)
def test_point_outside_its_medium_is_refused(point, medium, says):
    with pytest.raises(InputError, match=says):
        LENS.project_px(np.array([[1.0, 1.0, 0.0], point]), medium)


def test_field_ends_where_radius_stops_growing():
    lens = dataclasses.replace(LENS, k1=-0.3)
    ends_rad = np.sqrt(0.9 / 0.9)  # 1 - 0.9 theta^2 = 0.1
    assert lens.field_rad == pytest.approx(ends_rad)
    ends_px = lens.f_px * ends_rad * (1 - 0.3 * ends_rad**2)
    at = np.array([[lens.cx_px + ends_px - 0.01, lens.cy_px], [lens.cx_px + ends_px + 1, 0]])
    seen = lens.rest_mm(at)
    assert lens.rest_px(seen[0]) == pytest.approx(at[0], abs=1e-9)
    assert np.isnan(seen[1]).all()
    with pytest.raises(InputError, match=r"63\.1 degrees from the lens's axis, .* of 57\.3"):
        lens.rest_px(seen[0] * 1.15)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"f_px": 0.0}, r"10 <= f_px <= 10000: 0 fails"),
        ({"tilt_x_deg": 20.0}, r"tilt_x_deg <= 10: 20 fails"),
        ({"n_gel": float("nan")}, r"n_gel <= 3: nan fails"),
        ({"pupil_shift_mm": -1.5}, r"air_gap_mm \+ 3\.05 pupil_shift_mm > 0: -1\.5\d+ fails"),
    ],
)
def test_impossible_lens_values_are_refused(change, says):
    with pytest.raises(ValueError, match=says):
        dataclasses.replace(LENS, **change)
