"""Lenses as they are put together by hand, and how far a calibrated one is from its true one."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from deltact_fab.estimate.measure.lens.corners import Corners
from deltact_fab.estimate.measure.lens.problem import BoardView
from deltact_fab.estimate.measure.lens.trust import view_mm
from deltact_fab.sensor.optics.checkerboard import Checkerboard
from deltact_fab.sensor.optics.fisheye import Fisheye
from deltact_fab.sensor.shapes.sensor import SensorDimensions
from deltact_fab.simulate.virtual.photographs import ON_FACE, BoardPose

DESIGN = SensorDimensions()
SKIN = Checkerboard(23, 23, 1.5, skin=True)
LIMITS_PX: Mapping[float, float] = {0.0: 0.1, 3.0: 0.5, 6.0: 1.0}
"""At depths below the face: what a calibrated lens may be off by, at the view's 95th percentile."""


def lens_of(seed: int) -> Fisheye:
    """Off centre, tilted, turned, with a pupil that moves; layers as exact as their priors say."""
    rng = np.random.default_rng([seed, 19])

    def within(half: float) -> float:
        return float(rng.uniform(-half, half))

    return Fisheye(
        f_px=388 * (1 + within(0.02)),
        k1=-0.02 + within(0.02),
        k2=within(0.006),
        cx_px=639.5 + within(12),
        cy_px=359.5 + within(12),
        tilt_x_deg=within(1.5),
        tilt_y_deg=within(1.5),
        roll_deg=within(1.0),
        x0_mm=within(0.4),
        y0_mm=within(0.4),
        air_gap_mm=3 + within(0.5),
        pupil_shift_mm=0.3 + within(0.3),
        acrylic_mm=2 + 0.05 * float(rng.standard_normal()),
        gel_mm=12 + 0.1 * float(rng.standard_normal()),
        n_acrylic=1.49 + 0.003 * float(rng.standard_normal()),
        n_gel=1.41 + 0.005 * float(rng.standard_normal()),
    )


def off_px(
    found: Fisheye, true: Fisheye, depth_mm: float, aligned: bool = False
) -> NDArray[np.float64]:
    """Raw px between where the two see the points of the view, (n,), depth_mm below the face.

    aligned: the sensor's frame is the calibration's own choice, and is brought to the true one by
    the shift and turn in the plane of the face that fit best: boards say nothing of it.
    """
    origin, slope = true.ray(true.rest_px(view_mm(DESIGN)), "gel")
    at = origin - depth_mm * slope
    moved = at.copy()
    if aligned:
        a, b = origin[:, :2], found.rest_mm(true.rest_px(origin[:, :2]))
        u, _, v = np.linalg.svd((a - a.mean(0)).T @ (b - b.mean(0)))
        moved[:, :2] = (at[:, :2] - a.mean(0)) @ (u @ v) + b.mean(0)
    return np.linalg.norm(found.project_px(moved) - true.project_px(at), axis=1)


def p95_px(found: Fisheye, true: Fisheye, aligned: bool = False) -> dict[float, float]:
    """The 95th percentile over the view, at each depth of the limits."""
    return {d: float(np.percentile(off_px(found, true, d, aligned), 95)) for d in LIMITS_PX}


def exact(
    true: Fisheye,
    board: Checkerboard,
    pose: BoardPose = ON_FACE,
    *,
    contact: bool = True,
    noise_px: float = 0.05,
    outliers: int = 0,
    printed: tuple[float, float] = (1.0, 1.0),
    seed: int = 0,
) -> BoardView:
    """A board's corners where the lens sees them, with noise; some moved by 3 px.

    printed: what became of its sides in x and y.
    """
    rng = np.random.default_rng(seed)
    index = np.stack(np.meshgrid(*(np.arange(n) for n in board.corners)), -1).reshape(-1, 2)
    at = pose.points_mm(board.at_mm(index) * printed)
    px = true.project_px(at, "gel" if contact else "air")
    last = np.array([true.width_px, true.height_px]) - 1
    seen = np.all((px >= 5) & (px <= last - 5), axis=1)
    px = px[seen] + noise_px * rng.standard_normal((int(seen.sum()), 2))
    px[rng.choice(len(px), outliers, replace=False)] += 3.0
    return BoardView(Corners("board.png", board, px, index[seen]), contact)
