"""Fisheye lens behind air, an acrylic plate and the gel, with exact refraction (Snell's law).

Refraction at plane faces has no single centre of projection. So rays are traced from the entrance
pupil, and a point is projected by solving for the ray that hits it.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Array, InputError, SolverError

from ..shapes.bounded import Bounded, ShapeError, bounded_number
from ..shapes.sensor import N_ACRYLIC, N_SILICONE, SensorDimensions
from .camera import Medium


def refracted_ratio(tan_squared: Any, index: float) -> Any:
    """Ratio of a ray's tangent in a layer to that in air, both from the common normal.

    Snell at plane faces: n sin t' = sin t, so tan t' / tan t = 1 / sqrt(n^2 + (n^2 - 1) tan^2 t),
    finite up to grazing rays. tan_squared: tan^2 t in air, a number or an array.
    """
    return (index**2 + (index**2 - 1) * tan_squared) ** -0.5


@dataclass(frozen=True)
class LayeredPath:
    """Layers from the lens to the face: air, acrylic and gel, thickness in mm."""

    air_gap_mm: float
    acrylic_mm: float
    gel_mm: float

    @property
    def layers(self) -> tuple[tuple[float, float], ...]:
        """Thickness (mm) and refractive index of each layer."""
        return (self.air_gap_mm, 1.0), (self.acrylic_mm, N_ACRYLIC), (self.gel_mm, N_SILICONE)

    def reach_mm(self, half_angle_rad: float) -> float:
        """Radius on the gel's face of a ray that leaves the lens at half_angle_rad."""
        t = math.tan(half_angle_rad)
        return t * float(sum(d * refracted_ratio(t**2, n) for d, n in self.layers))

    def half_angle_rad(self, radius_mm: float) -> float:
        """Half angle at the lens of a point of the face at radius_mm >= 0; inf if out of reach.

        Inverse of reach_mm, which is monotonic, by bisection to 1e-12 rad.
        """
        low, high = 0.0, math.pi / 2 - 1e-9
        if self.reach_mm(high) < radius_mm:
            return math.inf
        while high - low > 1e-12:
            middle = (low + high) / 2
            if self.reach_mm(middle) < radius_mm:
                low = middle
            else:
                high = middle
        return high


Depth = NDArray[Any] | float

MAX_FIELD_RAD = math.radians(100)
"""Half field of the 200-degree lens (paper)."""
MIN_RADIUS_GROWTH = 0.1
"""By hand: the field ends where the radius grows with the angle by less than this share of f."""
FACE_SLACK_MM = 1e-9
"""By hand: rounding of points on the face after a transform."""
RAY_STEP_RAD = 1e-8
"""By hand: convergence limit of Newton's step; the remaining error is its square, 1e-9 px."""
MAX_RAY_ITERATIONS = 40  # by hand: Newton converges in a few
DECENTRING_ITERATIONS, DECENTRING_SETTLED = 20, 1e-8
"""By hand: each iteration reduces the error tenfold, as p1 and p2 are some thousandths."""


