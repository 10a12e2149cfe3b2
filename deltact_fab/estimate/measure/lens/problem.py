"""The fit of a lens: its priors, first poses of the boards, both as one vector, and the search."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from deltact_fab.common import Array, InputError, SolverError
from deltact_fab.sensor import Fisheye, SensorDimensions, ShapeError

from .corners import Corners


@dataclass(frozen=True)
class Prior:
    """The prior of a parameter: a normal distribution, and its source.

    weak: so wide that it only keeps the search in bounds; the images must know the parameter.
    """

    mean: float
    sigma: float
    why: str
    weak: bool = False


@dataclass(frozen=True)
class BoardView:
    """A board in an image: lying on the face (contact), or held in the air beyond it."""

    corners: Corners
    contact: bool

    @property
    def dof(self) -> int:
        """Of its pose: a skin lies where the sensor is, a contact board slides and turns."""
        if self.corners.board.skin:
            return 0
        return 3 if self.contact else 6

    def at_mm(self, pose: Array) -> NDArray[np.float64]:
        """The corners in the sensor frame, (n, 3) mm.

        pose: nothing of a skin; x, y (mm), turn (rad) of a contact board; x, y, z and a rotation
        vector (rad) of a board in air.
        """
        flat = np.column_stack((self.corners.board_mm, np.zeros(len(self.corners.px))))
        if self.dof == 0:
            return flat
        if self.dof == 3:
            c, s = np.cos(pose[2]), np.sin(pose[2])
            turned = flat @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
            return np.asarray(turned + (pose[0], pose[1], 0.0))
        return np.asarray(Rotation.from_rotvec(pose[3:]).apply(flat) + pose[:3])


POSE_STEP = 1e-6  # mm or rad; of a derivative
PRIOR_STEP = 1e-5  # of a prior's sigma


class LensProblem:
    """Residuals and their derivatives, of a vector: parameters in sigmas off their prior, poses."""

    def __init__(
        self, base: Fisheye, priors: Mapping[str, Prior], seen: Sequence[BoardView]
    ) -> None:
        """base: has what no prior names. Parameters in the order of the priors."""
        self.base, self.priors, self.seen = base, dict(priors), tuple(seen)
        self.names = tuple(priors)
        ends = len(self.names) + np.cumsum([0, *(s.dof for s in self.seen)])
        self.poses = [slice(int(a), int(b)) for a, b in itertools.pairwise(ends)]
        self.size = int(ends[-1])
        counts = np.cumsum([0, *(len(s.corners.px) for s in self.seen)])
        self.rows = [slice(int(a), int(b)) for a, b in itertools.pairwise(counts)]
        self.px = np.concatenate([s.corners.px for s in self.seen])
        self.in_air = np.concatenate([np.full(len(s.corners.px), not s.contact) for s in self.seen])

    def lens(self, x: Array) -> Fisheye:
        """The lens of a vector. Raises ShapeError beyond what a lens may be."""
        pairs = zip(self.priors.items(), x, strict=False)
        values: dict[str, Any] = {n: p.mean + float(v) * p.sigma for (n, p), v in pairs}
        return replace(self.base, **values)

    def points_mm(self, x: Array) -> NDArray[np.float64]:
        """All corners in the sensor frame, (n, 3)."""
        at = [s.at_mm(x[pose]) for s, pose in zip(self.seen, self.poses, strict=True)]
        return np.concatenate(at)

    def seen_px(self, lens: Fisheye, points_mm: Array) -> NDArray[np.float64]:
        """Where the lens sees points in the order of the corners, (n, 2) px."""
        out = np.empty((len(points_mm), 2))
        if not self.in_air.all():
            out[~self.in_air] = lens.project_px(points_mm[~self.in_air], "gel")
        if self.in_air.any():
            held = points_mm[self.in_air]
            # No board goes through the face, whatever a step of the search tries.
            held[:, 2] = np.maximum(held[:, 2], 0)
            out[self.in_air] = lens.project_px(held, "air")
        return out

    def off_px(self, x: Array) -> NDArray[np.float64]:
        """Corners as the lens sees them less as they were found, (n, 2) px."""
        return self.seen_px(self.lens(x), self.points_mm(x)) - self.px

    def jacobian(self, x: Array) -> NDArray[np.float64]:
        """Its derivatives, (n, 2, size), by forward differences.

        Every pose moves only its own corners, so the k-th number of all poses is varied at once.
        """
        lens, at = self.lens(x), self.points_mm(x)
        here = self.seen_px(lens, at)
        out = np.zeros((len(at), 2, self.size))
        for k in range(len(self.names)):
            moved = x.copy()
            moved[k] += PRIOR_STEP
            out[:, :, k] = (self.seen_px(self.lens(moved), at) - here) / PRIOR_STEP
        for k in range(max((s.dof for s in self.seen), default=0)):
            moved = x.copy()
            for s, pose in zip(self.seen, self.poses, strict=True):
                if k < s.dof:
                    moved[pose.start + k] += POSE_STEP
            change = (self.seen_px(lens, self.points_mm(moved)) - here) / POSE_STEP
            for s, pose, rows in zip(self.seen, self.poses, self.rows, strict=True):
                if k < s.dof:
                    out[rows, :, pose.start + k] = change[rows]
        return out


@dataclass(frozen=True)
class LensSolution:
    """What fits: the vector, its covariance, and the weight of each corner (0: an outlier)."""

    x: NDArray[np.float64]
    covariance: NDArray[np.float64]
    off_px: NDArray[np.float64]
    kept: NDArray[np.bool_]
    noise_px: float


NOISE_PX = 0.1
MIN_NOISE_PX = 0.02
SYSTEMATIC_PX, SYSTEMATIC_REACH_PX = 0.02, 40.0
"""Smooth error of the corners of an image, which no residual shows, for the lens absorbs it:
curvature, shading and sharpening within a corner's window. 0.01 to 0.02 px on rendered boards
(decision 0019)."""
OUTLIER = 5.0  # in robust sigmas of the residuals: beyond, a corner was misread


def solve(problem: LensProblem, x: Array, scale_px: float = NOISE_PX) -> LensSolution:
    """Fit, first with a soft-L1 loss; then, without its outliers, by least squares.

    scale_px: deviations beyond this are damped. Raises SolverError when the search does not end.
    """
    everything = np.ones(len(problem.px), bool)
    x = _search(problem, x, everything, scale_px, soft=True)
    off = problem.off_px(x)
    size = np.abs(off)
    noise_px = max(1.4826 * float(np.median(size)), MIN_NOISE_PX)
    kept = size.max(axis=1) <= OUTLIER * noise_px
    x = _search(problem, x, kept, noise_px, soft=False)
    off = problem.off_px(x)
    free = max(2 * int(kept.sum()) - problem.size, 1)
    noise_px = max(float(np.sqrt(np.sum(off[kept] ** 2) / free)), MIN_NOISE_PX)
    return LensSolution(x, covariance(problem, x, kept, noise_px), off, kept, noise_px)


def covariance(problem: LensProblem, x: Array, kept: Array, noise_px: float) -> NDArray[np.float64]:
    """Of the vector, from the corners' scatter, their systematic errors, and the priors."""
    each = problem.jacobian(x) / noise_px
    j = each[kept].reshape(-1, problem.size)
    known = j.T @ j
    lens = np.arange(len(problem.names))
    known[lens, lens] += 1
    # Poses and parameters differ in unit: scale before inverting.
    scale = 1 / np.sqrt(np.diag(known))
    scatter = np.linalg.inv(known * scale[:, None] * scale) * scale[:, None] * scale
    total = scatter.copy()
    for rows in problem.rows:
        px, gain = problem.px[rows][kept[rows]], each[rows][kept[rows]] @ scatter
        apart = np.sum((px[:, None] - px) ** 2, axis=-1)
        alike = (SYSTEMATIC_PX / noise_px) ** 2 * np.exp(-apart / (2 * SYSTEMATIC_REACH_PX**2))
        total += np.einsum("iap,ij,jaq->pq", gain, alike, gain, optimize=True)
    return np.asarray(total)


