"""What is known of a camera by all who use one, the simplest, a pinhole; and the stage's frame."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, Protocol

import numpy as np

from deltact_fab.common import Array, InputError, Point

from ..shapes.sensor import N_SILICONE, SensorDimensions

Medium = Literal["gel", "air"]
"""What lies between the resting face and a point: the gel that moved with it, or free air."""


class CameraModel(Protocol):
    """A camera: points of the sensor to its image. Pixel (0, 0) is the first one's centre."""

    @property
    def width_px(self) -> int: ...
    @property
    def height_px(self) -> int: ...
    @property
    def mm_per_px(self) -> float:
        """Of the resting face, at the image's centre."""

    @property
    def centre_px(self) -> tuple[float, float]:
        """Where the axis meets the image."""

    def project_px(self, xyz_mm: Array, medium: Medium = "gel") -> Array:
        """Sensor points (..., 3) in mm to image points (..., 2) in px. Raises InputError."""

    def rest_mm(self, px: Array) -> Array:
        """Image points (..., 2) in px to the resting face (..., 2) in mm; nan where none is."""

    def rest_px(self, xy_mm: Array) -> Array:
        """Points of the resting face (..., 2) in mm to image points (..., 2) in px."""

    def ray(self, px: Array, medium: Medium = "gel") -> tuple[Array, Array]:
        """Origins and directions (..., 3) of image points (..., 2) in px, nan where none is.

        An origin is on the resting face and a direction has 1 as its z, so origin + z direction
        is what the pixel sees at z: in the gel that moved there, or in the air beyond the face.
        """

    def maps(self) -> tuple[Array, Array] | None:
        """Column and row (h, w) float32 of the raw image for each pixel; None: it is the raw one.

        A raw image becomes this one by cv2.remap.
        """

    def as_dict(self) -> dict[str, Any]:
        """Plain data for the record, its class under "model"; `restore_camera` reads it."""


def axes_mm(camera: CameraModel, margin_px: int = 0) -> tuple[Array, Array]:
    """Columns' x (w + 2 margin,) and rows' y (h + 2 margin,) on the resting face, mm.

    Of an image in which a column is one x, as a pinhole's or a rectified one. Raises ValueError
    for a lens with distortion.
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
        raise ValueError("a column of this camera's image is not one x; use its rectified view")
    return xs, ys


class ScaledView:
    """An image in which the resting face has mm_per_px everywhere; a column is one x.

    See `CameraModel` for what the methods of a model take and give.
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

    @classmethod
    def from_sensor(cls, sensor: SensorDimensions) -> Pinhole:
        o = sensor.optics
        return cls(o.mm_per_px, o.image_width_px, o.image_height_px, sensor.eye_distance_mm)

    def project_px(self, xyz_mm: Array, medium: Medium = "gel") -> Array:
        """Sensor points (..., 3) in mm to image points (..., 2) in px.

        The eye's distance is the apparent one, so a depth counts as it is seen, divided by the
        index of the medium (paraxial Snell): a point at z is seen larger by eye / (eye + z / n).
        Raises InputError for points at or behind the eye.
        """
        index = N_SILICONE if medium == "gel" else 1.0
        scale = self.eye_distance_mm + xyz_mm[..., 2] / index
        if not np.all(scale > 0):
            raise InputError("a surface point lies at or behind the camera's eye")
        gain = (self.eye_distance_mm / self.mm_per_px) / scale
        cx, cy = self.centre_px
        return np.stack((xyz_mm[..., 0] * gain + cx, xyz_mm[..., 1] * gain + cy), axis=-1)

    def ray(self, px: Array, medium: Medium = "gel") -> tuple[Array, Array]:
        index = N_SILICONE if medium == "gel" else 1.0
        face_mm = self.rest_mm(px)
        zeros, ones = np.zeros_like(face_mm[..., :1]), np.ones_like(face_mm[..., :1])
        slope = face_mm / (self.eye_distance_mm * index)
        return np.concatenate((face_mm, zeros), axis=-1), np.concatenate((slope, ones), axis=-1)

    def maps(self) -> None:
        """None: the raw image is seen as it is."""

    def as_dict(self) -> dict[str, Any]:
        return {"model": "pinhole", **asdict(self)}


@dataclass(frozen=True)
class StageFrame:
    """Rigid transform between the sensor frame and the stage's machine frame.

    machine = Rz(angle) Ry(tilt[1]) Rx(tilt[0]) of the sensor point, then the origin added. Without
    a tilt the stage's z points up along the sensor's +z; with one the resting face lies as askew to
    the stage's axes as it was registered. Straight lines remain straight.
    """

    origin_machine_mm: Point
    angle_deg: float = 0.0
    tilt_deg: tuple[float, float] = (0.0, 0.0)
    """Of the face, about the sensor's x, then about y."""

    def to_machine_mm(self, sensor_mm: Point) -> Point:
        """A tip position in the sensor frame to machine coordinates."""
        c, s = self._cos_sin()
        x, y, z = self._tilted(sensor_mm)
        ox, oy, oz = self.origin_machine_mm
        return (ox + c * x - s * y, oy + s * x + c * y, oz + z)

    def to_sensor_mm(self, machine_mm: Point) -> Point:
        """Machine coordinates to a tip position in the sensor frame."""
        c, s = self._cos_sin()
        x, y, z = (m - o for m, o in zip(machine_mm, self.origin_machine_mm, strict=True))
        return self._levelled((c * x + s * y, -s * x + c * y, z))

    def facing(self, normal_machine: Point) -> StageFrame:
        """The same with the tilt of a face whose outward normal this is, of any length.

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

    def _tilted(self, p: Point) -> Point:
        if self.tilt_deg == (0.0, 0.0):
            return p  # to the bit
        (cx, sx), (cy, sy) = ((math.cos(a), math.sin(a)) for a in map(math.radians, self.tilt_deg))
        x, y, z = p[0], cx * p[1] - sx * p[2], sx * p[1] + cx * p[2]
        return (cy * x + sy * z, y, -sy * x + cy * z)

    def _levelled(self, p: Point) -> Point:
        if self.tilt_deg == (0.0, 0.0):
            return p
        (cx, sx), (cy, sy) = ((math.cos(a), math.sin(a)) for a in map(math.radians, self.tilt_deg))
        x, y, z = cy * p[0] - sy * p[2], p[1], sy * p[0] + cy * p[2]
        return (x, cx * y + sx * z, -sx * y + cx * z)
