"""What is known of one frame, and which parts of its flow are kept and trusted: one rule for all.

All arrays of the rule lie on the half grid of `fused`, (hh, ww): a node stands for 2 x 2 pixels;
flows are in pixels of the image. Every flow is judged against the *first* image, whatever it was
composed over.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import cv2
import numpy as np

from deltact_fab.common import Array

from ..compose import landing_px, sample, shrink
from .fused import Plane, RefinedFlow, SampledImage

_EDGE = cv2.BORDER_REPLICATE
_COARSE_PX = 4  # windows are counted in cells of two nodes each way
_MIN_VARIANCE = 1.0  # grey levels^2: less than a camera's noise
KEEP_CORRELATION = 0.35
KEEP_DET = 0.12
CHROMA_MIN = 0.5
COLOUR_SHARE = 0.45
"""Share of the luma deviation: a Bayer mosaic gives grey up to 0.38, colours 0.61 and more."""
GREY_MIN = 0.7
DEVIATION_MAX_PX = 0.29
BORDER_PX = 3.0
WINDOW_PX, FIT_PX, SUPPORT_PX = 20, 28, 68
_WINDOW, _FIT, _SUPPORT = ((px // _COARSE_PX,) * 2 for px in (WINDOW_PX, FIT_PX, SUPPORT_PX))
SUPPORT_SHARE = 0.5
TEXTURE_MIN = 2.0
"""Grey levels: rounding, noise and compression leave up to 1.9 in a picture of a plain face."""
FINE_PX = 19
TEXTURED_SHARE = 0.5
TRUSTED_SHARE = 0.25


class FlowState(IntEnum):
    LOST = 0
    """Hidden or out of view, and no trustworthy neighbour near: a guess."""
    PREDICTED = 1
    """Not found in this image; filled from trustworthy neighbours."""
    MATCHED = 2
    """Found in this image."""


class ConfidenceEstimator:
    """What a node must show; the first image's side of it, prepared once.

    Kept, so that its own flow stands: the tracked channel correlates above KEEP_CORRELATION, it
    lands inside the image, and the flow around it does not squeeze areas below KEEP_DET.

    Confident: kept, and a secondary match. Of a colour image the fit sees the luma, so the colour
    differences, which hold none of it, must correlate above CHROMA_MIN over WINDOW_PX. A grey
    image, and a place whose colour varies by less than COLOUR_SHARE, has no secondary match: the
    one correlation must be above GREY_MIN. In all, the fit's own predicted deviation is below
    DEVIATION_MAX_PX; of a flow that the fused steps found, together with what they have yet to do
    around (root of the mean square over FIT_PX). It lands BORDER_PX or more from the image's edge,
    and of the textured nodes in SUPPORT_PX around at least SUPPORT_SHARE agree.

    A frame is trusted when TEXTURED_SHARE or more of the first image has a standard deviation of
    TEXTURE_MIN grey levels in detail finer than FINE_PX, at full size; and TRUSTED_SHARE or more of
    that is confident now. One image does not tell that detail from noise; later ones do.

    image: (h, w, 3) BGR or (h, w) grey, uint8; plane: of the same.
    """

    def __init__(self, image: Array | SampledImage, plane: Plane) -> None:
        self._colour = image.ndim == 3
        self._shape = plane.shape
        fine = plane.gray.astype(np.float32)
        fine -= cv2.blur(fine, (FINE_PX, FINE_PX), borderType=_EDGE)
        power = self._means(shrink(fine * fine, 2))
        self.contrast = float(np.sqrt(power.max()))
        self.textured: Array = self._fine(power) >= TEXTURE_MIN**2
        self.textured_share = float(self.textured.mean())
        self._textured_near = self._near(self.textured)
        if self._colour:
            self._secondary = [channel.astype(np.float32) - 128 for channel in _secondary(image)]
            self._mean = [self._means(channel) for channel in self._secondary]
            power = self._means(_product(self._secondary, self._secondary))
            self._power = power - _product(self._mean, self._mean)
            luma = shrink(plane.gray, 2).astype(np.float32)
            contrast = self._means(luma * luma) - self._means(luma) ** 2
            self._colourless = self._fine(self._power < COLOUR_SHARE**2 * contrast)

    def secondary_match(self, image: Array | SampledImage) -> list[Array]:
        """What `look` asks of the current image (h, w[, 3]), nothing of a grey one."""
        return _secondary(image) if self._colour else []

    def check(self, secondary_match: list[Array], match: RefinedFlow) -> tuple[Array, Array]:
        """Nodes whose own flow stands, and those of them that the secondary match bears out.

        Both (hh, ww) bool; secondary_match: of the current image, of which the match is.
        """
        flow, correlation, deviation, _ = match
        right, down = (
            cv2.Sobel(flow, -1, dx, 1 - dx, ksize=1, scale=0.25, borderType=_EDGE) for dx in (1, 0)
        )
        det = (1 + right[..., 0]) * (1 + down[..., 1]) - down[..., 0] * right[..., 1]
        height, width = self._shape
        x, y = cv2.split(2 * _landing(flow) + np.float32(0.5))
        near = np.minimum(
            np.minimum(x, np.float32(width - 1) - x), np.minimum(y, np.float32(height - 1) - y)
        )
        valid = (correlation > KEEP_CORRELATION) & (det > KEEP_DET) & (near >= 0)
        agreeing = valid & self.textured & (deviation < DEVIATION_MAX_PX) & (near >= BORDER_PX)
        if self._colour:
            chroma_ok = self._fine(self._chroma(secondary_match, _landing(flow)) > CHROMA_MIN)
            agreeing &= np.where(self._colourless, correlation > GREY_MIN, chroma_ok)
        else:
            agreeing &= correlation > GREY_MIN
        return valid, agreeing

    def node_states(self, inside: Array, valid: Array) -> Array:
        """What stands behind each node's flow, (hh, ww) uint8 of FlowState."""
        state = np.full(valid.shape, FlowState.MATCHED, np.uint8)
        if not valid.all():
            guided = (self._near(valid) >= SUPPORT_SHARE) & inside
            state[~valid] = np.where(guided[~valid], FlowState.PREDICTED, FlowState.LOST)
        return state

    def converged(self, match: RefinedFlow, valid: Array) -> Array:
        """Where the steps around have little left to do, (hh, ww) bool.

        One node's own step may happen to be 0, so the kept ones around count.
        """
        weight = shrink(valid.astype(np.float32), 2)
        ahead = shrink(np.where(valid, match.ahead_px2, np.float32(0)), 2)
        n, total = (cv2.blur(a, _FIT, borderType=_EDGE) for a in (weight, ahead))
        rest_px2 = self._fine(total / np.maximum(n, np.float32(1e-3)))
        return np.asarray(match.deviation_px**2 + rest_px2 < DEVIATION_MAX_PX**2)

    def select_confident(self, agreeing: Array) -> Array:
        """Nodes that agree, with enough others around them that do, (hh, ww) bool."""
        return np.asarray(agreeing & (self._near(agreeing) >= SUPPORT_SHARE * self._textured_near))

    def is_trusted(self, confident: Array) -> bool:
        """Whether a frame with these confident nodes is trusted."""
        limit = TRUSTED_SHARE * max(1, int(np.count_nonzero(self.textured)))
        return self.textured_share >= TEXTURED_SHARE and int(np.count_nonzero(confident)) >= limit

    def _chroma(self, secondary_match: list[Array], landing: Array) -> Array:
        """Correlation, by coarse cell, of what the fit has not seen; both channels together."""
        current = [sample(c, landing).astype(np.float32) - 128 for c in secondary_match]
        mean = [self._means(channel) for channel in current]
        power = self._means(_product(current, current)) - _product(mean, mean)
        shared = self._means(_product(self._secondary, current)) - _product(self._mean, mean)
        return np.asarray(
            shared
            / np.sqrt(np.maximum(self._power, _MIN_VARIANCE) * np.maximum(power, _MIN_VARIANCE))
        )

    def _means(self, nodes: Array) -> Array:
        """Means over WINDOW_PX, by coarse cell."""
        return cv2.blur(shrink(nodes, 2), _WINDOW, borderType=_EDGE)

    def _near(self, mask: Array) -> Array:
        """Share of the nodes in SUPPORT_PX around, (hh, ww)."""
        return self._fine(cv2.blur(shrink(mask.astype(np.float32), 2), _SUPPORT, borderType=_EDGE))

    def _fine(self, coarse: Array) -> Array:
        hh, ww = (-(-s // 2) for s in self._shape)
        return np.repeat(np.repeat(coarse, 2, axis=0), 2, axis=1)[:hh, :ww]


def _landing(flow_px: Array) -> Array:
    """Where nodes go, (hh, ww, 2) in nodes of the current image."""
    return landing_px(flow_px * np.float32(0.5))


def _secondary(image: Array | SampledImage) -> list[Array]:
    """Colour differences of a BGR image on the half grid, (hh, ww) uint8 each: without luma."""
    small = image.nodes if isinstance(image, SampledImage) else shrink(image, 2)
    return list(cv2.split(cv2.cvtColor(small, cv2.COLOR_BGR2YCrCb))[1:])


def _product(first: list[Array], second: list[Array]) -> Array:
    return np.asarray(first[0] * second[0] + first[1] * second[1])


@dataclass(frozen=True)
class FlowDiagnostics:
    """What is known of one frame's flow besides the flow.

    frame: 0 for the first image. n_reference_switches: since then. textured_share: share of the
    first image in which there is anything to see. trusted: texture and confidence suffice
    (`ConfidenceEstimator`). confident_share: share of the visible pixels that are confident.
    cpu_ms: process time of the update, over all threads; where its parts run side by side, that of
    the other parts is in it.
    """

    frame: int
    n_reference_switches: int
    textured_share: float
    trusted: bool
    confident_share: float
    cpu_ms: float


@dataclass(frozen=True)
class FlowObservation:
    """Total flow of one frame; the arrays are read-only.

    All have one size (h, w): that of the image, or half of it where the tracker was asked for half
    (`full=False`); element (i, j) then stands for the middle of the four pixels from (2 i, 2 j) on.
    Flows are in pixels of the image in either case.

    flow_px: (h, w, 2) float32, from the first image, at its pixels (Lagrangian). visible: (h, w)
    bool, the flow ends inside this image, and inside every reference that it was composed over.
    confident: (h, w) bool, see `ConfidenceEstimator`. state: (h, w) uint8 of `FlowState`.
    """

    flow_px: Array
    visible: Array
    confident: Array
    state: Array
    diagnostics: FlowDiagnostics


@dataclass(frozen=True)
class TrackedFrame:
    """What one way to follow a sequence says of one frame, before it is judged.

    flow_px, kept, agreeing: on the half grid, see `confidence`. full_px: (h, w, 2), where the way
    finds its flow at every pixel. stayed: (h, w) bool, the flow never left an image that it was
    composed over; None: that is no question. match: what the fused steps found it by.
    """

    flow_px: Array
    valid: Array
    agreeing: Array
    full_px: Array | None = None
    inside: Array | None = None
    n_reference_switches: int = 0
    match: RefinedFlow | None = None


class PreparedImage(NamedTuple):
    """An image of a sequence, made ready to be followed.

    frame: 0 for the first. plane, secondary_match: what is tracked of it and what
    `ConfidenceEstimator.look` asks of it. ahead_px: a look ahead, by coarse node.
    start_s: process time when it came.
    """

    frame: int
    image: Array | SampledImage
    plane: Plane
    secondary_match: list[Array]
    ahead_px: Array | None
    start_s: float
