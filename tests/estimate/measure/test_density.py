"""Gaussian density: closed forms, the paper's splat against the Jacobian, and where it holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from deltact_fab.estimate.measure.face import FaceFlow
from deltact_fab.estimate.measure.shape.density import jacobian_density

MM_PER_PX = 0.04


def _flow(motion, every: int = 1) -> FaceFlow:
    """A face of 12 x 9 mm whose point (x, y) mm is shifted by motion(x, y), mm."""
    x, y = (
        (np.arange(side // every) * every + (every - 1) / 2) * MM_PER_PX - side * MM_PER_PX / 2
        for side in (304, 224)
    )
    shift = np.stack(np.broadcast_arrays(*motion(*np.meshgrid(x, y))), axis=-1)
    return FaceFlow(shift.astype(np.float32), np.ones(shift.shape[:2], bool), x, y)


def _bump(height: float, width_mm: float = 1.0):
    """Spreads what is inside and crowds what is around: the flow of a radial Gaussian."""

    def motion(x, y):
        grow = height * np.exp(-(x * x + y * y) / (2 * width_mm**2))
        return x * grow, y * grow

    return motion


@pytest.mark.parametrize("every", [1, 16])  # farther apart than sigma, too
def test_uniform_expansion_thins_by_determinant(every):
    seen = jacobian_density(_flow(lambda x, y: (0.3 * x + 0.1 * y, 0.1 * y), every), MM_PER_PX)
    assert np.allclose(seen.value, 1 / (1.3 * 1.1), atol=2e-3)


def _splat(flow: FaceFlow, at: np.ndarray) -> np.ndarray:
    """The paper's density where the points with these numbers landed: a Gaussian at every point."""
    landed = (np.stack(np.meshgrid(flow.x_mm, flow.y_mm), axis=-1) + flow.shift_mm).reshape(-1, 2)
    sigma2 = (3 * MM_PER_PX) ** 2
    far2 = ((landed[at, None] - landed) ** 2).sum(-1)
    return np.exp(-far2 / (2 * sigma2)).sum(1) * flow.cell_mm**2 / (2 * np.pi * sigma2)


def test_density_equals_paper_splat():
    flow = _flow(_bump(0.35))
    seen = jacobian_density(flow, MM_PER_PX)
    assert seen.reliable.mean() > 0.9
    number = np.arange(seen.value.size).reshape(seen.value.shape)[15:-15:16, 15:-15:16]
    at = number[seen.reliable[15:-15:16, 15:-15:16]]
    jacobian, splat = seen.value.ravel()[at], _splat(flow, at)
    assert jacobian.min() < 0.6
    assert jacobian.max() > 1.1
    assert np.corrcoef(jacobian, splat)[0, 1] > 0.999
    assert np.abs(jacobian - splat).max() < 0.04


def test_small_features_keep_gaussian_slope():
    waves = 2 * np.pi / (18 * MM_PER_PX)
    got = jacobian_density(_flow(lambda x, y: (0.02 / waves * np.sin(waves * x), 0 * y)), MM_PER_PX)
    left = np.exp(-0.5 * (3 * MM_PER_PX * waves) ** 2)
    assert np.ptp(1 / got.value) / 2 == pytest.approx(0.02 * left, rel=0.01)


def test_fold_and_lost_point_flagged():
    folded = _flow(lambda x, y: (-1.5 * np.exp(-((x / 0.5) ** 2)) * np.sign(x), 0 * y))
    seen = jacobian_density(folded, MM_PER_PX)
    assert np.isfinite(seen.value).all()
    assert not seen.reliable[:, 150:154].any()
    assert seen.reliable[:, :60].all()
    known = np.ones_like(folded.known)
    known[100, 40] = False
    rest = replace(_flow(lambda x, y: (0 * x, 0 * y)), known=known)
    lost = ~jacobian_density(rest, MM_PER_PX).reliable
    assert lost[100, 40]
    assert lost[100, 34]
    assert lost.sum() == 13 * 13
