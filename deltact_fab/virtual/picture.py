"""What the camera sees: the printed pattern carried by the deformed surface, drawn by inverse map.

For every image pixel the material point that projects there is found by iteration on the same
displacement field that the truth stores; where the surface hides a part of itself, the nearest
point on the pixel's ray (`occlusion`). The texture is sampled four times a pixel.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import SolverError
from ..imaging import Float, Sensor
from ..occlusion import in_dispute, nearest
from ..optics import CameraModel, LatticeSampler, SurfaceLattice, axes_mm

MARGIN_PX = 64
TOLERANCE_PX = 2e-3
FIXED_POINT_ITERATIONS = 6
NEWTON_ITERATIONS = 40
MAX_STEP_PX = 8.0


@dataclass(frozen=True)
class Texture:
    """Linear reflectance (h, w, 3 RGB) of the printed sticker, centred on the sensor's origin."""

    values: Float
    mm_per_texel: float


class Picture:
    """Draws frames of one pattern through one camera."""

    def __init__(
        self, camera: CameraModel, lattice: SurfaceLattice, texture: Texture, sensor: Sensor
    ) -> None:
        self.camera = camera
        self._texture = texture
        self._sensor = sensor
        self._shade = sensor.shade(camera.height_px, camera.width_px)
        self._xs_mm, self._ys_mm = axes_mm(camera, MARGIN_PX)
        self._sampler = LatticeSampler.make(lattice, self._xs_mm, self._ys_mm)
        # One pixel of border, so that the halved grid below is interpolated at the edge too.
        self._target = np.stack(
            np.meshgrid(
                np.arange(-1, camera.width_px + 1, dtype=np.float32),
                np.arange(-1, camera.height_px + 1, dtype=np.float32),
            ),
            axis=-1,
        )

    def render(
        self, displacement_mm: NDArray[np.float64] | None, rng: np.random.Generator
    ) -> NDArray[np.uint8]:
        """Image (h, w, 3) BGR of a surface displacement (ny, nx, 3) on the lattice, None at rest.

        Raises SolverError where a pixel sees no point of the surface.
        """
        at = self._target if displacement_mm is None else self.material_px(displacement_mm)
        fine = cv2.resize(at, None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR)[2:-2, 2:-2]
        cx, cy = self.camera.centre_px
        texels = self.camera.mm_per_px / self._texture.mm_per_texel
        h, w = self._texture.values.shape[:2]
        map_x = (fine[..., 0] - np.float32(cx)) * np.float32(texels) + np.float32((w - 1) / 2)
        map_y = (fine[..., 1] - np.float32(cy)) * np.float32(texels) + np.float32((h - 1) / 2)
        seen = cv2.remap(
            self._texture.values, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        radiance = cv2.resize(
            seen,
            (self.camera.width_px, self.camera.height_px),
            interpolation=cv2.INTER_AREA,
        )
        return self._sensor.expose(np.asarray(radiance, np.float32), self._shade, rng)

    def forward_px(self, displacement_mm: NDArray[np.float64]) -> Float:
        """Projected displacement of the rest pixels and their margin, (h + 2m, w + 2m, 2)."""
        return self._forward(displacement_mm)[0]

    def _forward(
        self, displacement_mm: NDArray[np.float64]
    ) -> tuple[Float, NDArray[np.float64], NDArray[np.float64]]:
        """The same, where in the image these points are, px, and how far out they stand, mm."""
        u = self._sampler(displacement_mm)
        x, y = np.meshgrid(self._xs_mm, self._ys_mm)
        rest = np.stack((x, y, np.zeros_like(x)), axis=-1)
        seen_px = self.camera.project_px(rest + u)
        moved = seen_px - self.camera.rest_px(rest[..., :2])
        return np.asarray(moved, np.float32), seen_px, u[..., 2]

    def material_px(self, displacement_mm: NDArray[np.float64]) -> Float:
        """Rest position (px) of the material point seen by each pixel, with a border of one pixel.

        Solves X + g(X) = p for X with g the projected displacement; shape (h + 2, w + 2, 2).
        """
        field, seen_px, out_mm = self._forward(displacement_mm)
        at = before = self._target
        for _ in range(FIXED_POINT_ITERATIONS):
            x, y = cv2.split(at + np.float32(MARGIN_PX))
            moved = cv2.remap(field, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            before, at = at, self._target - moved
        x, y = cv2.split(cv2.absdiff(at, before))
        open_ = cv2.max(x, y) >= TOLERANCE_PX
        # Fixed point needs a gradient below 1; the stretched skin behind a sliding tip has more.
        at[open_] = _newton(field, self._target[open_], at[open_])
        # The border's first pixel has the index 0, and lies at -1.
        at_px = seen_px + 1
        wanted = np.isnan(at[..., 0]) | in_dispute(at_px, at.shape[:2])
        if wanted.any():
            at[wanted] = nearest(at_px, out_mm, wanted) - MARGIN_PX
            blind = int(np.isnan(at[..., 0]).sum())
            if blind:
                raise SolverError(
                    f"{blind} pixels of the picture see no point of the surface within "
                    f"{MARGIN_PX} px of the view"
                )
        return at


def _newton(field: Float, target: Float, start: Float) -> Float:
    """Solve X + g(X) = p for points (n, 2) px, g bilinear on the field with its margin.

    nan for those that no step brings home.
    """
    height, width = field.shape[:2]
    p, at = target.astype(float), start.astype(float)
    left = np.arange(len(at))
    for _ in range(NEWTON_ITERATIONS):
        if not len(left):
            break
        x = np.clip(at[left, 0] + MARGIN_PX, 0, width - 1.001)
        y = np.clip(at[left, 1] + MARGIN_PX, 0, height - 1.001)
        j, i = x.astype(int), y.astype(int)
        a, b = (x - j)[:, None], (y - i)[:, None]
        q00, q01 = field[i, j], field[i, j + 1]
        q10, q11 = field[i + 1, j], field[i + 1, j + 1]
        along_x = (q01 - q00) * (1 - b) + (q11 - q10) * b
        along_y = (q10 - q00) * (1 - a) + (q11 - q01) * a
        value = q00 * (1 - b) + q10 * b + along_x * a
        miss = at[left] + value - p[left]
        xx, yx = 1 + along_x[:, 0], along_x[:, 1]
        xy, yy = along_y[:, 0], 1 + along_y[:, 1]
        det = xx * yy - xy * yx
        det = np.where(np.abs(det) < 0.05, np.copysign(0.05, det), det)
        step = np.stack((yy * miss[:, 0] - xy * miss[:, 1], xx * miss[:, 1] - yx * miss[:, 0]), -1)
        at[left] -= np.clip(step / det[:, None], -MAX_STEP_PX, MAX_STEP_PX)
        left = left[np.max(np.abs(miss), axis=-1) >= TOLERANCE_PX]
    at[left] = np.nan
    return at.astype(np.float32)
