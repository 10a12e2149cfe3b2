"""The view that trackers use: the resting face at one scale, out of a fisheye's image."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..aliases import Array
from ..errors import InputError
from ..shapes.bounded import check_limits, number
from ..shapes.sensor import SensorDimensions
from .camera import Medium
from .fisheye import Fisheye, on_face
from .table import CrossingTable


@dataclass(frozen=True)
class Rectified:
    """A fisheye's image resampled so that the resting face has mm_per_px everywhere.

    At rest a column is one x and a row one y, as a pinhole's; the image's centre is the sensor's
    origin. Anything else is where the lens's own ray to it crosses the resting face.
    """

    lens: Fisheye
    mm_per_px: float = number(0.0378, "scale of the resting face", 1e-3, 1)
    width_px: int = number(798, "image's side along x", 8, 10_000)
    height_px: int = number(586, "image's side along y", 8, 10_000)

    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012 - read by catalog.validate

    def __post_init__(self) -> None:
        check_limits(self)

    @classmethod
    def of(cls, sensor: SensorDimensions, lens: Fisheye | None = None) -> Rectified:
        """The view of a design, through the nominal lens unless another one is given."""
        o = sensor.optics
        return cls(lens or Fisheye.of(sensor), o.mm_per_px, o.image_width_px, o.image_height_px)

    @property
    def centre_px(self) -> tuple[float, float]:
        """Where the sensor's origin is."""
        return ((self.width_px - 1) / 2, (self.height_px - 1) / 2)

    def project_px(self, xyz_mm: Array, medium: Medium = "gel") -> Array:
        """Sensor points (..., 3) in mm to image points (..., 2) in px, by a table in the gel.

        To 1e-4 px in the gel (`table`) and 1e-9 px in air. Raises as the lens does.
        """
        if medium == "gel":
            return self.rest_px(self._table(xyz_mm))
        return self.rest_px(self.lens.crossing_mm(xyz_mm, medium))

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
        return self.lens.ray_to(on_face(self.rest_mm(px)), medium)

    def maps(self) -> tuple[Array, Array]:
        """Column and row (h, w) float32 of the raw image for each pixel; made once, .3 to .6 s.

        Raises InputError where the view goes beyond the lens's field.
        """
        return self._maps

    def seen(self) -> NDArray[np.bool_]:
        """(h, w) the pixels that the raw image holds, with what cubic interpolation takes."""
        x, y = self._maps
        inside_x = (x >= 1) & (x < self.lens.width_px - 2)
        return np.asarray(inside_x & (y >= 1) & (y < self.lens.height_px - 2))

    def rectify(self, image: Array) -> Array:
        """The view of a raw image (h, w) or (h, w, 3), by cubic interpolation, 0 where not seen.

        Raises InputError for an image that is not of the lens's size.
        """
        import cv2

        if image.shape[:2] != (self.lens.height_px, self.lens.width_px):
            h, w = image.shape[:2]
            raise InputError(
                f"an image of {w} x {h} px; the lens makes {self.lens.width_px} x "
                f"{self.lens.height_px} px"
            )
        return np.asarray(cv2.remap(image, *self._maps, cv2.INTER_CUBIC))

    def as_dict(self) -> dict[str, Any]:
        """Plain data for the record."""
        return {"model": "rectified", **asdict(self), "lens": self.lens.as_dict()}

    @cached_property
    def _table(self) -> CrossingTable:
        half_mm = math.hypot(self.width_px, self.height_px) * self.mm_per_px / 2
        foot_mm = math.hypot(self.lens.x0_mm, self.lens.y0_mm)
        # A view beyond the view, and what is so deep that its ray runs aside by the gel's height.
        return CrossingTable(self.lens, 1.5 * half_mm + foot_mm + self.lens.gel_mm)

    @cached_property
    def _maps(self) -> tuple[Array, Array]:
        columns, rows = np.arange(self.width_px), np.arange(self.height_px)
        at = self.rest_mm(np.stack(np.meshgrid(columns, rows), axis=-1).astype(float))
        raw = self.lens.rest_px(at).astype(np.float32)
        return np.ascontiguousarray(raw[..., 0]), np.ascontiguousarray(raw[..., 1])
