"""Image chain from colour values to bytes: printer, light, lens, mosaic, noise, cable.

Printer and camera parameters, and their defaults, are in `sensor.shapes.imaging`.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from deltact_fab.sensor import CAMERA_GAMMA, ImageSensor, Printer


def print_colours(
    printer: Printer, values: NDArray[np.float32], rng: np.random.Generator
) -> NDArray[np.float32]:
    """Print colour values (h, w, 3 in 0..1, one per printer dot); returns linear reflectance.

    Ordered dither with a random threshold per dot and ink, then misregistration and spread.
    """
    steps = printer.levels - 1
    scaled = values.astype(np.float32) * steps
    low = np.floor(scaled)
    threshold = rng.random(values.shape, dtype=np.float32)
    coded = np.minimum(low + (scaled - low > threshold), steps) / np.float32(steps)
    reflectance = np.power(coded, np.float32(CAMERA_GAMMA))
    shifts = rng.normal(0.0, printer.misregistration_um / 1000 / printer.mm_per_dot, (3, 2))
    sigma = max(printer.spread_um / 1000 / printer.mm_per_dot / 2, 1e-3)
    inks = []
    for c in range(3):
        move = np.array([[1, 0, shifts[c, 0]], [0, 1, shifts[c, 1]]])
        plane = np.ascontiguousarray(reflectance[..., c])
        ink = cv2.warpAffine(plane, move, plane.shape[::-1], borderMode=cv2.BORDER_REPLICATE)
        inks.append(cv2.GaussianBlur(ink, (0, 0), sigma))
    return np.stack(inks, axis=-1)


_DEMOSAIC_CODES: dict[str, int] = {
    "edge-aware": cv2.COLOR_BayerRG2BGR_EA,
    "bilinear": cv2.COLOR_BayerRG2BGR,
    "gradients": cv2.COLOR_BayerRG2BGR_VNG,
}
_JPEG_SAMPLING = {
    "mjpeg-422": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_422,
    "mjpeg-420": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420,
}
# By hand: steps that end within 0.1 % even where a third of the picture is clipped; one pixel of
# each 4 x 4; and the range of a camera's exposure times.
_METER_STEPS, _METER_STRIDE, _GAIN_RANGE = 20, 4, (0.01, 100.0)
_FAR_SQUARED = 1e6  # by hand: squared distance, in half diagonals, of a pixel that sees nothing
# Position and width of the highlight, in half diagonals of the view; by hand, as an LED reflects.
_HIGHLIGHT_AT, _HIGHLIGHT_WIDTH = (0.35, -0.3), 0.06


def view_grid(height: int, width: int) -> NDArray[np.float32]:
    """Pixels from the image's middle, in half diagonals, (h, w, 2) as (x, y)."""
    y, x = (np.arange(n) - (n - 1) / 2 for n in (height, width))
    return np.asarray(np.dstack(np.meshgrid(x, y)) / np.hypot(height / 2, width / 2))


