"""Fit of a lens: priors, initial board poses, the parameter vector, and the optimisation."""

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
    """Normal prior of a parameter, and its source.

    weak: so wide that it only bounds the search; the images must determine the parameter.
    """

    mean: float
    sigma: float
    source: str
    weak: bool = False


@dataclass(frozen=True)
class BoardView:
    """Board in an image: on the face (contact), or in the air beyond it."""

    corners: Corners
    contact: bool

    @property
    def dof(self) -> int:
        """Degrees of freedom of the pose: 0 for a skin, 3 on the face, 6 in the air."""
        if self.corners.board.skin:
            return 0
        return 3 if self.contact else 6

    def corners_mm(self, pose: Array) -> NDArray[np.float64]:
        """Return the corners in the sensor frame, (n, 3) mm.

        pose: empty for a skin; x, y (mm), turn (rad) for a contact board; x, y, z (mm) and a
        rotation vector (rad) for a board in air.
        """
        flat = np.column_stack((self.corners.board_mm, np.zeros(len(self.corners.px))))
        if self.dof == 0:
            return flat
        if self.dof == 3:
            c, s = np.cos(pose[2]), np.sin(pose[2])
            turned = flat @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
            return np.asarray(turned + (pose[0], pose[1], 0.0))
        return np.asarray(Rotation.from_rotvec(pose[3:]).apply(flat) + pose[:3])


POSE_STEP = 1e-6  # mm or rad, of a derivative; by hand: rounding against curvature
PRIOR_STEP = 1e-5  # of a prior's sigma, of a derivative; by hand: rounding against curvature


class LensProblem:
    """Residuals and derivatives over a vector: parameters in prior sigmas, then poses."""

    def __init__(
        self, base: Fisheye, priors: Mapping[str, Prior], views: Sequence[BoardView]
    ) -> None:
        """base: lens for parameters without a prior. Parameters are in the order of the priors."""
        self.base, self.priors, self.views = base, dict(priors), tuple(views)
        self.names = tuple(priors)
        ends = len(self.names) + np.cumsum([0, *(s.dof for s in self.views)])
        self.poses = [slice(int(a), int(b)) for a, b in itertools.pairwise(ends)]
        self.size = int(ends[-1])
        counts = np.cumsum([0, *(len(s.corners.px) for s in self.views)])
        self.rows = [slice(int(a), int(b)) for a, b in itertools.pairwise(counts)]
        self.px = np.concatenate([s.corners.px for s in self.views])
        self.in_air = np.concatenate([np.full(len(s.corners.px), not s.contact) for s in views])

    def lens(self, x: Array) -> Fisheye:
        """Return the lens of a vector. Raises ShapeError for an impossible lens."""
        pairs = zip(self.priors.items(), x, strict=False)
        values: dict[str, Any] = {n: p.mean + float(v) * p.sigma for (n, p), v in pairs}
        return replace(self.base, **values)

    def points_mm(self, x: Array) -> NDArray[np.float64]:
        """Return all corners in the sensor frame, (n, 3) mm."""
        points = [s.corners_mm(x[pose]) for s, pose in zip(self.views, self.poses, strict=True)]
        return np.concatenate(points)

    def project_px(self, lens: Fisheye, points_mm: Array) -> NDArray[np.float64]:
        """Project points, in the order of the corners, to (n, 2) px."""
        out = np.empty((len(points_mm), 2))
        if not self.in_air.all():
            out[~self.in_air] = lens.project_px(points_mm[~self.in_air], "gel")
        if self.in_air.any():
            air_points = points_mm[self.in_air]
            # Keep boards outside the face in every step of the search.
            air_points[:, 2] = np.maximum(air_points[:, 2], 0)
            out[self.in_air] = lens.project_px(air_points, "air")
        return out

    def residual_px(self, x: Array) -> NDArray[np.float64]:
        """Projected less detected corners, (n, 2) px."""
        return self.project_px(self.lens(x), self.points_mm(x)) - self.px

    def jacobian(self, x: Array) -> NDArray[np.float64]:
        """Derivatives of `residual_px`, (n, 2, size), by forward differences.

        A pose moves only its own corners, so the k-th number of all poses is varied at once.
        """
        lens, points = self.lens(x), self.points_mm(x)
        projected = self.project_px(lens, points)
        out = np.zeros((len(points), 2, self.size))
        for k in range(len(self.names)):
            shifted = x.copy()
            shifted[k] += PRIOR_STEP
            out[:, :, k] = (self.project_px(self.lens(shifted), points) - projected) / PRIOR_STEP
        for k in range(max((s.dof for s in self.views), default=0)):
            shifted = x.copy()
            for s, pose in zip(self.views, self.poses, strict=True):
                if k < s.dof:
                    shifted[pose.start + k] += POSE_STEP
            change = (self.project_px(lens, self.points_mm(shifted)) - projected) / POSE_STEP
            for s, pose, rows in zip(self.views, self.poses, self.rows, strict=True):
                if k < s.dof:
                    out[rows, :, pose.start + k] = change[rows]
        return out


