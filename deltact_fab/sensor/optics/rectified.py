"""Rectified view for trackers: the resting face at uniform scale, from a fisheye image."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Array, InputError

from ..shapes.bounded import Bounded, bounded_number
from ..shapes.sensor import SensorDimensions
from .camera import Medium, ScaledView
from .fisheye import Fisheye, on_face

SHARE_GRID_PX = 8
"""By hand: spacing of pixels on which a share is counted; finer costs time."""
PROBE_STEP_MM = 0.01  # by hand: finite difference, far above rounding, below a pixel


@dataclass(frozen=True)
class Rectified(Bounded, ScaledView):
    """Fisheye image resampled to the uniform scale mm_per_px on the resting face.

    At rest columns and rows are constant x and y, as in a pinhole image; the image's centre is the
    sensor's origin. Other points appear where the lens's ray to them crosses the resting face.
    """

    min_patch_px: ClassVar[float] = 2.0
    """Raw pixels per patch and axis; fewer alias with neighbours (Nyquist)."""
    lens: Fisheye
    mm_per_px: float = bounded_number(0.0378, "scale of the resting face", 1e-3, 1)
    width_px: int = bounded_number(798, "image's side along x", 8, 10_000)
    height_px: int = bounded_number(586, "image's side along y", 8, 10_000)

    @classmethod
    def from_sensor(cls, sensor: SensorDimensions, lens: Fisheye | None = None) -> Rectified:
        """View of a design, through the nominal lens by default."""
        o = sensor.optics
        lens = lens or Fisheye.from_sensor(sensor)
        return cls(lens, o.mm_per_px, o.image_width_px, o.image_height_px)

    def project_px(self, xyz_mm: Array, medium: Medium = "gel") -> Array:
        """Sensor points (..., 3) in mm to image points (..., 2) in px, to 1e-9 px.

        Raises as the lens does.
        """
        return self.rest_px(self.lens.crossing_mm(xyz_mm, medium))

    def ray(self, px: Array, medium: Medium = "gel") -> tuple[Array, Array]:
        return self.lens.ray_to(on_face(self.rest_mm(px)), medium)

    def maps(self) -> tuple[Array, Array]:
        """Column and row (h, w) float32 of the raw image for each pixel; cached, 0.3 to 0.6 s.

        Raises InputError if the view exceeds the lens's field.
        """
        return self._maps

    def visible_pixels(self) -> NDArray[np.bool_]:
        """Mask (h, w) of pixels inside the raw image, with the margin of cubic interpolation."""
        x, y = self._maps
        inside_x = (x >= 1) & (x < self.lens.width_px - 2)
        return np.asarray(inside_x & (y >= 1) & (y < self.lens.height_px - 2))

    def rectify(self, image: Array) -> Array:
        """Rectify a raw image (h, w) or (h, w, 3) by cubic interpolation, 0 outside of it.

        Raises InputError for an image without the lens's size.
        """
        import cv2

        if image.shape[:2] != (self.lens.height_px, self.lens.width_px):
            h, w = image.shape[:2]
            raise InputError(
                f"image of {w} x {h} px; the lens has {self.lens.width_px} x "
                f"{self.lens.height_px} px"
            )
        return np.asarray(cv2.remap(image, *self._maps, cv2.INTER_CUBIC))

    def raw_mm_per_px(self, px: Array) -> Array:
        """Scale (..., 2) in mm per raw pixel at pixels (..., 2) of the view.

        Radial from the pupil's foot, and tangential. Where this exceeds mm_per_px, the view is
        upsampled without gain.
        """
        face_mm = self.rest_mm(np.asarray(px, float))
        out = face_mm - (self.lens.x0_mm, self.lens.y0_mm)
        distance = np.hypot(out[..., 0], out[..., 1])[..., None]
        along = np.where(distance > 0, out / np.where(distance > 0, distance, 1.0), (1.0, 0.0))
        across = np.stack((-along[..., 1], along[..., 0]), axis=-1)
        scales = []
        for direction in (along, across):
            step_mm = PROBE_STEP_MM * direction
            step_px = self.lens.rest_px(face_mm + step_mm) - self.lens.rest_px(face_mm - step_mm)
            scales.append(2 * PROBE_STEP_MM / np.hypot(step_px[..., 0], step_px[..., 1]))
        return np.stack(scales, axis=-1)

    def aliased_share(self, patch_mm: float) -> float:
        """Share of the view, 0 to 1, where a patch has fewer than min_patch_px on one axis."""
        columns = np.arange(SHARE_GRID_PX / 2 - 0.5, self.width_px, SHARE_GRID_PX)
        rows = np.arange(SHARE_GRID_PX / 2 - 0.5, self.height_px, SHARE_GRID_PX)
        scales = self.raw_mm_per_px(np.stack(np.meshgrid(columns, rows), axis=-1))
        return float(np.mean(patch_mm < self.min_patch_px * np.max(scales, axis=-1)))

    def as_dict(self) -> dict[str, Any]:
        return {"model": "rectified", **asdict(self), "lens": self.lens.as_dict()}

    @cached_property
    def _maps(self) -> tuple[Array, Array]:
        columns, rows = np.arange(self.width_px), np.arange(self.height_px)
        face_mm = self.rest_mm(np.stack(np.meshgrid(columns, rows), axis=-1).astype(float))
        raw = self.lens.rest_px(face_mm).astype(np.float32)
        return np.ascontiguousarray(raw[..., 0]), np.ascontiguousarray(raw[..., 1])