def _search(
    problem: LensProblem, x: Array, kept: Array, scale_px: float, soft: bool
) -> NDArray[np.float64]:
    n_lens = len(problem.names)
    far = np.full((len(problem.px), 2), 1e6)

    def residuals(x: Array) -> Array:
        try:
            off = problem.off_px(x)
        except (InputError, ShapeError, SolverError):
            off = far  # outside what a lens sees: the search turns back
        return np.concatenate(((off[kept] / scale_px).ravel(), x[:n_lens]))

    def derivatives(x: Array) -> Array:
        j = problem.jacobian(x)[kept].reshape(-1, problem.size) / scale_px
        return np.concatenate((j, np.eye(n_lens, problem.size)))

    loss: Callable[[Array], Array] | str = "linear"
    if soft:
        n_data = 2 * int(kept.sum())

        def loss(z: Array) -> Array:
            """Soft L1 of the corners, and the priors as they are."""
            rho = np.stack((z, np.ones_like(z), np.zeros_like(z)))
            t = 1 + z[:n_data]
            rho[:, :n_data] = 2 * (np.sqrt(t) - 1), t**-0.5, -0.5 * t**-1.5
            return rho

    found = least_squares(
        residuals, x, derivatives, method="trf", x_scale="jac", loss=loss, max_nfev=200
    )
    if found.status <= 0:
        raise SolverError("lens: the fit did not converge in 200 steps: not these boards?")
    return np.asarray(found.x, np.float64)


HEIGHTS_MM = (3.0, 8.0, 16.0, 32.0)  # of a board in air, from which its pose is looked for
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
    (cx, cy), design = (size_px - 1) / 2, Fisheye.from_sensor(sensor)
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
