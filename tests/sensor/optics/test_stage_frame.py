"""Sensor frame to machine frame and back: rigid, with a face that lies askew too."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltact_fab.sensor.optics.camera import StageFrame

MM = st.floats(-200, 200)
PLACE = st.tuples(MM, MM, MM)
TILT = st.floats(-5, 5)
FRAME = st.builds(StageFrame, PLACE, st.floats(-360, 360), st.tuples(TILT, TILT))


@given(FRAME, PLACE)
def test_there_and_back(frame: StageFrame, place: tuple[float, float, float]) -> None:
    assert frame.to_sensor_mm(frame.to_machine_mm(place)) == pytest.approx(place, abs=1e-10)


@given(FRAME)
def test_frame_is_rotation_and_shift(frame: StageFrame) -> None:
    origin = np.array(frame.to_machine_mm((0, 0, 0)))
    axes = np.array([frame.to_machine_mm(p) for p in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]) - origin
    assert tuple(origin) == frame.origin_machine_mm
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-10)
    assert np.linalg.det(axes) == pytest.approx(1.0)


@given(PLACE, st.floats(-360, 360), PLACE)
def test_no_tilt_changes_no_bit(
    origin: tuple[float, float, float], angle: float, p: tuple[float, float, float]
) -> None:
    c, s = float(np.cos(np.deg2rad(angle))), float(np.sin(np.deg2rad(angle)))
    expected = (origin[0] + c * p[0] - s * p[1], origin[1] + s * p[0] + c * p[1], origin[2] + p[2])
    assert StageFrame(origin, angle).to_machine_mm(p) == expected


def test_signs_of_the_tilt() -> None:
    about_x = StageFrame((0.0, 0.0, 0.0), tilt_deg=(1.0, 0.0))
    assert about_x.to_machine_mm((0, 10, 0)) == pytest.approx((0, 9.9985, 0.17452), abs=1e-4)
    about_y = StageFrame((0.0, 0.0, 0.0), tilt_deg=(0.0, 1.0))
    assert about_y.to_machine_mm((10, 0, 0)) == pytest.approx((9.9985, 0, -0.17452), abs=1e-4)


@given(FRAME)
def test_tilt_from_face_normal(frame: StageFrame) -> None:
    top, origin = frame.to_machine_mm((0, 0, 3.0)), frame.origin_machine_mm
    normal = (top[0] - origin[0], top[1] - origin[1], top[2] - origin[2])
    found = StageFrame(origin, frame.angle_deg).with_normal(normal)
    assert found.tilt_deg == pytest.approx(frame.tilt_deg, abs=1e-9)


@pytest.mark.parametrize("normal", [(0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.0, 0.0, math.nan)])
def test_a_normal_that_is_none(normal: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="must point up"):
        StageFrame((0.0, 0.0, 0.0)).with_normal(normal)
