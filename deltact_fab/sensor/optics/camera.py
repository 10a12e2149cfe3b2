"""Interface of camera models, the pinhole camera, and the stage's frame."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, Protocol

import numpy as np

from deltact_fab.common import Array, InputError, Point, Point2

from ..shapes.sensor import N_SILICONE, SensorDimensions

Medium = Literal["gel", "air"]
"""Medium between the resting face and a point: deformed gel, or air beyond the face."""


class CameraModel(Protocol):
    """Camera model: sensor points to image points. (0, 0) is the centre of the first pixel."""

    @property
    def width_px(self) -> int: ...
    @property
    def height_px(self) -> int: ...
    @property
    def mm_per_px(self) -> float:
        """Scale of the resting face at the image's centre."""

    @property
    def centre_px(self) -> tuple[float, float]:
        """Image point of the optical axis."""

    def project_px(self, xyz_mm: Array, medium: Medium = "gel") -> Array:
        """Project points (..., 3) in mm to image points (..., 2) in px. Raises InputError."""

    def rest_mm(self, px: Array) -> Array:
        """Back-project image points (..., 2) in px to the resting face (..., 2) in mm, or nan."""

    def rest_px(self, xy_mm: Array) -> Array:
        """Project points of the resting face (..., 2) in mm to image points (..., 2) in px."""

    def ray(self, px: Array, medium: Medium = "gel") -> tuple[Array, Array]:
        """Rays of image points (..., 2) in px as origins and directions (..., 3), nan if none.

        Origins are on the resting face and directions have z = 1, so origin + z direction is the
        point seen at z, in the deformed gel or in the air beyond the face.
        """

    def maps(self) -> tuple[Array, Array] | None:
        """Maps for cv2.remap from the raw image: column and row (h, w) float32.

        None if this is the raw image.
        """

    def as_dict(self) -> dict[str, Any]:
        """Plain data for the record, with its class as "model"; `restore_camera` reads it."""


def axes_mm(camera: CameraModel, margin_px: int = 0) -> tuple[Array, Array]:
    """x of columns (w + 2 margin,) and y of rows (h + 2 margin,) on the resting face, mm.

    For undistorted images (pinhole, rectified). Raises ValueError for a lens with distortion.
    """
    columns, rows = (
        np.arange(-margin_px, n + margin_px, dtype=float)
        for n in (camera.width_px, camera.height_px)
    )
    cx, cy = camera.centre_px
    xs = camera.rest_mm(np.stack((columns, np.full_like(columns, cy)), axis=-1))[:, 0]
    ys = camera.rest_mm(np.stack((np.full_like(rows, cx), rows), axis=-1))[:, 1]
    corners = camera.rest_mm(np.array([[columns[0], rows[0]], [columns[-1], rows[-1]]]))
    if not np.allclose(corners, [[xs[0], ys[0]], [xs[-1], ys[-1]]], rtol=0, atol=1e-9):
        raise ValueError("this camera has distortion; use its rectified view")
    return xs, ys


class ScaledView:
    """View with a uniform scale mm_per_px on the resting face.

    See `CameraModel` for the methods.
    """

    mm_per_px: float
    width_px: int
    height_px: int

    @property
    def centre_px(self) -> tuple[float, float]:
        return ((self.width_px - 1) / 2, (self.height_px - 1) / 2)

    def rest_mm(self, px: Array) -> Array:
        return (px - np.asarray(self.centre_px)) * self.mm_per_px

    def rest_px(self, xy_mm: Array) -> Array:
        return xy_mm / self.mm_per_px + np.asarray(self.centre_px)


@dataclass(frozen=True)
class Pinhole(ScaledView):
    """A pinhole at z = -eye_distance_mm, scaled so that the resting face has mm_per_px.

    Pixel (0, 0) is the centre of the first pixel; the axis meets the image's centre.
    """

    mm_per_px: float
    width_px: int
    height_px: int
    eye_distance_mm: float

    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012 - read by catalog.validate

    def __post_init__(self) -> None:
        limits = {
            "mm_per_px": (1e-4, 10.0), "width_px": (1, 20_000), "height_px": (1, 20_000),
            "eye_distance_mm": (1e-3, math.inf),
        }  # fmt: skip
        for name, (low, high) in limits.items():
            if not low <= getattr(self, name) <= high:
                text = f"expected {low:g} to {high:g}, not {getattr(self, name):g}"
                raise ValueError(f"{name}: {text}")

    @classmethod
    def from_sensor(cls, sensor: SensorDimensions) -> Pinhole:
        o = sensor.optics
        return cls(o.mm_per_px, o.image_width_px, o.image_height_px, sensor.eye_distance_mm)

    def project_px(self, xyz_mm: Array, medium: Medium = "gel") -> Array:
        """Sensor points (..., 3) in mm to image points (..., 2) in px.

        eye_distance_mm is apparent, so depths count divided by the index of the medium (paraxial
        Snell): a point at z is magnified by eye / (eye + z / n).
        Raises InputError for points at or behind the eye.
        """
        index = N_SILICONE if medium == "gel" else 1.0
        scale = self.eye_distance_mm + xyz_mm[..., 2] / index
        if not np.all(scale > 0):
            raise InputError("a surface point is at or behind the camera")
        gain = (self.eye_distance_mm / self.mm_per_px) / scale
        cx, cy = self.centre_px
        return np.stack((xyz_mm[..., 0] * gain + cx, xyz_mm[..., 1] * gain + cy), axis=-1)

    def ray(self, px: Array, medium: Medium = "gel") -> tuple[Array, Array]:
        index = N_SILICONE if medium == "gel" else 1.0
        face_mm = self.rest_mm(px)
        zeros, ones = np.zeros_like(face_mm[..., :1]), np.ones_like(face_mm[..., :1])
        foot_mm = self.rest_mm(np.asarray(self.centre_px))  # on the axis
        slope = (face_mm - foot_mm) / (self.eye_distance_mm * index)
        return np.concatenate((face_mm, zeros), axis=-1), np.concatenate((slope, ones), axis=-1)

    def maps(self) -> None:
        """Return None: the image is the raw one."""

    def as_dict(self) -> dict[str, Any]:
        return {"model": "pinhole", **asdict(self)}

    def with_pose(self, at_mm: Point2, height_mm: float, gel_mm: float, roll_deg: float) -> Pinhole:
        """Return this camera moved in its plane and turned about its axis.

        height_mm, gel_mm: air and gel that are added between it and the face.
        """
        eye_mm = self.eye_distance_mm + height_mm + gel_mm / N_SILICONE
        scale = self.mm_per_px * eye_mm / self.eye_distance_mm
        return MovedPinhole(scale, self.width_px, self.height_px, eye_mm, *at_mm, roll_deg)


