"""Dots in one image: where they stand out from the local light, and their centroids.

A white dot is bright in every channel, a dark one dark in every channel: min(B, G, R), or
max(B, G, R) turned over, against the local light, blurred so that single patches of a dense
pattern vanish. Connected components above a level; each centroid is weighted by the height above
that level. All of it happens in an image reduced by whole pixels until a dot is about 7 px wide.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from deltact_fab.common import Array, InputError, SensorError

Polarity = Literal["white", "dark"]

REDUCED_DOT_PX = 7.0  # a dot's diameter in the reduced image in which dots are looked for
BLUR_SIGMA = 0.17  # sigma of the blur of the whiteness, in diameters
MIN_SKIN_DOTS = 9
SEARCH_DIAMETERS_PX = (6.0, 12.0, 24.0, 48.0)  # scales at which dots are looked for
MAX_AREA_RATIO = 1.6  # areas within this factor of the median count as dots of one skin
MIN_DOT_SHARE = 0.8  # of all blobs of about that size that must be such dots
MIN_DOT_CONTRAST = 0.15  # of the local light
MAX_OPPOSITE_SHARE = 0.3  # of the dots: blobs of the other polarity that look like dots as well


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
        self.shrink = max(1, int(diameter_px / REDUCED_DOT_PX))
        self._sigma = BLUR_SIGMA * diameter_px / self.shrink
        self._light_step = max(2, round(pitch_px / 4 / self.shrink))
        self._area = np.pi / 4 * (diameter_px / self.shrink) ** 2
        self._polarity = polarity

    def reduce(self, image: Array) -> Array:
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
        label = labels.ravel()[flat].astype(np.intp)
        y, x = np.divmod(flat, w)
        weight = signal.ravel()[flat].astype(np.float64) - level
        sums = [np.bincount(label, part, len(stats))[fits] for part in (weight * x, weight * y)]
        mass = np.bincount(label, weight, len(stats))[fits]
        centre = np.stack(sums, axis=-1) / mass[:, None]
        return Blobs((centre + 0.5) * self.shrink - 0.5, area[fits].astype(float) * self.shrink**2)


@dataclass(frozen=True)
class DetectedDots:
    """position_px: (n, 2) centres, by rows from the top; diameter_px of a disc of the median area;
    pitch_px: median distance of nearest neighbours."""

    position_px: Array
    diameter_px: float
    pitch_px: float
    polarity: Polarity


def find_dots(image: Array) -> DetectedDots:
    """Dots of one size on a ground that shows little else, (h, w, 3) BGR uint8.

    Of white and dark ones those of which there are more. Raises InputError for another type of
    image, SensorError when fewer than 9 such dots are there, or the ground between them is no less
    a set of dots than they are: a chessboard.
    """
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        raise InputError(f"dots: image is {image.dtype} {image.shape}; BGR uint8 is needed")
    polarities: tuple[Polarity, ...] = ("white", "dark")
    candidates = [
        max(
            (_find_at_scale(image, polarity, size_px) for size_px in SEARCH_DIAMETERS_PX),
            key=_count_dots,
        )
        for polarity in polarities
    ]
    dots, opposite = (
        candidates if _count_dots(candidates[0]) >= _count_dots(candidates[1]) else candidates[::-1]
    )
    if dots is None:
        raise SensorError(
            f"dots: the image does not show {MIN_SKIN_DOTS} or more white or dark dots of one size, "
            "at least 4 px wide and 1.3 diameters apart: wrong pattern, out of focus, over-exposed"
        )
    if opposite is not None and _count_dots(opposite) > MAX_OPPOSITE_SHARE * _count_dots(dots):
        raise SensorError(
            f"dots: the image shows {_count_dots(dots)} {dots.polarity} dots and {_count_dots(opposite)} "
            f"{opposite.polarity} ones: a chessboard or the like; dots on a plain ground are needed"
        )
    return dots


def _count_dots(dots: DetectedDots | None) -> int:
    return 0 if dots is None else len(dots.position_px)


def _find_at_scale(image: Array, polarity: Polarity, diameter_px: float) -> DetectedDots | None:
    blobs = _strong_blobs(image, polarity, diameter_px)
    if blobs is None:
        return None
    # Once more, at the scale of what was found
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
    """Blobs above half of the contrast that the strongest hundredth of the picture has."""
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
