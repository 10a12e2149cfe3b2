"""Images as the flow takes them."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from ...aliases import Array
from ...errors import InputError

FINE_COLOUR_SHARE = 0.35
"""Measured: .49 to .59 of an image whose chroma is whole, .13 or less where it is subsampled."""
MIN_SIDE_PX = 64  # below it the pyramids of every method degenerate


class Sampled(NamedTuple):
    """All that the anchored tracker reads of a colour image, where the rest is not needed.

    tracked (h, w) uint8: what is tracked. nodes (hh, ww, 3) BGR uint8: one pixel a node
    of the half grid, hh = ceil(h / 2).
    """

    tracked: Array
    nodes: Array

    @property
    def shape(self) -> tuple[int, int, int]:
        """Of the image."""
        return (*self.tracked.shape[:2], 3)

    @property
    def ndim(self) -> int:
        """Of the image."""
        return 3


def require_image(image: Array) -> None:
    """Raise InputError unless this is BGR (h, w, 3) or grey (h, w) of uint8."""
    if image.dtype != np.uint8 or image.ndim not in (2, 3) or image.shape[2:] not in ((), (3,)):
        raise InputError(
            f"image is {image.dtype} {image.shape}; (h, w, 3) BGR or (h, w) grey of uint8 is needed"
        )


def to_gray(image: Array) -> Array:
    """BGR (h, w, 3) or grey (h, w) uint8 to a contiguous grey (h, w) uint8 that is our own.

    Raises InputError for anything else.
    """
    require_image(image)
    if image.ndim == 3:
        return cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    # Kept across frames, while a camera may reuse its buffer.
    return np.array(image, order="C")


def has_fine_colour(image: Array) -> bool:
    """Whether green has fine detail that luma has not: BGR (h, w, 3) or grey (h, w) uint8.

    By the power of the Laplacians of green less luma, and of luma. Chroma that a camera or a codec
    has subsampled, or a demosaic smoothed, leaves green nothing of its own but errors; and a grey
    print never had it.
    """
    if image.ndim == 2:
        return False
    luma = to_gray(image).astype(np.float32)
    own = cv2.Laplacian(cv2.extractChannel(image, 1) - luma, cv2.CV_32F)
    return bool(
        np.vdot(own, own) > FINE_COLOUR_SHARE * np.sum(cv2.Laplacian(luma, cv2.CV_32F) ** 2)
    )


def tracked(image: Array, green: bool) -> Array:
    """The channel of an image that is tracked, (h, w) uint8 and our own: green, or luma.

    green: what `has_fine_colour` said of the sequence's first image.
    """
    require_image(image)
    return cv2.extractChannel(image, 1) if green and image.ndim == 3 else to_gray(image)
