"""A lens and the poses of its boards as one vector, and the residuals of the corners under it."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ...aliases import Array
from ...errors import InputError, SolverError
from ...optics import Fisheye
from ...shapes.bounded import ShapeError
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
curvature, shading and sharpening within a corner's window. .01 to .02 px on rendered boards
(decision 0019)."""
OUTLIER = 5.0
"""In robust sigmas of the residuals: beyond, a corner was misread."""


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
    from scipy.optimize import least_squares

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
