"""The star of the search's smaller views: its figures are those of the wide one."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from benchmarks.star import Star

STAR = Star(520, 382, most_px=172.0)


def motion() -> np.ndarray:
    x, y = np.meshgrid(np.arange(520.0), np.arange(382.0))
    return STAR.motion(x, y).astype(np.float32)


@pytest.mark.parametrize("side", [7, 13, 21])
def test_a_box_loses_a_tenth_at_four_times_its_side(side: int) -> None:
    seen = np.asarray(cv2.blur(motion(), (1, side)))
    assert STAR.figures(seen).loss_px == pytest.approx(4 * side, rel=0.07)


def test_a_flow_that_follows_nothing_has_lost_every_period() -> None:
    assert STAR.figures(np.zeros_like(motion())).loss_px > 0.95 * STAR.most_px
