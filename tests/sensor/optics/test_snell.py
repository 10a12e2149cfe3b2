"""Rays through air, acrylic and gel."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltact_fab.sensor.optics.fisheye import LayeredPath

PLATE = (2.0, 12.0)


@pytest.mark.parametrize(
    ("gap_mm", "radius_mm", "degrees"), [(3.0, 15.1, 58), (3.0, 18.7, 67), (0.5, 11.1, 58)]
)
def test_half_angles_of_papers_sensing_area(gap_mm, radius_mm, degrees):
    found = math.degrees(LayeredPath(gap_mm, *PLATE).half_angle_rad(radius_mm))
    assert found == pytest.approx(degrees, abs=0.7)


def test_paraxial_rays_meet_the_apparent_distance():
    # d r / d t at 0 = g + t / n + t / n
    slope = LayeredPath(3.0, *PLATE).reach_mm(1e-6) / 1e-6
    assert slope == pytest.approx(3.0 + 2 / 1.49 + 12 / 1.41, rel=1e-9)


@given(st.floats(0.1, 10), st.floats(0.5, 5), st.floats(1, 30), st.floats(0, 1.4))
def test_angle_is_inverse_of_reach(gap_mm, acrylic_mm, gel_mm, angle):
    radius = LayeredPath(gap_mm, acrylic_mm, gel_mm).reach_mm(angle)
    assert LayeredPath(gap_mm, acrylic_mm, gel_mm).half_angle_rad(radius) == pytest.approx(
        angle, abs=1e-9
    )
