"""What a face shows that can be followed, told from one image: a dense pattern, markers, nothing.

Of a skin of markers the dense flow says what it filled in between them, and calls it trusted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from ..aliases import Array
from ..errors import SensorError
from .dots import FoundDots, find_dots
from .flow import FlowTracker, to_gray
from .flow.confidence import FINE_PX, TEXTURED_SHARE

PLAIN = 0.1
"""Detail between dots, over their contrast, up to which they are markers. Images of three real
marker skins have .012 to .050, the shipped pattern of dots .004, the dense one with dots .26."""


@dataclass(frozen=True)
class SeenPattern:
    """Of one image. markers: dots of one size. between: detail between them over their contrast,
    infinite without any. lacks: what a reader who expects a dense pattern must know; empty where
    there is one."""

    kind: Literal["dense", "markers", "nothing"]
    markers: int
    between: float
    lacks: str = ""


def recognise(image: Array) -> SeenPattern:
    """Of an image (h, w, 3) BGR uint8 of the face at rest. Raises InputError as the flow does.

    Whether there is a dense pattern is the tracker's word; markers are told from it here.
    """
    try:
        said = FlowTracker(full=False).update(image).diagnostics
        share, trusted = said.textured_share, said.trusted
    except SensorError:
        share, trusted = 0.0, False
    try:
        dots = find_dots(image)
        count, between = len(dots.position_px), _between(to_gray(image).astype(np.float32), dots)
    except SensorError:
        count, between = 0, np.inf
    if between <= PLAIN:
        return SeenPattern("markers", count, between, f"no dense pattern: {count} markers")
    if trusted:
        return SeenPattern("dense", count, between)
    return SeenPattern(
        "nothing",
        count,
        between,
        f"no pattern: {share:.0%} of the first image has detail to follow, {TEXTURED_SHARE:.0%} "
        "are needed: nothing is trusted",
    )


def _between(grey: Array, dots: FoundDots) -> float:
    """Robust deviation of the ground from its means, over the dots' contrast to it."""
    ground, at = np.ones(grey.shape, np.float32), np.round(dots.position_px).astype(int)
    for x, y in at.tolist():
        cv2.circle(ground, (x, y), int(np.ceil(0.85 * dots.diameter_px)), (0,), -1)

    def off(side_px: int) -> Array:
        seen, weight = (cv2.blur(one, (side_px, side_px)) for one in (grey * ground, ground))
        return np.asarray(np.abs(grey - seen / np.maximum(weight, np.float32(1e-3))))

    detail = off(FINE_PX)[ground > 0]
    contrast = float(np.median(off(2 * int(np.ceil(dots.diameter_px)) + 1)[at[:, 1], at[:, 0]]))
    return 1.4826 * float(np.median(detail)) / max(contrast, 1.0) if len(detail) else np.inf