@dataclass(frozen=True)
class LensSolution:
    """Fitted vector with covariance, residuals (n, 2) px, and the mask of corners used."""

    x: NDArray[np.float64]
    covariance: NDArray[np.float64]
    residual_px: NDArray[np.float64]
    inliers: NDArray[np.bool_]
    noise_px: float


NOISE_PX = 0.1  # first guess; by hand: only damps the first search
MIN_NOISE_PX = 0.02  # by hand: smaller makes noise-free images singular
SYSTEMATIC_PX, SYSTEMATIC_REACH_PX = 0.02, 40.0
"""Smooth error of an image's corners by curvature, shading and sharpening in a corner's window; the
lens absorbs it, so no residual shows it. Measured on rendered boards: 0.01 to 0.02 px (decision
0019)."""
OUTLIER_SIGMAS = 5.0  # robust sigmas of the residuals; decision 0019


def solve(problem: LensProblem, x: Array, scale_px: float = NOISE_PX) -> LensSolution:
    """Fit with a soft-L1 loss, then without outliers by least squares.

    scale_px: larger deviations are damped. Raises SolverError if the search does not converge.
    """
    everything = np.ones(len(problem.px), bool)
    x = _search(problem, x, everything, scale_px, soft=True)
    residual = problem.residual_px(x)
    size = np.abs(residual)
    noise_px = max(1.4826 * float(np.median(size)), MIN_NOISE_PX)
    inliers = size.max(axis=1) <= OUTLIER_SIGMAS * noise_px
    x = _search(problem, x, inliers, noise_px, soft=False)
    residual = problem.residual_px(x)
    free = max(2 * int(inliers.sum()) - problem.size, 1)
    noise_px = max(float(np.sqrt(np.sum(residual[inliers] ** 2) / free)), MIN_NOISE_PX)
    return LensSolution(x, covariance(problem, x, inliers, noise_px), residual, inliers, noise_px)


def covariance(problem: LensProblem, x: Array, inliers: Array, noise_px: float) -> Array:
    """Covariance of the vector from corner noise, systematic errors and priors."""
    jacobian = problem.jacobian(x) / noise_px
    j = jacobian[inliers].reshape(-1, problem.size)
    information = j.T @ j
    lens = np.arange(len(problem.names))
    information[lens, lens] += 1
    # Poses and parameters differ in unit: scale before inverting.
    scale = 1 / np.sqrt(np.diag(information))
    scatter = np.linalg.inv(information * scale[:, None] * scale) * scale[:, None] * scale
    total = scatter.copy()
    for rows in problem.rows:
        px, gain = problem.px[rows][inliers[rows]], jacobian[rows][inliers[rows]] @ scatter
        dist2 = np.sum((px[:, None] - px) ** 2, axis=-1)
        shared = (SYSTEMATIC_PX / noise_px) ** 2 * np.exp(-dist2 / (2 * SYSTEMATIC_REACH_PX**2))
        total += np.einsum("iap,ij,jaq->pq", gain, shared, gain, optimize=True)
    return np.asarray(total)


