"""What draws, records and analyses knows of a camera."""

from __future__ import annotations

from typing import Any, Literal, Protocol

from numpy.typing import NDArray

Array = NDArray[Any]
Medium = Literal["gel", "air"]
"""What lies between the resting face and a point: the gel that moved with it, or free air."""


class CameraModel(Protocol):
    """Where the points of the sensor are in the image. Pixel (0, 0) is the first one's centre."""

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
        """Image points (..., 2) in px to the resting face (..., 2) in mm."""

    def rest_px(self, xy_mm: Array) -> Array:
        """Points of the resting face (..., 2) in mm to image points (..., 2) in px."""

    def axes_mm(self, margin_px: int = 0) -> tuple[Array, Array]:
        """Columns' x (w + 2 margin,) and rows' y (h + 2 margin,) on the resting face, mm."""

    def as_dict(self) -> dict[str, Any]:
        """Plain data for the record, its class under "model"; `camera_from_dict` reads it."""
