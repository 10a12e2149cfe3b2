"""What the face shows that can be followed, told from one image: a dense pattern, markers, nothing.

Of a skin of markers the dense flow says what it filled in between them, and calls it trusted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from ..aliases import Array
from ..errors import SensorError
from ..measure.dots import FoundDots, find_dots
from ..measure.flow import to_gray
from ..measure.flow.confidence import FINE_PX, TEXTURED_SHARE, ConfidenceEstimator
from ..measure.flow.fused import Plane

PLAIN = 0.1
"""Detail between dots, over their contrast, up to which they are markers. Images of three real
marker skins have .012 to .050, the shipped pattern of dots .004, the dense one with dots .26."""
MARGIN = 0.85  # of a diameter about a dot's centre that is left out of what lies between


@dataclass(frozen=True)
class Pattern:
    """Of one image.

    detail_share: of the image, with detail that a dense flow can follow; a dense pattern has
    TEXTURED_SHARE of it and more. markers: dots of one size. between: detail between them over
    their contrast, None without any.
    """

    kind: Literal["dense", "markers", "nothing"]
    detail_share: float
    markers: int
    between: float | None

    @property
    def line(self) -> str:
        """For whoever expects a dense pattern; empty where there is one."""
        if self.kind == "markers":
            return f"no dense pattern: {self.markers} markers"
        if self.kind == "nothing":
            return (
                f"no pattern: {self.detail_share:.0%} of the first image has detail to follow, "
                f"{TEXTURED_SHARE:.0%} are needed: nothing is trusted"
            )
        return ""


def recognise(image: Array) -> Pattern:
    """Of an image (h, w, 3) BGR uint8 of the face at rest. Raises InputError as the flow does."""
    share = ConfidenceEstimator(image, Plane.of(image)).textured_share
    dense: Literal["dense", "nothing"] = "dense" if share >= TEXTURED_SHARE else "nothing"
    try:
        dots = find_dots(image)
    except SensorError:
        return Pattern(dense, share, 0, None)
    between = _between(to_gray(image).astype(np.float32), dots)
    return Pattern("markers" if between <= PLAIN else dense, share, len(dots.position_px), between)


def _between(grey: Array, dots: FoundDots) -> float:
    """Robust deviation of the ground from its means, over the dots' contrast to it."""
    ground = np.ones(grey.shape, np.float32)
    at = np.round(dots.position_px).astype(int)
    for x, y in at.tolist():
        cv2.circle(ground, (x, y), int(np.ceil(MARGIN * dots.diameter_px)), (0,), -1)

    def mean(side_px: int) -> Array:
        seen, weight = (cv2.blur(one, (side_px, side_px)) for one in (grey * ground, ground))
        return np.asarray(seen / np.maximum(weight, np.float32(1e-3)))

    free = ground > 0
    if not free.any():
        return np.inf
    detail = 1.4826 * float(np.median(np.abs(grey - mean(FINE_PX))[free]))
    off = np.abs(grey - mean(2 * int(np.ceil(dots.diameter_px)) + 1))[at[:, 1], at[:, 0]]
    return detail / max(float(np.median(off)), 1.0)
