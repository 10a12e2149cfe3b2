"""From colour values to a camera's bytes: printer spread, lens blur, shading, Bayer mosaic, noise.

Pattern quality and the virtual camera share it. Everything here is a model: 4-level halftone,
15 um of misregistration, 20 um of ink spread, 0.6 px of blur are assumed values of an office laser
printer and a small fisheye camera, not measured ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from .aliases import Float
from .units import MM_PER_INCH

GAMMA = 2.2


@dataclass(frozen=True)
class Printer:
    """dpi, levels per ink and dot, a shift per ink (standard deviation), a Gaussian spread."""

    dpi: int = 1200
    levels: int = 4
    misregistration_um: float = 15.0
    spread_um: float = 20.0

    @property
    def mm_per_dot(self) -> float:
        """Pitch of the printer's dots."""
        return MM_PER_INCH / self.dpi

    def print_(self, values: Float, rng: np.random.Generator) -> Float:
        """Print colour values (h, w, 3 in 0..1, one per printer dot); returns linear reflectance.

        Ordered dither with a random threshold per dot and ink, then misregistration and spread.
        """
        steps = self.levels - 1
        scaled = values.astype(np.float32) * steps
        low = np.floor(scaled)
        threshold = rng.random(values.shape, dtype=np.float32)
        coded = np.minimum(low + (scaled - low > threshold), steps) / np.float32(steps)
        reflectance = np.power(coded, np.float32(GAMMA))
        shifts = rng.normal(0.0, self.misregistration_um / 1000 / self.mm_per_dot, (3, 2))
        sigma = max(self.spread_um / 1000 / self.mm_per_dot / 2, 1e-3)
        inks = []
        for c in range(3):
            move = np.array([[1, 0, shifts[c, 0]], [0, 1, shifts[c, 1]]])
            ink = cv2.warpAffine(
                np.ascontiguousarray(reflectance[..., c]),
                move,
                reflectance.shape[1::-1],
                flags=cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_REPLICATE,
            )
            inks.append(cv2.GaussianBlur(ink, (0, 0), sigma))
        return np.stack(inks, axis=-1)


@dataclass(frozen=True)
class ImageSensor:
    """A colour camera: lens blur (px), shading at the corner, full well and read noise.

    mosaic: one colour a pixel behind a Bayer filter; False is three chips, every colour everywhere.
    """

    blur_px: float = 0.6
    shading: float = 0.35
    full_well_electrons: float = 8000.0
    read_noise_electrons: float = 6.0
    mosaic: bool = True

    def shade(self, height: int, width: int) -> Float:
        """Falloff of light, 1 on the axis to 1 - shading in the corner, quadratic, (h, w, 1)."""
        y = (np.arange(height) - (height - 1) / 2)[:, None]
        x = (np.arange(width) - (width - 1) / 2)[None, :]
        r2 = (x * x + y * y) / ((height / 2) ** 2 + (width / 2) ** 2)
        return (1 - self.shading * r2).astype(np.float32)[..., None]

    def expose(self, radiance: Float, shade: Float, rng: np.random.Generator) -> NDArray[np.uint8]:
        """Linear radiance (h, w, 3 RGB, 0..1) to a BGR image through mosaic, noise and gamma."""
        light = cv2.GaussianBlur(radiance, (0, 0), self.blur_px) * shade
        if not self.mosaic:
            return self._digitise(np.ascontiguousarray(light[..., ::-1]), rng)
        raw = np.empty(light.shape[:2], np.float32)  # BGGR mosaic
        raw[0::2, 0::2] = light[0::2, 0::2, 2]
        raw[0::2, 1::2] = light[0::2, 1::2, 1]
        raw[1::2, 0::2] = light[1::2, 0::2, 1]
        raw[1::2, 1::2] = light[1::2, 1::2, 0]
        mosaic = self._digitise(raw, rng)
        return np.asarray(cv2.cvtColor(mosaic, cv2.COLOR_BayerRG2BGR_EA), np.uint8)

    def _digitise(self, raw: Float, rng: np.random.Generator) -> NDArray[np.uint8]:
        raw = raw * np.float32(0.9 * self.full_well_electrons)
        spread = np.sqrt(np.maximum(raw, 0) + np.float32(self.read_noise_electrons**2))
        raw += spread * rng.standard_normal(raw.shape, dtype=np.float32)
        coded = np.power(np.clip(raw / np.float32(self.full_well_electrons), 0, 1), 1 / GAMMA)
        return np.rint(coded * 255).astype(np.uint8)
