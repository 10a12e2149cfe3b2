"""Corners in pictures of boards: where they are, and which of the board's they are."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from lenses import DESIGN, SKIN, lens_of
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from deltact_fab.common.errors import InputError
from deltact_fab.estimate.measure.lens.corners import find_corners
from deltact_fab.sensor.optics.checkerboard import Checkerboard
from deltact_fab.sensor.optics.fisheye import Fisheye
from deltact_fab.sensor.shapes.imaging import ImageSensor
from deltact_fab.simulate.virtual.photographs import ON_FACE, BoardPose, Studio

PLATE = Checkerboard(9, 7, 3.0)


def small(true: Fisheye) -> Fisheye:
    """The same lens on a chip of half the size."""
    half = {name: getattr(true, name) / 2 for name in ("f_px", "cx_px", "cy_px")}
    return replace(true, **half, width_px=640, height_px=360)  # type: ignore[arg-type]


LENS = small(replace(lens_of(1), roll_deg=7.0))


@pytest.fixture(scope="module")
def studio() -> Studio:
    return Studio(LENS, ImageSensor(), DESIGN)


@pytest.fixture(scope="module")
def skin(studio: Studio) -> NDArray[np.uint8]:
    return studio.photograph(SKIN, ON_FACE, np.random.default_rng(1))


def test_visible_part_of_skin_found(skin: NDArray[np.uint8]) -> None:
    found = find_corners(skin, SKIN, "skin")
    assert found is not None
    assert len(found.px) > 300
    off = np.linalg.norm(found.px - LENS.rest_px(found.board_mm), axis=1)
    # A corner of another square would be 12 px off.
    assert np.percentile(off, 95) < 0.12
    assert off.max() < 0.5


@pytest.mark.parametrize("contact", [True, False], ids=["face", "air"])
@pytest.mark.parametrize("turn", [0.0, 80.0])
def test_board_corners_match_lens(studio: Studio, contact: bool, turn: float) -> None:
    tilts = (0.0, 0.0) if contact else (18.0, -12.0)
    board = Checkerboard(7, 6, 3.0)
    turned = Rotation.from_euler("xyz", (*tilts, turn), degrees=True)
    pose = BoardPose((1.0, -0.5, 0.0 if contact else 8.0), turned)
    image = studio.photograph(board, pose, np.random.default_rng(3), contact)
    found = find_corners(image, board, "board")
    assert found is not None
    assert len(found.px) == 30
    at = pose.points_mm(found.board_mm)
    off = np.linalg.norm(found.px - LENS.project_px(at, "gel" if contact else "air"), axis=1)
    half_turn = pose.points_mm(-found.board_mm)  # its colours are those of half a turn
    back = np.linalg.norm(
        found.px - LENS.project_px(half_turn, "gel" if contact else "air"), axis=1
    )
    assert min(off.max(), back.max()) < 0.3


def test_other_board_refused_missing_is_none(studio: Studio, skin: NDArray[np.uint8]) -> None:
    with pytest.raises(InputError, match=r"a.png: .* inner corners found, but a board of 9x7x3"):
        find_corners(skin, PLATE, "a.png")
    rng = np.random.default_rng(4)
    assert find_corners(studio.blank(rng), PLATE, "b.png") is None
    assert find_corners(studio.blank(rng), SKIN, "b.png") is None
    coarser = Checkerboard(9, 9, 1.5, skin=True)
    with pytest.raises(InputError, match=r"a.png: .* but a board of 9x9x1.5 has 8 x 8"):
        find_corners(skin, coarser, "a.png")


def test_ambiguous_skin_middle_is_refused(skin: NDArray[np.uint8]) -> None:
    with pytest.raises(InputError, match="another board, or a negative"):
        find_corners(cv2.bitwise_not(skin), SKIN, "negative.png")
