"""Dots in one image: where they stand out from the local light, and their centroids.

A white dot is bright in every channel, a dark one dark in every channel: min(B, G, R), or
max(B, G, R) turned over, against the local light, blurred so that single patches of a dense
pattern vanish. Connected components above a level; each centroid is weighted by the height above
that level, so that a pixel at the contour weighs nothing and none flips in or out.

All of it happens in an image reduced by whole pixels until a dot is about 7 px wide: means of
whole pixels keep a centroid, and the work falls with the square.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from ...aliases import Array

Polarity = Literal["white", "dark"]

WORK_PX = 7.0  # a dot's diameter in the reduced image in which dots are looked for
BLUR = 0.17  # sigma of the blur of the whiteness, in diameters


@dataclass(frozen=True)
class Blobs:
    """centre_px: (m, 2) float64 in the full image; area_px: (m,) in its pixels."""

    centre_px: Array
    area_px: Array

    def __len__(self) -> int:
        return len(self.area_px)


class Detector:
    """Finds dots of one polarity, of about `diameter_px` and at least `pitch_px` apart."""

    def __init__(self, diameter_px: float, pitch_px: float, polarity: Polarity) -> None:
        self.shrink = max(1, int(diameter_px / WORK_PX))
        self._sigma = BLUR * diameter_px / self.shrink
        self._light_step = max(2, round(pitch_px / 4 / self.shrink))
        self._area = np.pi / 4 * (diameter_px / self.shrink) ** 2
        self._polarity = polarity

    def reduced(self, image: Array) -> Array:
        """(h // shrink, w // shrink, 3) uint8, the means of whole squares of pixels."""
        s = self.shrink
        if s == 1:
            return image
        h, w = image.shape[0] // s, image.shape[1] // s
        return cv2.resize(image[: h * s, : w * s], (w, h), interpolation=cv2.INTER_AREA)

    def to_small(self, points_px: Array) -> Array:
        """Places in the full image as places in the reduced one."""
        return (points_px + 0.5) / self.shrink - 0.5

    def signal(self, small: Array) -> Array:
        """(h, w) float32 of the reduced image, high on dots, free of smooth shading."""
        b, g, r = cv2.split(small)
        extreme = cv2.min if self._polarity == "white" else cv2.max
        ink = extreme(extreme(b, g), r)
        h, w = ink.shape
        size = (max(8, w // self._light_step), max(8, h // self._light_step))
        coarse = cv2.resize(small, size, interpolation=cv2.INTER_AREA)
        light = cv2.GaussianBlur(coarse.astype(np.float32).mean(axis=2), (0, 0), 5.0)
        light = np.maximum(light, 0.15 * float(np.median(light)) + 1.0)
        light = cv2.resize(light, (w, h), interpolation=cv2.INTER_LINEAR)
        blurred = cv2.GaussianBlur(ink.astype(np.float32), (0, 0), self._sigma)
        ratio = np.divide(blurred, light)
        return ratio if self._polarity == "white" else np.negative(ratio)

    def blobs(self, signal: Array, level: float) -> Blobs:
        """Blobs above the level, wholly inside the image and not far from a dot's size."""
        h, w = signal.shape
        _, labels, stats, _ = cv2.connectedComponentsWithStats(
            (signal > level).astype(np.uint8), connectivity=4, ltype=cv2.CV_32S
        )
        left, top, width, height, area = stats.T
        fits = (
            (area >= 0.08 * self._area)
            & (area <= 4.0 * self._area)
            & (left > 0)
            & (top > 0)
            & (left + width < w)
            & (top + height < h)
        )
        fits[0] = False
        flat = np.flatnonzero(fits[labels])
        label = labels.ravel()[flat]
        y, x = np.divmod(flat, w)
        weight = signal.ravel()[flat].astype(np.float64) - level
        sums = [np.bincount(label, part, len(stats))[fits] for part in (weight * x, weight * y)]
        mass = np.bincount(label, weight, len(stats))[fits]
        centre = np.stack(sums, axis=-1) / mass[:, None]
        return Blobs((centre + 0.5) * self.shrink - 0.5, area[fits].astype(float) * self.shrink**2)
