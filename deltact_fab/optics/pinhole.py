"""A pinhole on the axis, at the paraxial distance through air, acrylic and gel."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..aliases import Array
from ..errors import InputError
from ..shapes.sensor import N_SILICONE, SensorDimensions
from .camera import Medium


@dataclass(frozen=True)
class Pinhole:
    """A pinhole at z = -eye_distance_mm, scaled so that the resting face has mm_per_px.

    Pixel (0, 0) is the centre of the first pixel; the axis meets the image's centre.
    """

    mm_per_px: float
    width_px: int
    height_px: int
    eye_distance_mm: float

    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012 - read by catalog.validate

    @classmethod
    def of(cls, sensor: SensorDimensions) -> Pinhole:
        """The camera of a design."""
        o = sensor.optics
        return cls(o.mm_per_px, o.image_width_px, o.image_height_px, sensor.eye_distance_mm)

    @property
    def centre_px(self) -> tuple[float, float]:
        """Where the axis meets the image."""
        return ((self.width_px - 1) / 2, (self.height_px - 1) / 2)

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

    def rest_mm(self, px: Array) -> Array:
        """Image points (..., 2) in px to the resting face (..., 2) in mm."""
        return (px - np.asarray(self.centre_px)) * self.mm_per_px

    def rest_px(self, xy_mm: Array) -> Array:
        """Points of the resting face (..., 2) in mm to image points (..., 2) in px."""
        return xy_mm / self.mm_per_px + np.asarray(self.centre_px)

    def ray(self, px: Array, medium: Medium = "gel") -> tuple[Array, Array]:
        """The rays of image points (..., 2): origins on the resting face and directions (..., 3).

        origin + z direction is the ray's point at z, in the gel or in the air beyond the face.
        """
        index = N_SILICONE if medium == "gel" else 1.0
        at = self.rest_mm(px)
        flat, one = np.zeros_like(at[..., :1]), np.ones_like(at[..., :1])
        slope = at / (self.eye_distance_mm * index)
        return np.concatenate((at, flat), axis=-1), np.concatenate((slope, one), axis=-1)

    def maps(self) -> None:
        """None: there is no other image."""

    def as_dict(self) -> dict[str, Any]:
        """Plain data for the record."""
        return {"model": "pinhole", **asdict(self)}
