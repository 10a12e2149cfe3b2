"""Images that a tracker must not believe, and images that it should still read.

Each is the last frame of a motion of 12 px, spoilt: as the first frame after the reference and
after three whole ones, on two patterns with seeds other than those that set the thresholds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from ...aliases import Image
from ...measure.flow import FlowTracker
from ..engine import Flagged
from .flow_frames import FlowSequence, scene

WRONG_PX = 1.0
OTHER_SEEDS = {"near": "other seed", "near, fine": "other seed, fine"}
NEAR = tuple(OTHER_SEEDS)
LONG = ("far", "far, fine")
BLOCK_PX = 32
CORNER = (4, 3)  # blocks in its two rows: 7 of the 432 of an image


class TrackedPixels(NamedTuple):
    """What a tracker says of the last frame.

    confident: share of the visible pixels. wrong: share of the confident ones off by over 1 px.
    """

    confident: float
    trusted: bool
    wrong: float


def judged(tracker: Any, frames: Sequence[Image], truth: FlowSequence) -> TrackedPixels:
    """Follow frames, the first at rest, to the last, which has all of the motion of `truth`."""
    for image in frames[:-1]:
        tracker.update(image)
    seen = tracker.update(frames[-1])
    judged = seen.confident & seen.visible & truth.seen()
    off = truth.error_px(seen.flow_px)[judged] > WRONG_PX
    return TrackedPixels(
        seen.diagnostics.confident_share,
        seen.diagnostics.trusted,
        float(off.mean()) if off.size else 0.0,
    )


# -- what is done to an image ----------------------------------------------------------------------


def _light(gain: Any, image: Image) -> Image:
    return np.clip(image * gain, 0, 255).astype(np.uint8)


def _plain(image: Image, level: int, noise: float = 2.0) -> Image:
    rng = np.random.default_rng(5)
    return np.clip(rng.normal(level, noise, image.shape), 0, 255).astype(np.uint8)


def _noisy(sigma: float, image: Image) -> Image:
    noise = np.random.default_rng(6).normal(0, sigma, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def _half(image: Image, other: Image) -> Image:
    out = image.copy()
    out[:, image.shape[1] // 2 :] = other[:, image.shape[1] // 2 :]
    return out


def _specular(image: Image) -> Image:
    h, w = image.shape[:2]
    glare = cv2.circle(np.zeros((h, w), np.float32), (w // 2, h // 2), 80, 400.0, cv2.FILLED)
    return np.clip(image + cv2.GaussianBlur(glare, (0, 0), 12)[..., None], 0, 255).astype(np.uint8)


def _gradient(image: Image) -> Image:
    return _light(np.linspace(0.6, 1.4, image.shape[1])[None, :, None], image)


def _corner(image: Image) -> Image:
    out = _plain(image, 120)
    for row, blocks in enumerate(CORNER):
        part = slice(row * BLOCK_PX, (row + 1) * BLOCK_PX), slice(blocks * BLOCK_PX)
        out[part] = image[part]
    return out


def _random(image: Image) -> Image:
    return np.random.default_rng(3).integers(0, 256, image.shape, np.uint8)


UNRELATED: dict[str, Callable[[Image], Image]] = {
    "noise": _random,
    "flat": lambda image: _plain(image, 90),
    "black": np.zeros_like,
    "saturated": lambda image: np.full_like(image, 255),
    "negative": np.invert,
    "mirrored": lambda image: np.ascontiguousarray(image[:, ::-1]),
    "upside down": lambda image: np.ascontiguousarray(image[::-1, ::-1]),
}
SPOILT: dict[str, Callable[[Image], Image]] = {
    "whole": np.copy,
    "half covered": lambda image: _half(image, _plain(image, 90)),
    "a specular disc": _specular,
    "noise of 16 grey levels": partial(_noisy, 16),
    "noise of 40 grey levels": partial(_noisy, 40),
    "blur of 9 px": lambda image: np.asarray(cv2.blur(image, (9, 1))),
    "blur of 21 px": lambda image: np.asarray(cv2.blur(image, (21, 1))),
    "light x 0.6": partial(_light, 0.6),
    "light x 1.4": partial(_light, 1.4),
    "a gradient of light": _gradient,
}
OTHER_SEED, HALF_OTHER, ONE_CORNER = "other seed", "half another pattern", "one textured corner"
# Of a frame that is trusted: share of the confident pixels that may be off by more than 1 px.
WRONG = 0.005
# The same of a long motion in several frames, where the goal is none at all. On the coarse pattern
# some pixels where the motion squeezes areas to half are off by up to 1.5 px (decision 0016).
LONG_WRONG = {"far": 0.0015}
# Share of the view that may be without confidence in what should still be read.
BLIND = {"whole": 0.15, "blur of 9 px": 0.5, "light x 0.6": 0.2, "light x 1.4": 0.2}


def spoilt(what: str, image: Image) -> Image:
    """An image of its own that needs no other one."""
    return _corner(image) if what == ONE_CORNER else {**UNRELATED, **SPOILT}[what](image)


# -- the cases -------------------------------------------------------------------------------------


@cache
def seen(what: str, names: tuple[str, ...], scratch: Path) -> dict[str, TrackedPixels]:
    """What the default tracker says of one image in scenes by name, by place in the sequence."""
    out = {}
    for name in names:
        given = scene(scratch, name)
        frames = [spoilt(ONE_CORNER, image) if what == ONE_CORNER else image
                  for image in given.images]  # fmt: skip
        other = OTHER_SEEDS.get(name, "")
        if what == OTHER_SEED:
            frames[-1] = scene(scratch, other).last
        elif what == HALF_OTHER:
            frames[-1] = _half(given.last, scene(scratch, other).last)
        elif what != ONE_CORNER:
            frames[-1] = spoilt(what, given.last)
        places = {"first": [frames[0], frames[-1]], "after a sequence": frames}
        for place in places if len(frames) > 2 else ("first",):
            out[f"{name}: {place}"] = judged(FlowTracker(), places[place], given)
    return out


def never_trusted(what: str, names: tuple[str, ...], scratch: Path) -> float:
    """Greatest confident share. Raises Flagged where no frame is trusted."""
    found = seen(what, names, scratch)
    trusted = [place for place, s in found.items() if s.trusted]
    most = max(s.confident for s in found.values())
    if not trusted:
        raise Flagged(f"flagged: not trusted, {100 * most:.2g} % confident at most")
    return most


def most_confident(what: str, names: tuple[str, ...], scratch: Path) -> tuple[float, str]:
    """Greatest confident share, and where."""
    place, s = max(seen(what, names, scratch).items(), key=lambda item: item[1].confident)
    return s.confident, place


def most_wrong(what: str, names: tuple[str, ...], scratch: Path) -> tuple[float, str]:
    """Greatest share of the confident pixels of a trusted frame that are off by more than 1 px.

    Raises Flagged where no frame is trusted.
    """
    found = seen(what, names, scratch)
    cover = [100 * s.confident for s in found.values()]
    trusted = {place: s for place, s in found.items() if s.trusted}
    told = f"{min(cover):.3g} to {max(cover):.3g} % confident"
    if not trusted:
        raise Flagged(f"flagged: not trusted, {told}")
    place, s = max(trusted.items(), key=lambda item: item[1].wrong)
    return s.wrong, f"{place}; {told}, trusted {len(trusted)} of {len(found)}"


def least_blind(what: str, names: tuple[str, ...], scratch: Path) -> tuple[float, str]:
    """Greatest share of the view that is not confident, and where."""
    place, s = min(seen(what, names, scratch).items(), key=lambda item: item[1].confident)
    return 1 - s.confident, place


def long_motion(name: str, frames: int, scratch: Path) -> TrackedPixels:
    """What the default tracker says of 121 px in that many frames."""
    given = scene(scratch, name).every(10 // frames)
    return judged(FlowTracker(), list(given.images), given)
