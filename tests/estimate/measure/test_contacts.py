"""Contacts in maps of depth that were drawn: how many, where, how large, and what they carry."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from deltact_fab.estimate.measure.face import FaceFlow
from deltact_fab.estimate.measure.force.model import TractionField
from deltact_fab.estimate.measure.shape.depth import Depth, find_contacts
from deltact_fab.sensor.optics.camera import Pinhole

CAMERA = Pinhole(0.0378, 798, 586, 12.85)
CELL = 0.15
X, Y = np.arange(-14, 14, CELL), np.arange(-10, 10, CELL)
AT = np.stack(np.meshgrid(X, Y), axis=-1)


def _depth(*caps: tuple[float, float, float, float]) -> Depth:
    """Paraboloids (x, y, depth, radius) mm pressed into the face."""
    depth = np.zeros(AT.shape[:2], np.float32)
    for x, y, deep, radius in caps:
        r2 = ((AT - (x, y)) ** 2).sum(-1) / radius**2
        depth = np.maximum(depth, np.float32(deep) * np.maximum(1 - r2, 0).astype(np.float32))
    return Depth(depth, np.ones(depth.shape, bool), X, Y, 1.0, False)


def _flow(shift: tuple[float, float] = (0, 0)) -> FaceFlow:
    moved = np.broadcast_to(np.float32(shift), AT.shape).copy()
    return FaceFlow(moved, np.ones(AT.shape[:2], bool), X, Y)


def test_cap_centre_rim_and_outline():
    (one,) = find_contacts(_depth((3.0, -2.0, 1.0, 4.0)), _flow(), CAMERA)
    area = np.pi * 4.0**2 * 0.7
    assert one.area_mm2 == pytest.approx(area, rel=0.02)
    assert np.allclose(one.centroid_mm, (3, -2), atol=0.03)
    assert one.peak_depth_mm == pytest.approx(1.0, abs=0.01)
    assert (one.force_share, one.cover) == (None, 1.0)
    edge = one.outline_mm.astype(np.float32)
    assert cv2.contourArea(edge[:, None]) == pytest.approx(area, rel=0.04)
    far = np.linalg.norm(one.outline_mm - (3, -2), axis=1)
    assert np.abs(far - 4 * np.sqrt(0.7)).max() < CELL


def test_contact_position_corrected_for_parallax():
    """Seen off the axis a depth is motion, outwards; the rest of the motion is the shear."""
    depth = _depth((6.0, 0.0, 1.0, 3.0))
    sheared = AT + (0.8, -0.5)
    z = -depth.depth_mm
    px = CAMERA.project_px(np.concatenate((sheared, z[..., None]), axis=-1))
    shift = (CAMERA.rest_mm(px) - AT).astype(np.float32)
    (one,) = find_contacts(depth, FaceFlow(shift, depth.valid, X, Y), CAMERA)
    assert np.allclose(one.centroid_mm, (6, 0), atol=0.03)
    assert np.allclose(one.place_mm, (6.8, -0.5), atol=0.03)


def test_two_contacts_share_pressure():
    depth = _depth((-5.0, 0.0, 1.0, 3.0), (5.0, 1.0, 0.4, 2.0))
    pressure = np.where(AT[..., 0] < 0, 3.0, 1.0) * (depth.depth_mm > 0)
    sums = [pressure[:, X < 0].sum(), pressure[:, X >= 0].sum()]
    field = np.stack((0 * pressure, 0 * pressure, -pressure), axis=-1)
    found = find_contacts(depth, _flow(), CAMERA, TractionField(field, X, Y, 1.0))
    assert [round(c.peak_depth_mm, 1) for c in found] == [1.0, 0.4]
    assert np.allclose([c.force_share for c in found], np.array(sums) / sum(sums))


@pytest.mark.parametrize(("apart", "number"), [(3.0, 1), (5.0, 2)])
def test_merged_peaks_are_one_contact(apart, number):
    near = _depth((-apart / 2, 0.0, 1.0, 3.5), (apart / 2, 0.0, 0.9, 3.5))
    assert len(find_contacts(near, _flow(), CAMERA)) == number


def _count(*caps: tuple[float, float, float, float]) -> str:
    """Count in the deepest region of caps."""
    return find_contacts(_depth(*caps), _flow(), CAMERA)[0].count


@pytest.mark.parametrize("radius", [2.0, 4.0, 8.0])
def test_round_region_is_one_contact(radius):
    assert _count((0.0, 1.0, 1.0, radius)) == "one"
    assert _count((0.0, 1.0, 0.09, radius)) == "cannot tell"  # as shallow as noise


@pytest.mark.parametrize(
    ("apart", "count"), [(0.5, "one"), (2.2, "cannot tell"), (3.4, "two or more")]
)
def test_count_of_two_merged_caps(apart, count):
    assert _count((-apart / 2, 0.0, 1.0, 3.5), (apart / 2, 0.0, 0.95, 3.5)) == count


def test_one_long_contact_cannot_be_told():
    capsule = [(x, 0.0, 1.0, 3.0) for x in np.arange(-2, 2.1, CELL)]
    assert _count(*capsule) == "cannot tell"


def test_second_peak_below_half_depth():
    """The upper half alone is round."""
    assert _count((0.0, 0.0, 1.0, 3.0), (2.8, 0.0, 0.48, 3.0)) == "cannot tell"


@pytest.mark.parametrize("damage", ["hidden", "cut off"])
def test_region_seen_in_part_is_undecided(damage):
    depth = _depth((0.0, Y[-1] - 3.5, 1.0, 4.0))
    (whole,) = find_contacts(depth, _flow(), CAMERA)
    if damage == "hidden":
        depth.valid[:, X > 1.5] = False
    else:
        depth = _depth((0.0, Y[-1] - 2.5, 1.0, 4.0))
    (part,) = find_contacts(depth, _flow(), CAMERA)
    assert (whole.count, part.count) == ("one", "cannot tell")


def test_resolution_grows_with_width_and_noise():
    wide, narrow, shallow = (
        find_contacts(_depth((0.0, 0.0, *cap)), _flow(), CAMERA)[0].resolution_mm
        for cap in ((1.0, 6.0), (1.0, 3.0), (0.2, 3.0))
    )
    assert wide == pytest.approx(2 * narrow, rel=0.02)
    assert shallow > 1.1 * narrow
    assert _count((-wide / 2, 0.0, 1.0, 6.0), (wide / 2, 0.0, 0.8, 6.0)) != "one"


def test_rest_has_no_contact():
    assert find_contacts(_depth(), _flow(), CAMERA) == []
    depth = _depth((0.0, 0.0, 1.0, 4.0))
    depth.valid[:, X > 0] = False
    (one,) = find_contacts(depth, _flow(), CAMERA)
    assert one.cover == pytest.approx(0.5, abs=0.03)
