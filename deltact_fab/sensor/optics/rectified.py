"""The view that trackers use: the resting face at one scale, out of a fisheye's image."""

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
"""Between the view's pixels that a share is counted on."""
PROBE_STEP_MM = 0.01


@dataclass(frozen=True)
class Rectified(Bounded, ScaledView):
    """A fisheye's image resampled so that the resting face has mm_per_px everywhere.

    At rest a column is one x and a row one y, as a pinhole's; the image's centre is the sensor's
    origin. Anything else is where the lens's own ray to it crosses the resting face.
    """

    least_patch_px: ClassVar[float] = 2.0
    """Raw pixels that a patch needs each way: fewer, and its neighbours are mixed in (Nyquist)."""
    lens: Fisheye
    mm_per_px: float = bounded_number(0.0378, "scale of the resting face", 1e-3, 1)
    width_px: int = bounded_number(798, "image's side along x", 8, 10_000)
    height_px: int = bounded_number(586, "image's side along y", 8, 10_000)

    @classmethod
    def from_sensor(cls, sensor: SensorDimensions, lens: Fisheye | None = None) -> Rectified:
        """The view of a design, through the nominal lens unless another one is given."""
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
        """Column and row (h, w) float32 of the raw image for each pixel; made once, 0.3 to 0.6 s.

        Raises InputError where the view goes beyond the lens's field.
        """
        return self._maps

    def visible_pixels(self) -> NDArray[np.bool_]:
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

    def raw_mm_per_px(self, px: Array) -> Array:
        """Millimetres of the resting face per raw pixel at pixels (..., 2) of the view: (..., 2).

        Along the radius from the pupil's foot, and across it. A view's own pixel is finer where
        this is more than its mm_per_px: the image is enlarged there, and gains nothing by it.
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
        """Share of the view, 0 to 1, in which a patch has fewer than least_patch_px one way."""
        columns = np.arange(SHARE_GRID_PX / 2 - 0.5, self.width_px, SHARE_GRID_PX)
        rows = np.arange(SHARE_GRID_PX / 2 - 0.5, self.height_px, SHARE_GRID_PX)
        scales = self.raw_mm_per_px(np.stack(np.meshgrid(columns, rows), axis=-1))
        return float(np.mean(patch_mm < self.least_patch_px * np.max(scales, axis=-1)))

    def as_dict(self) -> dict[str, Any]:
        return {"model": "rectified", **asdict(self), "lens": self.lens.as_dict()}

    @cached_property
    def _maps(self) -> tuple[Array, Array]:
        columns, rows = np.arange(self.width_px), np.arange(self.height_px)
        face_mm = self.rest_mm(np.stack(np.meshgrid(columns, rows), axis=-1).astype(float))
        raw = self.lens.rest_px(face_mm).astype(np.float32)
        return np.ascontiguousarray(raw[..., 0]), np.ascontiguousarray(raw[..., 1])