@dataclass(frozen=True)
class MovedPinhole(Pinhole):
    """A pinhole above (x0_mm, y0_mm), its image rotated by roll_deg as a `Fisheye`'s.

    It sees the face shifted and rotated, so its image is rectified before it is used.
    """

    x0_mm: float = 0.0
    y0_mm: float = 0.0
    roll_deg: float = 0.0

    def project_px(self, xyz_mm: Array, medium: Medium = "gel") -> Array:
        return self._roll(super().project_px(xyz_mm - (self.x0_mm, self.y0_mm, 0.0), medium), 1)

    def rest_px(self, xy_mm: Array) -> Array:
        return self._roll(super().rest_px(xy_mm - (self.x0_mm, self.y0_mm)), 1)

    def rest_mm(self, px: Array) -> Array:
        return super().rest_mm(self._roll(px, -1)) + (self.x0_mm, self.y0_mm)

    def crossing_mm(self, xyz_mm: Array, medium: Medium = "gel") -> Array:
        """Intersections (..., 2) mm of the rays to points (..., 3) with the resting face."""
        return self.rest_mm(self.project_px(xyz_mm, medium))

    def as_dict(self) -> dict[str, Any]:
        return {"model": "moved-pinhole", **asdict(self)}

    def _roll(self, px: Array, sign: int) -> Array:
        """Image points (..., 2) rotated about the image's centre; sign: 1, or -1 for back."""
        c, s = np.cos(np.radians(self.roll_deg)), sign * np.sin(np.radians(self.roll_deg))
        centre = np.asarray(self.centre_px)
        return (px - centre) @ np.array([[c, -s], [s, c]]) + centre


@dataclass(frozen=True)
class StageFrame:
    """Rigid transform between the sensor frame and the stage's machine frame.

    machine = Rz(angle) Ry(tilt[1]) Rx(tilt[0]) sensor + origin. Without tilt the stage's z is the
    sensor's +z; tilt is the registered tilt of the resting face.
    """

    origin_machine_mm: Point
    angle_deg: float = 0.0
    tilt_deg: tuple[float, float] = (0.0, 0.0)
    """Tilt of the face, about the sensor's x, then about y."""

    def to_machine_mm(self, sensor_mm: Point) -> Point:
        """Convert a tip position in the sensor frame to machine coordinates."""
        c, s = self._cos_sin()
        x, y, z = self._apply_tilt(sensor_mm)
        ox, oy, oz = self.origin_machine_mm
        return (ox + c * x - s * y, oy + s * x + c * y, oz + z)

    def to_sensor_mm(self, machine_mm: Point) -> Point:
        """Convert machine coordinates to a tip position in the sensor frame."""
        c, s = self._cos_sin()
        x, y, z = (m - o for m, o in zip(machine_mm, self.origin_machine_mm, strict=True))
        return self._remove_tilt((c * x + s * y, -s * x + c * y, z))

    def with_normal(self, normal_machine: Point) -> StageFrame:
        """Return the frame with the tilt of a face of this outward normal, of any length.

        Raises ValueError for a normal that does not point up.
        """
        length = math.hypot(*normal_machine)
        if not (math.isfinite(length) and normal_machine[2] > 0):
            raise ValueError(f"a face's normal {normal_machine} must point up (z > 0)")
        c, s = self._cos_sin()
        x, y, z = (n / length for n in normal_machine)
        x, y = c * x + s * y, -s * x + c * y
        tilt = (math.degrees(-math.asin(y)), math.degrees(math.atan2(x, z)))
        return replace(self, tilt_deg=tilt)

    def _cos_sin(self) -> tuple[float, float]:
        angle = np.deg2rad(self.angle_deg)
        return float(np.cos(angle)), float(np.sin(angle))

    def _apply_tilt(self, p: Point) -> Point:
        if self.tilt_deg == (0.0, 0.0):
            return p  # exactly
        (cx, sx), (cy, sy) = ((math.cos(a), math.sin(a)) for a in map(math.radians, self.tilt_deg))
        x, y, z = p[0], cx * p[1] - sx * p[2], sx * p[1] + cx * p[2]
        return (cy * x + sy * z, y, -sy * x + cy * z)

    def _remove_tilt(self, p: Point) -> Point:
        if self.tilt_deg == (0.0, 0.0):
            return p
        (cx, sx), (cy, sy) = ((math.cos(a), math.sin(a)) for a in map(math.radians, self.tilt_deg))
        x, y, z = cy * p[0] - sy * p[2], p[1], sy * p[0] + cy * p[2]
        return (x, cx * y + sx * z, -sx * y + cx * z)
