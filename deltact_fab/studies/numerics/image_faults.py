"""Faults of a camera's images, by strength, for the maps of extremes."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from deltact_fab.common import Image

from . import traced

ImageFault = Callable[[Image, float], Image]


def faulty(image: Image, fault: str, strength: float) -> Image:
    """Image with one of IMAGE_FAULTS."""
    return IMAGE_FAULTS[fault][0](image, strength)


def fault_label(fault: str) -> str:
    """ImageFault with its strengths in turn."""
    return f"{fault}: {', '.join(f'{s:g}' for s in IMAGE_FAULTS[fault][1])}"


def _noise(image: Image, grey: float) -> Image:
    noise = np.random.default_rng(6).normal(0, grey, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def _hide(image: Image, share: float) -> Image:
    """A black disc over a share of the image, from the contact on."""
    h, w = image.shape[:2]
    presses = traced.TracedPresses.load()
    centre_px = traced.TRACED_VIEW.rest_px(presses.tip_mm[presses.imaged, :2])
    radius = int(np.sqrt(share * h * w / np.pi))
    x, y = np.rint(centre_px).astype(int).tolist()
    return np.asarray(cv2.circle(image.copy(), (x, y), radius, (0, 0, 0), cv2.FILLED))


def _shake(image: Image, px: float) -> Image:
    """Blur of a motion while the image is exposed."""
    return image if px <= 1 else np.asarray(cv2.blur(image, (int(px), 1)))


def _glare(image: Image, radius_px: float) -> Image:
    """A bright reflection with soft edges, in the middle."""
    h, w = image.shape[:2]
    disc = cv2.circle(np.zeros((h, w), np.float32), (w // 2, h // 2), int(radius_px), 400.0, -1)
    return np.clip(image + cv2.GaussianBlur(disc, (0, 0), 12)[..., None], 0, 255).astype(np.uint8)


IMAGE_FAULTS: dict[str, tuple[ImageFault, tuple[float, ...]]] = {
    "noise, grey levels": (_noise, (2, 5, 10, 20, 40, 80)),
    "blur, sigma in px": (
        lambda image, s: np.asarray(cv2.GaussianBlur(image, (0, 0), s)), (0.5, 1, 1.5, 2, 4, 8)
    ),
    "shaken by px": (_shake, (1, 3, 5, 9, 15, 31)),
    "light x": (
        lambda image, s: np.clip(image * s, 0, 255).astype(np.uint8), (0.05, 0.1, 0.3, 0.6, 1.5, 3),
    ),
    "glare, radius in px": (_glare, (10, 20, 40, 80, 160, 320)),
    "hidden share": (_hide, (0.01, 0.03, 0.1, 0.2, 0.4, 0.7)),
}  # fmt: skip
"""By hand: from what no tracker minds to what none follows."""
