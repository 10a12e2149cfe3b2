"""Where the fit of a lens starts: its priors, and first poses of the boards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ...aliases import Array
from ...errors import InputError
from ...optics import Fisheye
from ...shapes import SensorDimensions
from .corners import Corners
from .problem import BoardView, Prior

HEIGHTS_MM = (3.0, 8.0, 16.0, 32.0)
"""Of a board in air, from which its pose is looked for."""
TILTS_RAD = ((0.0, 0.0), (0.4, 0.0), (-0.4, 0.0), (0.0, 0.4), (0.0, -0.4))

LAYERS = {
    "acrylic_mm": (0.05, "the design; a caliper's reach"),
    "gel_mm": (0.1, "the design; what a mold keeps to"),
    "n_acrylic": (0.003, "PMMA, 1.489 to 1.492 in visible light"),
    "n_gel": (0.005, "clear silicones, 1.40 to 1.42"),
}
"""What no board can tell apart from the lens: sigma, and where it is from."""
LENS = {
    "k3": (0.01, "fisheyes as made: a tenth of their k1"),
    "k4": (0.008, "fisheyes as made: a tenth of their k1"),
    "p1": (0.002, "elements centred to some hundredths of a millimetre"),
    "p2": (0.002, "elements centred to some hundredths of a millimetre"),
    "aspect": (0.002, "square pixels"),
    "air_gap_mm": (1.0, "the design; a lens is screwed in by hand"),
    "pupil_shift_mm": (1.0, "lenses of this size"),
}
"""What a lens has little of, and one image need not tell: sigma, and where it is from."""


def nominal(sensor: SensorDimensions, contact: Sequence[Corners], size_px: Array) -> Fisheye:
    """The design's lens for an image of (width, height) px, its focal length from the corners."""
    (cx, cy), design = (size_px - 1) / 2, Fisheye.of(sensor)
    _, px_per_mm = min(_near_middle(seen, (cx, cy)) for seen in contact)
    return replace(
        design, f_px=px_per_mm * (design.mm_per_px * design.f_px),
        cx_px=float(cx), cy_px=float(cy), width_px=int(size_px[0]), height_px=int(size_px[1]),
    )  # fmt: skip


def _near_middle(corners: Corners, middle: tuple[float, float]) -> tuple[float, float]:
    """Of the corners nearest the image's middle: median distance to it, px, and scale, px/mm."""
    far = np.linalg.norm(corners.px - middle, axis=1)
    near = np.argsort(far)[:12]
    at = np.column_stack((corners.board_mm[near], np.ones(len(near))))
    local = np.linalg.lstsq(at, corners.px[near], rcond=None)[0][:2]
    # The root of the local map's determinant.
    return float(np.median(far[near])), float(np.sqrt(abs(np.linalg.det(local))))


def priors(lens: Fisheye, placed: bool) -> dict[str, Prior]:
    """Of all that is fitted. placed: by a skin, which has the sensor's origin and axes on it."""
    search = "wide: keeps the search in bounds"
    wide = {
        "f_px": 0.15 * lens.f_px,
        "k1": 0.2,
        "k2": 0.1,
        "cx_px": 0.05 * lens.width_px,
        "cy_px": 0.05 * lens.width_px,
        "tilt_x_deg": 4.0,
        "tilt_y_deg": 4.0,
    }
    if placed:
        wide |= {"x0_mm": 2.0, "y0_mm": 2.0, "roll_deg": 10.0}
    found = {n: Prior(getattr(lens, n), s, search, weak=True) for n, s in wide.items()}
    known = (LENS | LAYERS).items()
    return found | {n: Prior(getattr(lens, n), s, why) for n, (s, why) in known}


def pose(seen: BoardView, lens: Fisheye) -> NDArray[np.float64]:
    """A first pose of a board under a lens. Raises InputError when none comes near."""
    if seen.dof == 0:
        return np.empty(0)
    corners = seen.corners
    origin, slope = lens.ray(corners.px, "gel" if seen.contact else "air")
    ok = np.asarray(np.isfinite(origin).all(axis=1))
    if ok.sum() < 4:
        raise InputError(f"{corners.source}: the board lies outside the lens's field")
    board, origin, slope = corners.board_mm[ok], origin[ok], slope[ok]
    if seen.contact:
        at, turn = _laid(board, origin[:, :2])
        return np.array([*at, turn])
    return _held(seen, board, origin, slope, ok)


def _laid(board_mm: Array, at_mm: Array) -> tuple[Array, float]:
    """Shift and turn (rad) that bring points (n, 2) nearest to others; a scale is left free."""
    a, b = board_mm - board_mm.mean(0), at_mm - at_mm.mean(0)
    turn = float(np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b)))
    c, s = np.cos(turn), np.sin(turn)
    return at_mm.mean(0) - board_mm.mean(0) @ np.array([[c, s], [-s, c]]), turn


def _held(
    seen: BoardView, board: Array, origin: Array, slope: Array, ok: Array
) -> NDArray[np.float64]:
    """The pose in air whose corners lie nearest to their rays, of the best of several starts."""
    from scipy.optimize import least_squares

    def miss(pose: Array) -> Array:
        at = seen.at_mm(pose)[ok]
        return np.asarray((at[:, :2] - origin[:, :2] - at[:, 2:] * slope[:, :2]).ravel())

    best = None
    for height_mm in HEIGHTS_MM:
        at, turn = _laid(board, (origin + height_mm * slope)[:, :2])
        for tilt in TILTS_RAD:
            turned = Rotation.from_euler("xyz", (*tilt, 0)) * Rotation.from_euler("z", turn)
            start = np.array([*at, height_mm, *turned.as_rotvec()])
            found = least_squares(miss, start, method="lm", max_nfev=400)
            lifted = np.min(seen.at_mm(found.x)[:, 2]) > -1.0
            if lifted and (best is None or found.cost < best.cost):
                best = found
    if best is None:
        raise InputError(
            f"{seen.corners.source}: its board would lie inside the sensor: is it a contact image?"
        )
    return np.asarray(best.x, np.float64)