def _search(
    problem: LensProblem, x: Array, inliers: Array, scale_px: float, soft: bool
) -> NDArray[np.float64]:
    n_lens = len(problem.names)
    penalty_px = np.full((len(problem.px), 2), 1e6)

    def residuals(x: Array) -> Array:
        try:
            residual_px = problem.residual_px(x)
        except (InputError, ShapeError, SolverError):
            residual_px = penalty_px  # outside the lens's field: the search turns back
        return np.concatenate(((residual_px[inliers] / scale_px).ravel(), x[:n_lens]))

    def derivatives(x: Array) -> Array:
        j = problem.jacobian(x)[inliers].reshape(-1, problem.size) / scale_px
        return np.concatenate((j, np.eye(n_lens, problem.size)))

    loss: Callable[[Array], Array] | str = "linear"
    if soft:
        n_data = 2 * int(inliers.sum())

        def loss(z: Array) -> Array:
            """Soft L1 for corners, linear for priors."""
            rho = np.stack((z, np.ones_like(z), np.zeros_like(z)))
            t = 1 + z[:n_data]
            rho[:, :n_data] = 2 * (np.sqrt(t) - 1), t**-0.5, -0.5 * t**-1.5
            return rho

    solution = least_squares(
        residuals, x, derivatives, method="trf", x_scale="jac", loss=loss, max_nfev=200
    )
    if solution.status <= 0:
        raise SolverError("lens: the fit did not converge in 200 steps; wrong boards?")
    return np.asarray(solution.x, np.float64)


# Start poses of a board in air; by hand: more starts are slower, fewer miss steep or high boards
START_HEIGHTS_MM = (3.0, 8.0, 16.0, 32.0)
START_TILTS_RAD = ((0.0, 0.0), (0.4, 0.0), (-0.4, 0.0), (0.0, 0.4), (0.0, -0.4))

LAYER_PRIORS = {
    "acrylic_mm": (0.05, "the design; accuracy of a caliper"),
    "gel_mm": (0.1, "the design; tolerance of a mold"),
    "n_acrylic": (0.003, "PMMA, 1.489 to 1.492 in visible light"),
    "n_gel": (0.005, "clear silicones, 1.40 to 1.42"),
}
"""Parameters that boards cannot separate from the lens: sigma and its source."""
LENS_PRIORS = {
    "k3": (0.01, "fisheyes as made: a tenth of their k1"),
    "k4": (0.008, "fisheyes as made: a tenth of their k1"),
    "p1": (0.002, "elements centred to some hundredths of a millimetre"),
    "p2": (0.002, "elements centred to some hundredths of a millimetre"),
    "aspect": (0.002, "square pixels"),
    "air_gap_mm": (1.0, "the design; a lens is screwed in by hand"),
    "pupil_shift_mm": (1.0, "lenses of this size"),
}
"""Small parameters of a lens, which one image may not determine: sigma and its source."""


def nominal(sensor: SensorDimensions, contact: Sequence[Corners], size_px: Array) -> Fisheye:
    """Return the design's lens for (width, height) px, with the focal length of the corners."""
    (cx, cy), design = (size_px - 1) / 2, Fisheye.from_sensor(sensor)
    _, px_per_mm = min(_near_middle(corners, (cx, cy)) for corners in contact)
    return replace(
        design, f_px=px_per_mm * (design.mm_per_px * design.f_px),
        cx_px=float(cx), cy_px=float(cy), width_px=int(size_px[0]), height_px=int(size_px[1]),
    )  # fmt: skip