class Exposure:
    """Conversion of light to bytes, for one camera and its pixels' viewing positions.

    position: (h, w, 2) from the view's middle, in half diagonals; inf where nothing is seen.
    """

    brightness = 1.0
    """Light at present, as a share of the design's."""

    def __init__(self, sensor: ImageSensor, position: NDArray[np.float32]) -> None:
        self._sensor = sensor
        square = np.minimum(np.sum(position**2, axis=-1)[..., None], _FAR_SQUARED)
        light = np.maximum(1 - sensor.shading * square, 0)
        self._outward = np.minimum(square, 1).astype(np.float32)
        if sensor.led_gradient != 1:
            light *= 1 + (sensor.led_gradient - 1) * self._outward
            light /= max(1.0, sensor.led_gradient)
        self._light = light.astype(np.float32)
        distance2 = np.sum((position - np.asarray(_HIGHLIGHT_AT)) ** 2, axis=-1)[..., None]
        spot = sensor.highlight * np.exp(-distance2 / (2 * _HIGHLIGHT_WIDTH**2))
        self._highlight = spot.astype(np.float32)
        self._gain = 1.0

    def meter(self, radiance: NDArray[np.float32]) -> None:
        """Set the exposure so that the mean of this picture is `auto_exposure_grey`."""
        sensor = self._sensor
        light = 0.9 * self._on_chip(radiance)[::_METER_STRIDE, ::_METER_STRIDE]
        for _ in range(_METER_STEPS):
            grey = 255 * np.mean(np.clip(self._gain * light, 0, 1) ** (1 / sensor.gamma))
            gain = self._gain * (sensor.auto_exposure_grey / max(grey, 1.0)) ** sensor.gamma
            self._gain = float(np.clip(gain, *_GAIN_RANGE))

    def expose(
        self,
        radiance: NDArray[np.float32],
        rng: np.random.Generator,
        depth_mm: NDArray[np.float32] | None = None,
    ) -> NDArray[np.uint8]:
        """Convert linear radiance (h, w, 3 RGB, 0..1) to the BGR image of the driver.

        depth_mm: (h, w) of the face below rest, for `contact_glow_per_mm`; None at rest.
        """
        sensor = self._sensor
        if sensor.contact_glow_per_mm and depth_mm is not None:
            glow = 1 + np.float32(sensor.contact_glow_per_mm) * np.maximum(depth_mm, 0)
            radiance = radiance * glow[..., None]
        light = self._on_chip(radiance)
        if not sensor.mosaic:
            return self._delivered(self._digitised(np.ascontiguousarray(light[..., ::-1]), rng))
        raw = light[..., 1].copy()  # BGGR mosaic
        raw[0::2, 0::2], raw[1::2, 1::2] = light[0::2, 0::2, 2], light[1::2, 1::2, 0]
        coded = self._digitised(raw, rng)
        return self._delivered(cv2.cvtColor(coded, _DEMOSAIC_CODES[sensor.demosaic]))

    def _on_chip(self, radiance: NDArray[np.float32]) -> NDArray[np.float32]:
        sensor = self._sensor
        light = cv2.GaussianBlur(radiance, (0, 0), sensor.blur_px)
        if sensor.corner_blur_px > sensor.blur_px:
            outer = cv2.GaussianBlur(radiance, (0, 0), sensor.corner_blur_px)
            light = light + (outer - light) * self._outward
        return np.asarray((light * self._light + self._highlight) * np.float32(self.brightness))

    def _digitised(self, raw: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.uint8]:
        sensor = self._sensor
        raw = raw * np.float32(0.9 * sensor.full_well_electrons * self._gain)
        spread = np.sqrt(np.maximum(raw, 0) + np.float32(sensor.read_noise_electrons**2))
        raw += spread * rng.standard_normal(raw.shape, dtype=np.float32)
        full = np.float32(sensor.full_well_electrons)
        coded = np.power(np.clip(raw / full, 0, 1), 1 / sensor.gamma)
        return np.rint(coded * 255).astype(np.uint8)

    def _delivered(self, bgr: Any) -> NDArray[np.uint8]:
        """Apply sharpening and transfer format to an image."""
        sensor = self._sensor
        if sensor.sharpening:
            soft = cv2.GaussianBlur(bgr, (0, 0), 1.0)
            bgr = cv2.addWeighted(bgr, 1 + sensor.sharpening, soft, -sensor.sharpening, 0)
        if sensor.format in _JPEG_SAMPLING:
            chosen = [cv2.IMWRITE_JPEG_QUALITY, sensor.jpeg_quality,
                      cv2.IMWRITE_JPEG_SAMPLING_FACTOR, _JPEG_SAMPLING[sensor.format]]  # fmt: skip
            bgr = cv2.imdecode(cv2.imencode(".jpg", bgr, chosen)[1], cv2.IMREAD_COLOR)
        elif sensor.format != "raw":
            luma, *chroma = cv2.split(cv2.cvtColor(bgr, cv2.COLOR_BGR2YCrCb))
            h, w = luma.shape
            few = (-(-w // 2), -(-h // 2) if sensor.format == "nv12" else h)
            chroma = [cv2.resize(c, few, interpolation=cv2.INTER_AREA) for c in chroma]
            chroma = [cv2.resize(c, (w, h), interpolation=cv2.INTER_NEAREST) for c in chroma]
            bgr = cv2.cvtColor(cv2.merge((luma, *chroma)), cv2.COLOR_YCrCb2BGR)
        return np.asarray(bgr, np.uint8)
