"""Images as the flow takes them."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from ...aliases import Array
from ...errors import InputError

MIN_SIDE_PX = 64  # below it the pyramids of every method degenerate


class Sampled(NamedTuple):
    """All that the anchored tracker reads of a colour image, where the rest is not needed.

    luma (h, w) uint8: what is tracked. nodes (hh, ww, 3) BGR uint8: one pixel a node
    of the half grid, hh = ceil(h / 2).
    """

    luma: Array
    nodes: Array

    @property
    def shape(self) -> tuple[int, int, int]:
        """Of the image."""
        return (*self.luma.shape[:2], 3)

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