def _near_middle(corners: Corners, middle: tuple[float, float]) -> tuple[float, float]:
    """Return median distance, px, and scale, px/mm, of the corners nearest the image's middle."""
    distance_px = np.linalg.norm(corners.px - middle, axis=1)
    near = np.argsort(distance_px)[:12]
    board_points = np.column_stack((corners.board_mm[near], np.ones(len(near))))
    local = np.linalg.lstsq(board_points, corners.px[near], rcond=None)[0][:2]
    # The root of the local map's determinant.
    return float(np.median(distance_px[near])), float(np.sqrt(abs(np.linalg.det(local))))


def priors(lens: Fisheye, on_skin: bool) -> dict[str, Prior]:
    """Return the priors of the fit. on_skin: a skin fixes the sensor's origin and axes."""
    search = "wide: bounds the search"
    weak_sigmas = {
        "f_px": 0.15 * lens.f_px,
        "k1": 0.2,
        "k2": 0.1,
        "cx_px": 0.05 * lens.width_px,
        "cy_px": 0.05 * lens.width_px,
        "tilt_x_deg": 4.0,
        "tilt_y_deg": 4.0,
    }
    if on_skin:
        weak_sigmas |= {"x0_mm": 2.0, "y0_mm": 2.0, "roll_deg": 10.0}
    weak_priors = {n: Prior(getattr(lens, n), s, search, weak=True) for n, s in weak_sigmas.items()}
    firm_sigmas = (LENS_PRIORS | LAYER_PRIORS).items()
    return weak_priors | {n: Prior(getattr(lens, n), s, source) for n, (s, source) in firm_sigmas}


def first_pose(view: BoardView, lens: Fisheye) -> NDArray[np.float64]:
    """Estimate the initial pose of a board under a lens. Raises InputError if none fits."""
    if view.dof == 0:
        return np.empty(0)
    corners = view.corners
    origin, slope = lens.ray(corners.px, "gel" if view.contact else "air")
    ok = np.asarray(np.isfinite(origin).all(axis=1))
    if ok.sum() < 4:
        raise InputError(f"{corners.source}: the board lies outside the lens's field")
    board, origin, slope = corners.board_mm[ok], origin[ok], slope[ok]
    if view.contact:
        shift_mm, turn = _fit_flat(board, origin[:, :2])
        return np.array([*shift_mm, turn])
    return _fit_air(view, board, origin, slope, ok)


def _fit_flat(board_mm: Array, at_mm: Array) -> tuple[Array, float]:
    """Fit shift and turn (rad) of points (n, 2) to others, whatever their scale."""
    a, b = board_mm - board_mm.mean(0), at_mm - at_mm.mean(0)
    turn = float(np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b)))
    c, s = np.cos(turn), np.sin(turn)
    return at_mm.mean(0) - board_mm.mean(0) @ np.array([[c, s], [-s, c]]), turn


def _fit_air(
    view: BoardView, board: Array, origin: Array, slope: Array, ok: Array
) -> NDArray[np.float64]:
    """Fit the pose in air that brings corners closest to their rays, from several starts."""

    def ray_distances(pose: Array) -> Array:
        points = view.corners_mm(pose)[ok]
        return np.asarray((points[:, :2] - origin[:, :2] - points[:, 2:] * slope[:, :2]).ravel())

    best = None
    for height_mm in START_HEIGHTS_MM:
        shift_mm, turn = _fit_flat(board, (origin + height_mm * slope)[:, :2])
        for tilt in START_TILTS_RAD:
            turned = Rotation.from_euler("xyz", (*tilt, 0)) * Rotation.from_euler("z", turn)
            start = np.array([*shift_mm, height_mm, *turned.as_rotvec()])
            solution = least_squares(ray_distances, start, method="lm", max_nfev=400)
            lifted = np.min(view.corners_mm(solution.x)[:, 2]) > -1.0
            if lifted and (best is None or solution.cost < best.cost):
                best = solution
    if best is None:
        raise InputError(
            f"{view.corners.source}: the board would be inside the sensor; is this a contact image?"
        )
    return np.asarray(best.x, np.float64)
