"""The dots of a foreign skin: how many, where, how large and of which polarity, from one image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...aliases import Array
from ...errors import InputError, SensorError
from .detect import Blobs, Detector, Polarity

MIN_DOTS = 9
DIAMETERS_PX = (6.0, 12.0, 24.0, 48.0)  # scales at which dots are looked for
SAME_SIZE = 1.6  # areas within this factor of the median count as dots of one skin
MIN_SHARE = 0.8  # of all blobs of about that size that must be such dots
MIN_CONTRAST = 0.15  # of the local light
MAX_OTHERS = 0.3  # of the dots: blobs of the other polarity that look like dots as well


@dataclass(frozen=True)
class FoundDots:
    """position_px: (n, 2) centres, by rows from the top; diameter_px of a disc of the median area;
    pitch_px: median distance of nearest neighbours."""

    position_px: Array
    diameter_px: float
    pitch_px: float
    polarity: Polarity


def find_dots(image: Array) -> FoundDots:
    """Dots of one size on a ground that shows little else, (h, w, 3) BGR uint8.

    Of white and dark ones those of which there are more. Raises InputError for another type of
    image, SensorError when fewer than 9 such dots are there, or the ground between them is no less
    a set of dots than they are: a chessboard.
    """
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        raise InputError(f"dots: image is {image.dtype} {image.shape}; BGR uint8 is needed")
    polarities: tuple[Polarity, ...] = ("white", "dark")
    most = [
        max((_at_scale(image, one, size_px) for size_px in DIAMETERS_PX), key=_count)
        for one in polarities
    ]
    found, other = most if _count(most[0]) >= _count(most[1]) else most[::-1]
    if found is None:
        raise SensorError(
            f"dots: the image does not show {MIN_DOTS} or more white or dark dots of one size, "
            "at least 4 px wide and 1.3 diameters apart: wrong pattern, out of focus, over-exposed"
        )
    if other is not None and _count(other) > MAX_OTHERS * _count(found):
        raise SensorError(
            f"dots: the image shows {_count(found)} {found.polarity} dots and {_count(other)} "
            f"{other.polarity} ones: a chessboard or the like; dots on a plain ground are needed"
        )
    return found


def _count(dots: FoundDots | None) -> int:
    return 0 if dots is None else len(dots.position_px)


def _at_scale(image: Array, polarity: Polarity, diameter_px: float) -> FoundDots | None:
    blobs = _blobs(image, polarity, diameter_px)
    if blobs is None:
        return None
    # Once more, at the scale of what was found
    first_px = float(2 * np.sqrt(np.median(blobs.area_px) / np.pi))
    if first_px < 4 or (blobs := _blobs(image, polarity, first_px)) is None:
        return None
    from scipy.spatial import cKDTree

    area = float(np.median(blobs.area_px))
    size = 2 * np.sqrt(area / np.pi)
    like = np.abs(np.log(blobs.area_px / area)) <= np.log(SAME_SIZE)
    if like.sum() < MIN_DOTS or like.mean() < MIN_SHARE or size < 4:
        return None
    centre = blobs.centre_px[like]
    near = cKDTree(centre).query(centre, 2)[0][:, 1]
    if near.min() < 1.3 * size or np.linalg.matrix_rank(centre - centre.mean(0), tol=size) < 2:
        return None
    # By rows, as far as a slanted or irregular layout has any
    order = np.lexsort((centre[:, 0], np.round(centre[:, 1] / np.median(near) * 2)))
    return FoundDots(centre[order], float(size), float(np.median(near)), polarity)


def _blobs(image: Array, polarity: Polarity, diameter_px: float) -> Blobs | None:
    """Blobs above half of the contrast that the strongest hundredth of the picture has."""
    detector = Detector(diameter_px, 2 * diameter_px, polarity)
    small = detector.reduced(image)
    if min(small.shape[:2]) < 8:
        return None
    signal = detector.signal(small)
    ground, top = float(np.median(signal)), float(np.percentile(signal, 99))
    if top - ground < MIN_CONTRAST:
        return None
    blobs = detector.blobs(signal, (ground + top) / 2)
    return blobs if len(blobs) >= MIN_DOTS else None
