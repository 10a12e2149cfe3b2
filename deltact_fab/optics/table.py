"""Where rays cross the resting face, looked up: many points at once, for drawing and truth.

A ray that crosses the resting face at r0 from the foot of an upright lens runs on through the gel
with a slope r0 k, and k depends on r0 alone. So a point at r and z lies on the ray with
r0 (1 + z k(r0^2)) = r, which Newton solves on a table of k over r0^2: to 1e-5 px, exactly at rest,
at any depth. A pupil that moves along a tilted axis breaks the symmetry; what that adds to the
slopes has a table of its own over the face.

Points and slopes are complex numbers here, x + i y from the pupil's foot.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..aliases import Array
from ..errors import SolverError

if TYPE_CHECKING:
    from .fisheye import Fisheye


NODES = 4096
"""Of r0^2."""
SKEW_NODES, SKEW_BETWEEN = 129, 4
"""Of x and of y, of what breaks the symmetry; each step cut in so many by a cubic spline."""
DEEPEST = 0.85
"""Share of the gel's height: near the plate the smallest error aside is a large one at rest."""
SETTLED_MM = 1e-5
"""Newton's last step: what it leaves is of the order of its square."""
MAX_ITERATIONS = 40
NOT_FOUND = f"lens: no crossing was found in {MAX_ITERATIONS} iterations"
BLOCK = 16384
"""Points at once: what they need stays in the processor's cache."""


class CrossingTable:
    """Crossings of the resting face by rays to points in the gel.

    reach_mm: how far from the pupil's foot the table goes; beyond it rays are solved one by one.
    """

    def __init__(self, lens: Fisheye, reach_mm: float) -> None:
        self.lens = lens
        self._foot = complex(lens.x0_mm, lens.y0_mm)
        self._reach_mm = reach_mm
        self._square_step = reach_mm**2 / (NODES - 1)
        centred = replace(lens, x0_mm=0.0, y0_mm=0.0)
        upright = replace(centred, tilt_x_deg=0.0, tilt_y_deg=0.0)
        r0 = np.sqrt(self._square_step * np.arange(NODES))
        r0[0] = 1e-3  # k is a quotient, and flat there
        k = _slopes(upright, r0.astype(complex)).real / r0
        self._k, self._k_step = k[:-1], np.diff(k)
        self._skew: Array | None = None
        if lens.pupil_shift_mm and (lens.tilt_x_deg or lens.tilt_y_deg):
            nodes = np.linspace(-reach_mm, reach_mm, SKEW_NODES)
            face = nodes + 1j * nodes[:, None]
            skew = _slopes(centred, face) - _slopes(upright, face)
            self._skew = _finer(nodes, skew)
            self._skew_step = 2 * reach_mm / (len(self._skew) - 1)

    def __call__(self, xyz_mm: Array) -> Array:
        """Points (..., 3) in the gel to crossings (..., 2), mm. Raises as the lens does."""
        points = np.asarray(xyz_mm, float)
        flat = points.reshape(-1, 3)
        out = np.empty((len(flat), 2))
        for start in range(0, len(flat), BLOCK):
            out[start : start + BLOCK] = self._block(flat[start : start + BLOCK])
        return out.reshape(*points.shape[:-1], 2)

    def _block(self, points: Array) -> Array:
        aim, z = points[:, 0] + 1j * points[:, 1] - self._foot, points[:, 2]
        held = (np.abs(aim) < self._reach_mm) & (z > -DEEPEST * self.lens.gel_mm)
        out = np.empty((len(points), 2))
        if not held.all():
            out[~held] = self.lens.crossing_mm(points[~held])
            if held.any():
                out[held] = self._block(points[held])
            return out
        crossing = self._crossing(aim, z)
        lost = np.abs(crossing) >= self._reach_mm - SETTLED_MM
        crossing += self._foot
        out[:, 0], out[:, 1] = crossing.real, crossing.imag
        if lost.any():
            out[lost] = self.lens.crossing_mm(points[lost])
        return out

    def _crossing(self, aim: Array, z: Array) -> Array:
        crossing = self._upright(aim, z, None)
        if self._skew is None:
            return crossing
        for _ in range(MAX_ITERATIONS):
            before = crossing
            crossing = self._upright(aim - z * self._skewed(before), z, np.abs(before))
            # The skew at the crossing changes by less than a hundredth of what the crossing does.
            if float(np.max(np.abs(crossing - before))) < 100 * SETTLED_MM:
                return crossing
        raise SolverError(NOT_FOUND)

    def _upright(self, aim: Array, z: Array, r0: Array | None) -> Array:
        """Crossings of an upright lens, at the reach where they leave it; r0: where to start."""
        r = np.abs(aim)
        if r0 is None:
            # Convex below the face and concave above, and this is the side Newton cannot leave.
            r0 = r / (1 + z * self._k[0])
            r0 = np.minimum(r0, r + np.abs(z) * self._k[-1] * self._reach_mm)
            np.minimum(r0, self._reach_mm, out=r0)
        for _ in range(MAX_ITERATIONS):
            at = r0 * r0 / self._square_step
            node = np.minimum(at.astype(np.intp), NODES - 2)
            k_step = self._k_step.take(node)
            k = self._k.take(node) + (at - node) * k_step
            per = 1 + z * k
            before = r0
            r0 = np.abs(r0 - (r0 * per - r) / (per + 2 * z * at * k_step))
            np.minimum(r0, self._reach_mm, out=r0)
            if float(np.max(np.abs(r0 - before))) < SETTLED_MM:
                with np.errstate(invalid="ignore", divide="ignore"):
                    return np.asarray(np.where(r > 0, r0 / r, 1.0) * aim)
        raise SolverError(NOT_FOUND)

    def _skewed(self, crossing: Array) -> Array:
        """What breaks the symmetry, bilinear between the nodes."""
        assert self._skew is not None
        columns = self._skew.shape[1]
        x = (crossing.real + self._reach_mm) / self._skew_step
        y = (crossing.imag + self._reach_mm) / self._skew_step
        j, i = (np.minimum(at.astype(np.intp), columns - 2) for at in (x, y))
        first = i * columns + j
        x -= j
        y -= i
        low = self._skew.take(first)
        low += x * (self._skew.take(first + 1) - low)
        first += columns
        high = self._skew.take(first)
        high += x * (self._skew.take(first + 1) - high)
        return np.asarray(low + y * (high - low))


def _slopes(lens: Fisheye, crossing: Array) -> Array:
    """Slopes in the gel of the rays that cross the resting face at these places."""
    points = np.stack((crossing.real, crossing.imag, np.zeros(crossing.shape)), axis=-1)
    slope = lens.ray_to(points)[1]
    return np.asarray(slope[..., 0] + 1j * slope[..., 1])


def _finer(nodes: Array, values: Array) -> Array:
    """A complex table between its nodes."""
    from scipy.interpolate import RectBivariateSpline

    between = np.linspace(nodes[0], nodes[-1], (len(nodes) - 1) * SKEW_BETWEEN + 1)
    real, imaginary = (
        RectBivariateSpline(nodes, nodes, part)(between, between)
        for part in (values.real, values.imag)
    )
    return np.asarray(real + 1j * imaginary)
