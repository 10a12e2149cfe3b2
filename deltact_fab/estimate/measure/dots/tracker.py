"""Tracker of a skin's dots over images: sub-pixel centroids with identities."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from deltact_fab.common import Array, InputError, SensorError

from .detect import Detector, Polarity, find_dots
from .identity import GATE_PITCHES, MAX_AREA_FACTOR, Identities, Rings
from .skin import Skin, mutual_nearest

# By hand, in this block: looser limits register a wrong or shifted pattern, stricter refuse one.
MAX_OFFSET_PX = 8.0
CONTOUR_LEVEL = 0.5  # of the contour, between background (0) and dots (1)
MIN_REGISTERED_SHARE = 0.5  # of the expected dots, in the first image
RING_RADII = (0.75, 1.5)  # inner and outer radius of the ring of colours, in diameters
MIN_RING_TEXTURE = 2.0  # standard deviation, grey levels; below, the neighbours alone identify


@dataclass(frozen=True)
class DotObservation:
    """The dots of one frame; every array is in the order of the rest positions.

    position_px: (n, 2) float64, NaN where lost. displacement_px: (n, 2), position - first position.
    located: (n,) bool. identity_ncc: (n,) correlation of the ring of colours with the first image,
    NaN where lost or where the pattern has no colours. cpu_ms: process time of the update.
    """

    position_px: Array
    displacement_px: Array
    located: Array
    identity_ncc: Array
    cpu_ms: float


class DotTracker:
    """Tracker of dots from their first image on: white ones on colours, or dark ones on light.

    rest_px: (n, 2) expected positions (x, y) in the first image, accurate to MAX_OFFSET_PX after
    a common shift of as much; n >= 4 dots, not on a line. Without colours around the dots they are
    identified by their neighbours: dots that are all gone for more than `identity.MAX_LOST_FRAMES`
    frames stay lost, and a regular grid must not move by half a pitch between two frames. Raises
    InputError for anything else.
    """

    def __init__(self, rest_px: Array, diameter_px: float, *, polarity: Polarity = "white") -> None:
        rest = np.asarray(rest_px, dtype=np.float64)
        if rest.ndim != 2 or rest.shape[1] != 2 or len(rest) < 4 or not np.isfinite(rest).all():
            raise InputError(
                f"dots: rest_px is {rest.shape}; (n, 2) finite positions of n >= 4 dots are needed"
            )
        if not (np.isfinite(diameter_px) and diameter_px >= 4):
            raise InputError(
                f"dots: diameter_px is {diameter_px}; at least 4 px are needed for a centroid"
            )
        if np.linalg.matrix_rank(rest - rest.mean(0), tol=diameter_px) < 2:
            raise InputError("dots: all rest positions lie on one line")
        self.rest_px = rest
        self.diameter_px = float(diameter_px)
        self.polarity = polarity
        self._skin = Skin(rest)
        self.pitch_px = self._skin.pitch_px
        if self.pitch_px < 1.3 * diameter_px:
            raise InputError(
                f"dots: two rest positions are {self.pitch_px:.1f} px apart; "
                f"dots of {diameter_px:.1f} px need at least 1.3 diameters"
            )
        self.offset_px = min(MAX_OFFSET_PX, GATE_PITCHES * self.pitch_px)
        self._detector = Detector(self.diameter_px, self.pitch_px, polarity)
        self._shape: tuple[int, ...] | None = None
        self._level = 0.0
        self._rings: Rings | None = None
        self._identities: Identities | None = None

    @classmethod
    def from_image(cls, image: Array) -> DotTracker:
        """Create a tracker of the dots in an image of an unknown skin; `update` with it next.

        Raises as `find_dots` does.
        """
        dots = find_dots(image)
        return cls(dots.position_px, dots.diameter_px, polarity=dots.polarity)

    @property
    def first_px(self) -> Array:
        """Positions (n, 2) in the first image, NaN for dots missing there."""
        if self._identities is None:
            return np.full_like(self.rest_px, np.nan)
        return self._identities.first_px.copy()

    def update(self, image: Array) -> DotObservation:
        """Find the dots in one more image, (h, w, 3) BGR uint8 of the first image's size.

        Raises InputError for another type or size, SensorError when the first image does not show
        at least MIN_REGISTERED_SHARE of the dots.
        """
        start_s = time.process_time()
        if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
            raise InputError(f"dots: image is {image.dtype} {image.shape}; BGR uint8 is needed")
        if self._shape is not None and image.shape != self._shape:
            raise InputError(f"dots: the image is {image.shape}, the first one was {self._shape}")
        small = self._detector.reduce(image)
        signal = self._detector.signal(small)
        if self._identities is None:
            position = self._register(image.shape, small, signal)
            likeness = 1.0 if self._rings is not None else np.nan
            ncc = np.where(np.isfinite(position[:, 0]), likeness, np.nan)
        else:
            blobs = self._detector.blobs(signal, self._level)
            colours = None if self._rings is None else self._rings.smooth(small)
            position, ncc = self._identities.follow(blobs, colours)
        located = np.isfinite(position[:, 0])
        ncc[~located] = np.nan
        cpu_ms = (time.process_time() - start_s) * 1e3
        return DotObservation(position, position - self.first_px, located, ncc, cpu_ms)

    def _register(self, shape: tuple[int, ...], small: Array, signal: Array) -> Array:
        """Register the dots in the first image: level, positions, areas and colours."""
        rest, (h, w) = self.rest_px, shape[:2]
        in_image = (rest >= 0).all(1) & (rest[:, 0] <= w - 1) & (rest[:, 1] <= h - 1)
        if not in_image.any():
            raise InputError(f"dots: no expected position lies in the image of {w} x {h} px")
        reach = int(np.ceil(self.offset_px / self._detector.shrink))
        peaks = [
            signal[max(0, y - reach) : y + reach + 1, max(0, x - reach) : x + reach + 1].max()
            for x, y in np.round(self._detector.to_small(rest[in_image])).astype(int)
        ]
        ground = float(np.median(signal))
        level = ground + CONTOUR_LEVEL * (float(np.median(peaks)) - ground)
        blobs = self._detector.blobs(signal, level)
        nominal = np.pi / 4 * self.diameter_px**2
        fits = np.abs(np.log(blobs.area_px / nominal)) < np.log(MAX_AREA_FACTOR)
        position, area = np.full_like(rest, np.nan), np.full(len(rest), nominal)
        shift = np.zeros(2)
        # A common offset first, then each dot within the same tolerance of it.
        for _ in range(2):
            dot, blob = mutual_nearest(rest + shift, blobs.centre_px, self.offset_px)
            dot, blob = dot[fits[blob]], blob[fits[blob]]
            position[:] = np.nan
            position[dot] = blobs.centre_px[blob]
            # Later areas are compared with this one: a patch that touches a dot belongs to it.
            area[dot] = blobs.area_px[blob]
            if len(dot):
                shift = np.median(position[dot] - rest[dot], axis=0)
        need = int(np.ceil(max(4, MIN_REGISTERED_SHARE * len(rest))))
        if len(dot) < need:
            raise SensorError(
                f"dots: {len(dot)} of {len(rest)} {self.polarity} dots found in the first image; "
                f"at least {need} are needed: wrong pattern, out of focus, over-exposed, or "
                f"shifted by more than {self.offset_px:.0f} px"
            )
        self._shape, self._level = shape, level
        shrink = self._detector.shrink
        inner, outer = (r * self.diameter_px / shrink for r in RING_RADII)
        # The ring must end before the next dot, also when the pitch is small.
        outer = min(outer, (self.pitch_px - 0.6 * self.diameter_px) / shrink)
        rings = Rings(inner, outer, shrink)
        coloured = rings.remember(rings.smooth(small), position, MIN_RING_TEXTURE)
        self._rings = rings if coloured else None
        self._identities = Identities(self._skin, position.copy(), area, self._rings)
        return position