@dataclass(frozen=True)
class Fisheye(Bounded):
    """Raw camera with a fisheye lens.

    A ray at angle theta from the lens's axis in the entrance pupil meets the image at radius
    f (theta + k1 theta^3 + k2 theta^5 + k3 theta^7 + k4 theta^9) from (cx, cy), plus decentring
    (p1, p2: Brown 1966); y is scaled by aspect. The pupil is on the axis; at angle theta (rad) it
    is shifted back along it by pupil_shift_mm theta^2, which widens the gap to air_gap_mm +
    pupil_shift_mm theta^2 cos(tilt). Plates and gel are flat and normal to z. The pupil of
    theta = 0 is at (x0_mm, y0_mm) above the sensor's origin. The image is rotated by roll_deg about
    the lens's axis, then the lens by tilt_y_deg about y and tilt_x_deg about x (right-handed).

    Out of view, nan for a pixel: beyond MAX_FIELD_RAD or where the radius stops growing.
    """

    f_px: float = bounded_number(870 / 2.24, "focal length; 0.87 mm at 2.24 um/px", 10, 10_000)
    k1: float = bounded_number(0.0, "radial distortion, of theta^3", -1, 1)
    k2: float = bounded_number(0.0, "radial distortion, of theta^5", -1, 1)
    k3: float = bounded_number(0.0, "radial distortion, of theta^7", -1, 1)
    k4: float = bounded_number(0.0, "radial distortion, of theta^9", -1, 1)
    p1: float = bounded_number(0.0, "decentring, along y", -0.1, 0.1)
    p2: float = bounded_number(0.0, "decentring, along x", -0.1, 0.1)
    aspect: float = bounded_number(1.0, "focal length along y over that along x", 0.5, 2)
    cx_px: float = bounded_number(639.5, "column of the principal point", -10_000, 20_000)
    cy_px: float = bounded_number(359.5, "row of the principal point", -10_000, 20_000)
    tilt_x_deg: float = bounded_number(0.0, "tilt of the lens about x", -10, 10)
    tilt_y_deg: float = bounded_number(0.0, "tilt of the lens about y", -10, 10)
    roll_deg: float = bounded_number(0.0, "rotation of the image about the lens's axis", -180, 180)
    x0_mm: float = bounded_number(0.0, "x position of the pupil", -50, 50)
    y0_mm: float = bounded_number(0.0, "y position of the pupil", -50, 50)
    air_gap_mm: float = bounded_number(3.0, "distance of axial entrance pupil to acrylic", 0.1, 50)
    pupil_shift_mm: float = bounded_number(
        0.0, "shift of the pupil backwards, per theta^2", -10, 10
    )
    acrylic_mm: float = bounded_number(2.0, "thickness of the acrylic plate", 0.1, 50)
    gel_mm: float = bounded_number(12.0, "distance of acrylic to resting outer face", 0.1, 100)
    n_acrylic: float = bounded_number(N_ACRYLIC, "refractive index of the plate", 1, 3)
    n_gel: float = bounded_number(N_SILICONE, "refractive index of the gel", 1, 3)
    width_px: int = bounded_number(1280, "columns of the raw image", 8, 20_000)
    height_px: int = bounded_number(720, "rows of the raw image", 8, 20_000)

    def __post_init__(self) -> None:
        super().__post_init__()
        # Up to 90 degrees from the normal plus 10 of tilt; else two rays could hit one point.
        least_mm = self.air_gap_mm + MAX_FIELD_RAD**2 * self.pupil_shift_mm
        if not least_mm > 0:
            raise ShapeError(
                f"air_gap_mm + {MAX_FIELD_RAD**2:.2f} pupil_shift_mm > 0: {least_mm:g} fails"
            )

    @classmethod
    def from_sensor(cls, sensor: SensorDimensions) -> Fisheye:
        """Nominal lens of a design: centred, not tilted, with the pupil at the lens's apex."""
        k1, k2, k3, k4 = sensor.lens_terms
        o, (width_px, height_px) = sensor.optics, sensor.raw_size_px
        return cls(
            f_px=sensor.focal_px, k1=k1, k2=k2, k3=k3, k4=k4,
            cx_px=(width_px - 1) / 2, cy_px=(height_px - 1) / 2,
            width_px=width_px, height_px=height_px, air_gap_mm=o.air_gap_mm,
            acrylic_mm=o.acrylic_mm, gel_mm=sensor.skin.thickness_mm,
        )  # fmt: skip

    @property
    def centre_px(self) -> tuple[float, float]:
        """Principal point: image point of the lens's axis."""
        return (self.cx_px, self.cy_px)

    @property
    def mm_per_px(self) -> float:
        """Scale of the resting face below an upright pupil."""
        return (
            self.air_gap_mm + self.acrylic_mm / self.n_acrylic + self.gel_mm / self.n_gel
        ) / self.f_px

    @cached_property
    def field_rad(self) -> float:
        """Largest angle from the axis with an image."""
        # Where 1 + 3 k1 t^2 + 5 k2 t^4 + ... falls to MIN_RADIUS_GROWTH.
        terms = [9 * self.k4, 7 * self.k3, 5 * self.k2, 3 * self.k1, 1 - MIN_RADIUS_GROWTH]
        roots = np.roots(terms)
        turns = [math.sqrt(r.real) for r in roots if abs(r.imag) < 1e-12 and r.real > 0]
        return min([MAX_FIELD_RAD, *turns])

    def project_px(self, xyz_mm: Array, medium: Medium = "gel") -> Array:
        """Sensor points (..., 3) in mm to image points (..., 2) in px, to 1e-9 px.

        Raises InputError for points outside the medium (gel, or air beyond the face) or outside the
        field; SolverError if no ray was found.
        """
        tan = self._tangents(xyz_mm, medium)
        towards = np.concatenate((tan, np.ones_like(tan[..., :1])), axis=-1) @ self._turn
        across_, along = np.hypot(towards[..., 0], towards[..., 1]), towards[..., 2]
        theta = np.arctan2(across_, along)
        if not np.all(theta <= self.field_rad):
            raise InputError(
                f"a point is {np.degrees(np.max(theta)):.1f} degrees from the lens's axis, "
                f"outside its field of {math.degrees(self.field_rad):.1f}"
            )
        # Radius over sine; its limit on the axis, where both vanish.
        with np.errstate(invalid="ignore", divide="ignore"):
            per = np.where(across_ > 0, theta / across_, 1 / along)
        gain = self.f_px * per * self._stretch(theta**2)
        off_px = towards[..., :2] * gain[..., None]
        if self.p1 or self.p2:
            off_px = off_px + self.f_px * self._decentring(off_px / self.f_px)
        if self.aspect != 1:
            off_px = off_px * (1.0, self.aspect)
        return off_px + np.asarray(self.centre_px)

    def crossing_mm(self, xyz_mm: Array, medium: Medium = "gel") -> Array:
        """Intersections (..., 2) mm of the rays to points (..., 3) with the resting face.

        Raises as project_px does, but for the field.
        """
        return self._trace_mm(self._tangents(xyz_mm, medium), self.gel_mm, 0.0)[0]

    def ray_to(self, xyz_mm: Array, medium: Medium = "gel") -> tuple[Array, Array]:
        """Rays to points (..., 3), as returned by `ray`. Raises as crossing_mm does."""
        return self._rays(self._tangents(xyz_mm, medium), medium)

    def rest_px(self, xy_mm: Array) -> Array:
        return self.project_px(on_face(xy_mm))

    def rest_mm(self, px: Array) -> Array:
        return self.ray(px)[0][..., :2]

    def ray(self, px: Array, medium: Medium = "gel") -> tuple[Array, Array]:
        """Rays as in `CameraModel`; nan outside the field, or if the ray misses the face."""
        point = (np.asarray(px, float) - np.asarray(self.centre_px)) / self.f_px
        if self.aspect != 1:
            point = point / (1.0, self.aspect)
        if self.p1 or self.p2:
            distorted = point
            with np.errstate(over="ignore", invalid="ignore"):
                for _ in range(DECENTRING_ITERATIONS):
                    previous, point = point, distorted - self._decentring(point)
                # Divergence: decentring folds the image, the ray is ambiguous.
                settled = np.abs(point - previous).max(axis=-1, keepdims=True) < DECENTRING_SETTLED
                point = np.where(settled, point, np.nan)
        radius = np.hypot(point[..., 0], point[..., 1])
        theta = self._angle(radius)
        with np.errstate(invalid="ignore", divide="ignore"):
            per = np.where(radius > 0, np.sin(theta) / radius, 1.0)
            towards = np.concatenate((point * per[..., None], np.cos(theta)[..., None]), axis=-1)
            towards = towards @ self._turn.T
            towards = np.where(towards[..., 2:] > 0, towards, np.nan)
            tan = towards[..., :2] / towards[..., 2:]
        return self._rays(tan, medium)

    def maps(self) -> None:
        """Return None: the image is the raw one."""

    def as_dict(self) -> dict[str, Any]:
        return {"model": "fisheye", **asdict(self)}

    @cached_property
    def _turn(self) -> NDArray[np.float64]:
        """Rotation (3, 3) from the lens's frame to the sensor's."""
        x, y, turn = (math.radians(a) for a in (self.tilt_x_deg, self.tilt_y_deg, self.roll_deg))
        about_x = [[1, 0, 0], [0, math.cos(x), -math.sin(x)], [0, math.sin(x), math.cos(x)]]
        about_y = [[math.cos(y), 0, math.sin(y)], [0, 1, 0], [-math.sin(y), 0, math.cos(y)]]
        about_z = [[math.cos(turn), -math.sin(turn), 0], [math.sin(turn), math.cos(turn), 0]]
        return np.array(about_x) @ np.array(about_y) @ np.array([*about_z, [0, 0, 1]])

    def _rays(self, tan: Array, medium: Medium) -> tuple[Array, Array]:
        """Origins on the resting face and directions of rays with tangents (..., 2) in the gap."""
        face_mm = self._trace_mm(tan, self.gel_mm, 0.0)[0]
        slope = tan
        if medium == "gel":
            slope = tan * refracted_ratio(np.sum(tan**2, axis=-1), self.n_gel)[..., None]
        zeros, ones = np.zeros_like(face_mm[..., :1]), np.ones_like(face_mm[..., :1])
        return np.concatenate((face_mm, zeros), axis=-1), np.concatenate((slope, ones), axis=-1)

    def _stretch(self, square: Array) -> Array:
        """Image radius over f theta, for squared angles."""
        k1, k2, k3, k4 = self.k1, self.k2, self.k3, self.k4
        if k3 == k4 == 0:
            return np.asarray(1 + square * (k1 + square * k2))
        return np.asarray(1 + square * (k1 + square * (k2 + square * (k3 + square * k4))))

    def _decentring(self, point: Array) -> Array:
        """Decentring shift of points (..., 2) in focal lengths from the axis (Brown 1966)."""
        u, v = point[..., 0], point[..., 1]
        cross, square = 2 * u * v, u * u + v * v
        return np.stack(
            (
                self.p1 * cross + self.p2 * (square + 2 * u * u),
                self.p1 * (square + 2 * v * v) + self.p2 * cross,
            ),
            axis=-1,
        )

    def _angle(self, radius: Array) -> Array:
        """Angle from the axis, rad, of image radii over f; nan outside the field."""
        nodes = np.linspace(0, self.field_rad, 1024)
        radii = nodes * self._stretch(nodes**2)
        theta = np.interp(radius, radii, nodes, right=np.nan)
        for _ in range(3):  # from an error of 1e-6 or less: 1e-12, then rounding
            square = theta**2
            value = theta * self._stretch(square)
            high = square * square * (7 * self.k3 + square * 9 * self.k4)
            growth = 1 + square * (3 * self.k1 + square * 5 * self.k2 + high)
            theta = theta - (value - radius) / growth
        return np.asarray(theta)

    def _tangents(self, xyz_mm: Array, medium: Medium) -> Array:
        """Tangents (..., 2) from z, in the air gap, of the rays through points (..., 3).

        Newton's method. Without pupil shift, a ray's reach is concave in its tangent, so Newton
        from the left converges; that solution is the start with pupil shift.
        """
        points = np.asarray(xyz_mm, float)
        z = points[..., 2]
        gel, free = (
            (self.gel_mm + z, np.zeros_like(z))
            if medium == "gel"
            else (np.full_like(z, self.gel_mm), z)
        )
        if not (np.all(gel > 0) and np.all(free > -FACE_SLACK_MM) and np.all(np.isfinite(points))):
            region = f"in the gel, z > {-self.gel_mm:g}" if medium == "gel" else "in air, z >= 0"
            raise InputError(f"a point to be projected is not {region} mm")
        aim = points[..., :2] - (self.x0_mm, self.y0_mm)
        distance = np.hypot(aim[..., 0], aim[..., 1])
        t = distance / (
            self.air_gap_mm + free + self.acrylic_mm / self.n_acrylic + gel / self.n_gel
        )
        for _ in range(3):
            reach, growth = self._reach(t, self.air_gap_mm + free, gel)
            t = t + (distance - reach) / growth
        with np.errstate(invalid="ignore", divide="ignore"):
            tan = np.where(distance > 0, t / distance, 0.0)[..., None] * aim
        for _ in range(MAX_RAY_ITERATIONS):
            hit, jacobian = self._trace_mm(tan, gel, free)
            miss = hit - points[..., :2]
            (xx, xy), (yx, yy) = jacobian
            det = xx * yy - xy * yx
            step = np.stack(
                (
                    (yy * miss[..., 0] - xy * miss[..., 1]) / det,
                    (xx * miss[..., 1] - yx * miss[..., 0]) / det,
                ),
                axis=-1,
            )
            tan = tan - step
            size = np.hypot(step[..., 0], step[..., 1])
            if np.all(size <= RAY_STEP_RAD * np.sqrt(1 + np.sum(tan**2, axis=-1))):
                return tan
        raise SolverError(f"lens: ray to a point not found in {MAX_RAY_ITERATIONS} iterations")

    def _reach(self, t: Array, air_mm: Array, gel_mm: Array) -> tuple[Array, Array]:
        """Radial offset in mm of rays with tangents t through the layers, and its derivative."""
        square = t**2
        plate, gel = refracted_ratio(square, self.n_acrylic), refracted_ratio(square, self.n_gel)
        reach = t * (air_mm + self.acrylic_mm * plate + gel_mm * gel)
        growth = air_mm + self.n_acrylic**2 * self.acrylic_mm * plate**3
        return reach, growth + self.n_gel**2 * gel_mm * gel**3

    def _trace_mm(self, tan: Array, gel_mm: Depth, beyond_mm: Depth) -> tuple[Array, Any]:
        """Positions (..., 2) mm of rays of tangents (..., 2) after gel_mm of gel, beyond_mm of air.

        Also returns the derivative by the tangents ((xx, xy), (yx, yy)).
        """
        tx, ty = tan[..., 0], tan[..., 1]
        square = tx**2 + ty**2
        plate, gel = refracted_ratio(square, self.n_acrylic), refracted_ratio(square, self.n_gel)
        per = self.air_gap_mm + beyond_mm + self.acrylic_mm * plate + gel_mm * gel
        # d across / d tan^2 = - (n^2 - 1) / 2 across^3, and d tan^2 = 2 tan d tan.
        bend = -(self.n_acrylic**2 - 1) * self.acrylic_mm * plate**3
        bend = bend - (self.n_gel**2 - 1) * gel_mm * gel**3
        x, y = self.x0_mm + tx * per, self.y0_mm + ty * per
        xx, xy, yy = per + bend * tx**2, bend * tx * ty, per + bend * ty**2
        yx = xy
        if self.pupil_shift_mm:
            ax, ay, az = self._turn[:, 2]
            cross = np.stack((ty * az - ay, ax - tx * az, tx * ay - ty * ax))
            along = tx * ax + ty * ay + az
            sine = np.sqrt(np.sum(cross**2, axis=0))
            theta = np.arctan2(sine, along)
            back = self.pupil_shift_mm * theta**2
            # A pupil shift back by b moves the ray (tx, ty, 1) sideways by b (tan - a).
            aside_x, aside_y = tx * az - ax, ty * az - ay
            x, y = x + back * aside_x, y + back * aside_y
            # theta^2 changes with the cosine c by - 2 theta / sin theta, which is - 2 on the axis.
            length = np.sqrt(1 + square)
            with np.errstate(invalid="ignore", divide="ignore"):
                turn = np.where(sine > 0, theta * length / sine, 1.0)
            factor = -2 * self.pupil_shift_mm * turn
            cosine = along / length
            dx = factor * (ax - cosine * tx / length) / length
            dy = factor * (ay - cosine * ty / length) / length
            xx, xy = xx + back * az + aside_x * dx, xy + aside_x * dy
            yx, yy = yx + aside_y * dx, yy + back * az + aside_y * dy
        return np.stack((x, y), axis=-1), ((xx, xy), (yx, yy))


def on_face(xy_mm: Array) -> Array:
    """Points (..., 2) of the resting face as (..., 3) with z = 0."""
    xy = np.asarray(xy_mm, float)
    return np.concatenate((xy, np.zeros_like(xy[..., :1])), axis=-1)
