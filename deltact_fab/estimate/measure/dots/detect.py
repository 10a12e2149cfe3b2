"""Dot detection in one image: contrast with the local light, and centroids.

A white dot is bright in every channel, a dark one dark in every channel: min(B, G, R), or inverted
max(B, G, R), relative to the local light, blurred so that single patches of a dense pattern vanish.
Dots are connected components above a level; each centroid is weighted by the height above it. The
image is first reduced by an integer factor until a dot is about 7 px wide.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from deltact_fab.common import Array, InputError, SensorError

Polarity = Literal["white", "dark"]

# By hand, on two runs of docs/evidence/dots.md: stricter refuses worn skins, looser takes textures.
REDUCED_DOT_PX = 7.0  # a dot's diameter in the reduced image
BLUR_SIGMA = 0.17  # sigma of the blur, in diameters
MIN_SKIN_DOTS = 9
SEARCH_DIAMETERS_PX = (6.0, 12.0, 24.0, 48.0)  # scales of the search in an unknown image
MAX_AREA_RATIO = 1.6  # to the median, for dots of one skin
MIN_DOT_SHARE = 0.8  # of all blobs of about that size
MIN_DOT_CONTRAST = 0.15  # of the local light
MAX_OPPOSITE_SHARE = 0.3  # dots of the other polarity, over the dots


@dataclass(frozen=True)
class Blobs:
    """Blobs of an image. centre_px: (m, 2) float64 in the full image; area_px: (m,)."""

    centre_px: Array
    area_px: Array

    def __len__(self) -> int:
        return len(self.area_px)


class Detector:
    """Detector of dots of one polarity, of about `diameter_px` and at least `pitch_px` apart."""

    def __init__(self, diameter_px: float, pitch_px: float, polarity: Polarity) -> None:
        self.shrink = max(1, int(diameter_px / REDUCED_DOT_PX))
        self._sigma = BLUR_SIGMA * diameter_px / self.shrink
        self._light_step = max(2, round(pitch_px / 4 / self.shrink))
        self._area = np.pi / 4 * (diameter_px / self.shrink) ** 2
        self._polarity = polarity

    def reduce(self, image: Array) -> Array:
        """Reduce an image by block means to (h // shrink, w // shrink, 3) uint8."""
        s = self.shrink
        if s == 1:
            return image
        h, w = image.shape[0] // s, image.shape[1] // s
        return cv2.resize(image[: h * s, : w * s], (w, h), interpolation=cv2.INTER_AREA)

    def to_small(self, points_px: Array) -> Array:
        """Convert positions in the full image to the reduced one."""
        return (points_px + 0.5) / self.shrink - 0.5

    def signal(self, small: Array) -> Array:
        """Signal (h, w) float32 of the reduced image, high on dots, free of smooth shading."""
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
        """Return blobs above the level, fully inside the image and of about a dot's size."""
        h, w = signal.shape
        _, labels, stats, _ = cv2.connectedComponentsWithStats(
            (signal > level).astype(np.uint8), connectivity=4, ltype=cv2.CV_32S
        )
        x0, y0, width, height, area = stats.T
        fits = (
            (area >= 0.08 * self._area)
            & (area <= 4.0 * self._area)
            & (x0 > 0)
            & (y0 > 0)
            & (x0 + width < w)
            & (y0 + height < h)
        )
        fits[0] = False
        flat = np.flatnonzero(fits[labels])
        label = labels.ravel()[flat].astype(np.intp)
        y, x = np.divmod(flat, w)
        weight = signal.ravel()[flat].astype(np.float64) - level
        sums = [np.bincount(label, part, len(stats))[fits] for part in (weight * x, weight * y)]
        mass = np.bincount(label, weight, len(stats))[fits]
        centre = np.stack(sums, axis=-1) / mass[:, None]
        return Blobs((centre + 0.5) * self.shrink - 0.5, area[fits].astype(float) * self.shrink**2)


@dataclass(frozen=True)
class DetectedDots:
    """Dots of an image. position_px: (n, 2) centres, by rows from the top; diameter_px: of a disc
    of the median area; pitch_px: median distance of nearest neighbours."""

    position_px: Array
    diameter_px: float
    pitch_px: float
    polarity: Polarity


def find_dots(image: Array) -> DetectedDots:
    """Find dots of one size on a plain ground, in an image (h, w, 3) BGR uint8.

    Returns white or dark ones, whichever are more. Raises InputError for another type of image,
    SensorError for fewer than 9 dots, or if the ground looks like dots too, as on a chessboard.
    """
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        raise InputError(f"dots: image is {image.dtype} {image.shape}; BGR uint8 is needed")
    polarities: tuple[Polarity, ...] = ("white", "dark")
    best = [
        max((_find_at_scale(image, p, size_px) for size_px in SEARCH_DIAMETERS_PX), key=_count)
        for p in polarities
    ]
    dots, opposite = best if _count(best[0]) >= _count(best[1]) else best[::-1]
    if dots is None:
        raise SensorError(
            f"dots: the image shows fewer than {MIN_SKIN_DOTS} white or dark dots of one size, at "
            "least 4 px wide and 1.3 diameters apart: wrong pattern, out of focus, over-exposed"
        )
    if opposite is not None and _count(opposite) > MAX_OPPOSITE_SHARE * _count(dots):
        raise SensorError(
            f"dots: the image shows {_count(dots)} {dots.polarity} dots and {_count(opposite)} "
            f"{opposite.polarity} ones: a chessboard or the like; dots on a plain ground are needed"
        )
    return dots


def _count(dots: DetectedDots | None) -> int:
    return 0 if dots is None else len(dots.position_px)


def _find_at_scale(image: Array, polarity: Polarity, diameter_px: float) -> DetectedDots | None:
    blobs = _strong_blobs(image, polarity, diameter_px)
    if blobs is None:
        return None
    # Again, at the scale of the blobs
    first_px = float(2 * np.sqrt(np.median(blobs.area_px) / np.pi))
    if first_px < 4 or (blobs := _strong_blobs(image, polarity, first_px)) is None:
        return None
    from scipy.spatial import cKDTree

    area = float(np.median(blobs.area_px))
    size = 2 * np.sqrt(area / np.pi)
    like = np.abs(np.log(blobs.area_px / area)) <= np.log(MAX_AREA_RATIO)
    if like.sum() < MIN_SKIN_DOTS or like.mean() < MIN_DOT_SHARE or size < 4:
        return None
    centre = blobs.centre_px[like]
    near = cKDTree(centre).query(centre, 2)[0][:, 1]
    if near.min() < 1.3 * size or np.linalg.matrix_rank(centre - centre.mean(0), tol=size) < 2:
        return None
    # By rows, as far as a slanted or irregular layout has any
    order = np.lexsort((centre[:, 0], np.round(centre[:, 1] / np.median(near) * 2)))
    return DetectedDots(centre[order], float(size), float(np.median(near)), polarity)


def _strong_blobs(image: Array, polarity: Polarity, diameter_px: float) -> Blobs | None:
    """Return blobs above half the contrast of the brightest hundredth of the signal."""
    detector = Detector(diameter_px, 2 * diameter_px, polarity)
    small = detector.reduce(image)
    if min(small.shape[:2]) < 8:
        return None
    signal = detector.signal(small)
    ground, top = float(np.median(signal)), float(np.percentile(signal, 99))
    if top - ground < MIN_DOT_CONTRAST:
        return None
    blobs = detector.blobs(signal, (ground + top) / 2)
    return blobs if len(blobs) >= MIN_SKIN_DOTS else None
