"""The lens: how far a calibrated one is from the one that saw the boards, by the number of views.

Corners are known exactly but for noise of 0.05 px and follow the law that is fitted: a self-test. A
lens is judged where it sees points 3 mm below the face, on rays that no board of it fixes alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ...measure.lens import Calibration, Checkerboard, of_corners
from ...measure.lens.corners import Corners
from ...measure.lens.problem import BoardView
from ...measure.lens.trust import view_mm
from ...optics import Fisheye
from ...shapes import SensorDimensions
from ...virtual.photographs import ON_FACE, BoardPose
from ..engine import Case, CurveSetting, Engine, Work

SEED, DRAWS, NOISE_PX, DEPTH_MM = 7, 5, 0.05, 3.0
SIZE_PX = (1280, 720)
DESIGN = SensorDimensions()
SKIN, PLATE = Checkerboard(23, 23, 1.5, skin=True), Checkerboard(9, 7, 3.0)
# Off centre, tilted and turned, its thicknesses not those of the design.
TRUE = Fisheye(f_px=392, k1=-0.03, k2=0.003, cx_px=645, cy_px=353, tilt_x_deg=0.8, tilt_y_deg=-1.1,
               roll_deg=0.5, x0_mm=0.2, y0_mm=-0.3, air_gap_mm=3.3, pupil_shift_mm=0.4,
               acrylic_mm=2.03, gel_mm=12.1, n_acrylic=1.492, n_gel=1.414)  # fmt: skip
# x, y, z in mm and turns about x and y in degrees of a plate that is held in the air.
HELD = (
    (1, 0, 8, 20, 5), (-2, 1, 12, -15, 18), (0, -2, 16, 5, -24), (2, 2, 6, -8, -12),
    (-1, -1, 10, 14, -9), (1, 2, 14, -20, 4), (-2, 0, 7, 9, 15), (0, 1, 18, -6, -18),
)  # fmt: skip


def seen(
    board: Checkerboard,
    pose: BoardPose,
    contact: bool,
    noise_px: float = NOISE_PX,
    outliers: int = 0,
    seed: int = SEED,
) -> BoardView:
    """A board's corners where the true lens sees them, with noise, and some moved by 3 px."""
    rng = np.random.default_rng(seed)
    index = np.stack(np.meshgrid(*(np.arange(n) for n in board.corners)), -1).reshape(-1, 2)
    px = TRUE.project_px(pose.points_mm(board.at_mm(index)), "gel" if contact else "air")
    inside = np.all((px >= 5) & (px <= np.array(SIZE_PX) - 6), axis=1)
    px = px[inside] + noise_px * rng.standard_normal((int(inside.sum()), 2))
    px[rng.choice(len(px), outliers, replace=False)] += 3.0
    return BoardView(Corners("board.png", board, px, index[inside]), contact)


def _views(in_air: int, draw: int = 0) -> list[BoardView]:
    poses = [BoardPose((x, y, z), Rotation.from_euler("xyz", (a, b, 4.0), degrees=True))
             for x, y, z, a, b in HELD[:in_air]]  # fmt: skip
    plates = [seen(PLATE, p, False, seed=k + 100 * draw) for k, p in enumerate(poses)]
    return [seen(SKIN, ON_FACE, True, seed=SEED + draw), *plates]


def off_px(found: Fisheye) -> float:
    """Between where it and the true lens see points below the face; 95th percentile of the view."""
    origin, slope = TRUE.ray(TRUE.rest_px(view_mm(DESIGN)), "gel")
    at_mm = origin - DEPTH_MM * slope
    off = np.linalg.norm(found.project_px(at_mm) - TRUE.project_px(at_mm), axis=1)
    return float(np.percentile(off, 95))


def _fitted(views: Sequence[BoardView]) -> Calibration:
    return of_corners(views, SIZE_PX, DESIGN)


def _work(in_air: int, scratch: Path) -> Work:
    views = _views(in_air)
    others = [_fitted(_views(in_air, draw)) for draw in range(1, DRAWS)]  # of one noise says little
    return Work(
        lambda: _fitted(views),
        lambda found: float(np.median([off_px(one.lens) for one in (found, *others)])),
    )


def curves(quick: bool) -> Sequence[CurveSetting]:
    """The skin's chessboard alone, and with plates held in the air."""
    return [
        CurveSetting(
            f"a lens from corners with {NOISE_PX:g} px of noise",
            "the skin, and plates in the air", f"{1 + n} view{'s' * (n > 0)}",
            f"px, {DEPTH_MM:g} mm below the face, median of {DRAWS}",
            "the lens that saw the corners", 0.0, partial(_work, n), "self-test",
        )
        for n in ((0, 2) if quick else (0, 2, 4, 8))
    ]  # fmt: skip


def _off(view: BoardView, scratch: Path) -> tuple[float, str]:
    found = _fitted([view])
    return off_px(found.lens), f"{found.images[0]['outliers']} outliers left out"


def cases(quick: bool) -> Sequence[Case]:
    """What is seen too little of, misread or blurred, and a few corners that are."""
    few = Checkerboard(5, 4, 7.0, skin=True)
    out = [
        Case("8 of the skin's corners misread", "right",
             partial(_off, seen(SKIN, ON_FACE, True, outliers=8)), 1.0, "px"),
        Case("a skin of 12 corners", "refused", partial(_off, seen(few, ON_FACE, True)),
             says="the face is known to"),
    ]  # fmt: skip
    if quick:
        return out
    return out + [
        Case("70 of the skin's corners misread", "refused",
             partial(_off, seen(SKIN, ON_FACE, True, outliers=70)), says="miss the fit"),
        Case("0.3 px of noise", "refused",
             partial(_off, seen(SKIN, ON_FACE, True, noise_px=0.3)), says="blurred"),
    ]  # fmt: skip


ENGINE = Engine(
    "Lens calibration",
    "A fisheye behind gel, acrylic and air, fitted to the corners of chessboards (simulated).",
    cases,
    curves,
)
