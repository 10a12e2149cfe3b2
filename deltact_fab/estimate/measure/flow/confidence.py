"""Confidence of a frame's flow: which nodes are valid, confident and trusted, for all trackers.

All arrays of the rule lie on the half grid of `fused`, (hh, ww): a node stands for 2 x 2 pixels;
flows are in pixels of the image. Every flow is judged against the *first* image, however it was
composed.
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

_EDGE_MODE = cv2.BORDER_REPLICATE
# Thresholds without another source: decisions 0061, 0083; how they were set: docs/evidence/flow.md.
_COARSE_PX = 4  # windows are counted in cells of 2 x 2 nodes
_CHROMA_FLOOR = 1.0  # grey levels^2, below the noise of a camera
KEEP_CORRELATION = 0.35
KEEP_DET = 0.12
CHROMA_MIN = 0.5
COLOUR_SHARE = 0.45  # of the luma deviation; measured with a Bayer mosaic: grey 0.38, colour 0.61
GREY_MIN = 0.7
DEVIATION_MAX_PX, OBSERVED_MAX_PX = 0.36, 0.7
EDGE_GAP_PX, EDGE_NODES = 3.0, 3
WINDOW_PX, FIT_PX, SUPPORT_PX = 20, 28, 68
OFF_CENTRE_MAX_PX = 6.0
SUPPORT_SHARE = 0.5
FILL_SHARE = 0.55  # of SUPPORT_PX around; by hand: 0.5 extends a straight edge by a node
TEXTURE_MIN = 1.0  # grey levels; gels without a pattern have it on 0.39 of the view at most
FINE_PX = 19
TEXTURED_SHARE = 0.5
TRUSTED_FLOW_SHARE = 0.35
_WINDOW_CELLS, _FIT_CELLS, _SUPPORT_CELLS = (
    (px // _COARSE_PX,) * 2 for px in (WINDOW_PX, FIT_PX, SUPPORT_PX)
)


class FlowState(IntEnum):
    LOST = 0
    """Not observed in this image, nor enclosed by nodes that are: a guess."""
    PREDICTED = 1
    """Filled from observed nodes around."""
    MATCHED = 2
    """Observed in this image, or matched and like the observed nodes around."""


class ConfidenceEstimator:
    """Rules for valid, observed and confident nodes, with the first image prepared once.

    Valid, so that a node starts the next image from its own flow: the tracked channel correlates
    above KEEP_CORRELATION, it lands inside the image, and the flow around it does not shrink areas
    below KEEP_DET.

    Agreeing: valid, with a secondary match. In a colour image the fit uses the luma, so the colour
    differences, which are independent of it, must correlate above CHROMA_MIN over WINDOW_PX. A grey
    image, or a place whose colour varies by less than COLOUR_SHARE, has no secondary match: its
    correlation must exceed GREY_MIN. The window has detail, in its middle. The node lands
    EDGE_GAP_PX or more inside the image.

    Confident: agreeing, as SUPPORT_SHARE or more of the nodes with detail in SUPPORT_PX around, and
    the predicted deviation with the remaining steps around (root mean square over FIT_PX, for
    `fused`) is below DEVIATION_MAX_PX. Observed: the same below OBSERVED_MAX_PX where there is
    colour. Known: observed, or enclosed by FILL_SHARE of observed nodes around (decision 0083).

    A frame is trusted if TEXTURED_SHARE or more of the first image has a standard deviation of
    TEXTURE_MIN grey levels in detail finer than FINE_PX, at full size, and TRUSTED_FLOW_SHARE or
    more of that is confident now. A single image cannot separate that detail from noise.

    image: (h, w, 3) BGR or (h, w) grey, uint8; plane: made from it.
    """

    def __init__(self, image: Array | SampledImage, plane: Plane) -> None:
        self._colour = image.ndim == 3
        self._shape = plane.shape
        fine = plane.gray.astype(np.float32)
        fine -= cv2.blur(fine, (FINE_PX, FINE_PX), borderType=_EDGE_MODE)
        power = self._means(shrink(fine * fine, 2))
        self.contrast = float(np.sqrt(power.max()))
        self.textured = self._fine((power >= TEXTURE_MIN**2) & self._is_central(plane.gray))
        self.textured_share = float(self.textured.mean())
        self._textured_near = self._near(self.textured)
        self._observed_px2: Array = np.array(DEVIATION_MAX_PX**2, np.float32)
        if self._colour:
            self._secondary = [channel.astype(np.float32) - 128 for channel in _secondary(image)]
            self._mean = [self._means(channel) for channel in self._secondary]
            power = self._means(_product(self._secondary, self._secondary))
            self._power = power - _product(self._mean, self._mean)
            luma = shrink(plane.gray, 2).astype(np.float32)
            contrast = self._means(luma * luma) - self._means(luma) ** 2
            self._colourless = self._fine(self._power < COLOUR_SHARE**2 * contrast)
            self._observed_px2 = np.where(self._colourless, DEVIATION_MAX_PX, OBSERVED_MAX_PX) ** 2

    def secondary_match(self, image: Array | SampledImage) -> list[Array]:
        """Return chroma planes of the current image (h, w[, 3]) for `check`; none of a grey one."""
        return _secondary(image) if self._colour else []

    def check(self, secondary_match: list[Array], match: RefinedFlow) -> tuple[Array, Array]:
        """Return masks of valid nodes, and of those that the secondary match confirms.

        Both (hh, ww) bool; secondary_match, match: of the current image.
        """
        flow, correlation, deviation, _ = match
        (xx, yx), (xy, yy) = (
            [cv2.Sobel(u, -1, x, 1 - x, ksize=1, scale=0.25, borderType=_EDGE_MODE) for x in (1, 0)]
            for u in cv2.split(flow)
        )
        landing = landing_nodes(flow)
        det = (1 + xx) * (1 + yy) - yx * xy
        valid = (correlation > KEEP_CORRELATION) & (det > KEEP_DET) & self.inside(landing)
        agreeing = valid & self.textured & (deviation < DEVIATION_MAX_PX)
        agreeing &= self.inside(landing, EDGE_GAP_PX)
        if self._colour:
            chroma_ok = self._fine(self._chroma(secondary_match, landing) > CHROMA_MIN)
            agreeing &= np.where(self._colourless, correlation > GREY_MIN, chroma_ok)
        else:
            agreeing &= correlation > GREY_MIN
        return valid, agreeing

    def select(self, match: RefinedFlow, valid: Array, agreeing: Array) -> tuple[Array, Array]:
        """Select confident and observed nodes, (hh, ww) bool each, of a fit of `fused`.

        A single node's step may be 0 by chance, so steps of valid nodes around are averaged.
        """
        weight = shrink(valid.astype(np.float32), 2)
        ahead = shrink(np.where(valid, match.ahead_px2, np.float32(0)), 2)
        n, total = (cv2.blur(a, _FIT_CELLS, borderType=_EDGE_MODE) for a in (weight, ahead))
        rest_px2 = self._fine(total / np.maximum(n, np.float32(1e-3)))
        expected_px2 = match.deviation_px**2 + rest_px2
        confident = self.supported(agreeing & (expected_px2 < DEVIATION_MAX_PX**2))
        return confident, self.supported(agreeing & (expected_px2 < self._observed_px2))

    def supported(self, agreeing: Array) -> Array:
        """True for agreeing nodes with enough agreeing nodes around, (hh, ww) bool."""
        return np.asarray(agreeing & (self._near(agreeing) >= SUPPORT_SHARE * self._textured_near))

    def enclose(self, observed: Array) -> Array:
        """True for observed nodes and those that they enclose, (hh, ww) bool."""
        # A node at the border lands too near to it to be observed; the next ones bound it.
        n = EDGE_NODES
        bounding = np.pad(observed[n:-n, n:-n], n, mode="edge")
        return np.asarray(observed | (self._near(bounding) >= FILL_SHARE))

    @staticmethod
    def node_states(matched: Array, enclosed: Array) -> Array:
        """Return the FlowState of each node, (hh, ww) uint8."""
        state = enclosed.astype(np.uint8)
        state[enclosed & matched] = FlowState.MATCHED
        return state

    def is_trusted(self, confident: Array) -> bool:
        """True if a frame with these confident nodes is trusted."""
        limit = TRUSTED_FLOW_SHARE * max(1, int(np.count_nonzero(self.textured)))
        return self.textured_share >= TEXTURED_SHARE and int(np.count_nonzero(confident)) >= limit

    def _chroma(self, secondary_match: list[Array], landing: Array) -> Array:
        """Correlation of the colour differences by coarse cell, both channels together."""
        current = [sample(c, landing).astype(np.float32) - 128 for c in secondary_match]
        mean = [self._means(channel) for channel in current]
        power = self._means(_product(current, current)) - _product(mean, mean)
        shared = self._means(_product(self._secondary, current)) - _product(self._mean, mean)
        return np.asarray(
            shared
            / np.sqrt(np.maximum(self._power, _CHROMA_FLOOR) * np.maximum(power, _CHROMA_FLOOR))
        )

    def inside(self, landing: Array, gap_px: float = 0.0) -> Array:
        """True for nodes that land inside the image by a gap, (hh, ww) bool."""
        # Node j lies at pixel 2 j + 1/2.
        low = gap_px / 2 - 0.25
        high = tuple((n - 1 - gap_px) / 2 - 0.25 for n in reversed(self._shape))
        return cv2.inRange(landing, (low, low), high).view(bool)

    def _means(self, nodes: Array) -> Array:
        """Means over WINDOW_PX, by coarse cell."""
        return cv2.blur(shrink(nodes, 2), _WINDOW_CELLS, borderType=_EDGE_MODE)

    def _near(self, mask: Array) -> Array:
        """Fraction of the nodes in SUPPORT_PX around, (hh, ww)."""
        cells = shrink(mask.astype(np.float32), 2)
        return self._fine(cv2.blur(cells, _SUPPORT_CELLS, borderType=_EDGE_MODE))

    def _is_central(self, gray: Array) -> Array:
        """True for coarse cells around which the detail of a window lies, not at its rim.

        A fit gives the motion of the place where the squared gradients of its window lie.
        """
        steps = (cv2.Sobel(gray, cv2.CV_32F, x, 1 - x, borderType=_EDGE_MODE) for x in (1, 0))
        energy = shrink(np.sum([step * step for step in steps], axis=0), _COARSE_PX)
        energy += np.float32(1e-3)
        y, x = (np.arange(n, dtype=np.float32) for n in energy.shape)
        total, along, down = (
            cv2.blur(part, _WINDOW_CELLS, borderType=cv2.BORDER_REFLECT)
            for part in (energy, energy * x, energy * y[:, None])
        )
        offset = np.hypot(along / total - x, down / total - y[:, None])
        return np.asarray(offset * _COARSE_PX <= OFF_CENTRE_MAX_PX)

    def _fine(self, coarse: Array) -> Array:
        hh, ww = (-(-s // 2) for s in self._shape)
        return np.repeat(np.repeat(coarse, 2, axis=0), 2, axis=1)[:hh, :ww]


def landing_nodes(flow_px: Array) -> Array:
    """Positions of the nodes in the current image, (hh, ww, 2) in nodes."""
    return landing_px(flow_px * np.float32(0.5))


def _secondary(image: Array | SampledImage) -> list[Array]:
    """Colour differences Cr, Cb of a BGR image on the half grid, (hh, ww) uint8 each."""
    small = image.nodes if isinstance(image, SampledImage) else shrink(image, 2)
    return list(cv2.split(cv2.cvtColor(small, cv2.COLOR_BGR2YCrCb))[1:])


def _product(first: list[Array], second: list[Array]) -> Array:
    return np.asarray(first[0] * second[0] + first[1] * second[1])


@dataclass(frozen=True)
class FlowDiagnostics:
    """Quality figures of a frame's flow.

    frame: 0 for the first image. n_reference_switches: since then. textured_share: fraction of the
    first image with texture. trusted: texture and confidence suffice (`ConfidenceEstimator`).
    confident_share: fraction of the visible pixels that are confident. cpu_ms: process time of the
    update, over all threads, including other parts that run in parallel.
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
    bool, the flow ends inside this image and inside every reference it was composed over.
    confident: (h, w) bool, see `ConfidenceEstimator`. state: (h, w) uint8 of `FlowState`.
    """

    flow_px: Array
    visible: Array
    confident: Array
    state: Array
    diagnostics: FlowDiagnostics


@dataclass(frozen=True)
class TrackedFrame:
    """Flow of a frame from a tracker, before its confidence is computed.

    flow_px, matched, enclosed, confident: on the half grid. full_px: (h, w, 2), of trackers with a
    flow at every pixel. inside: (h, w) bool, the flow never left an image it was composed
    over; None if it is not composed. reused_s: CPU time of flow that another tracker had computed.
    """

    flow_px: Array
    matched: Array
    enclosed: Array
    confident: Array
    full_px: Array | None = None
    inside: Array | None = None
    n_reference_switches: int = 0
    reused_s: float = 0.0


class CheckedMatch(NamedTuple):
    """Fit of `fused` with its valid and its agreeing nodes, (hh, ww) bool each."""

    match: RefinedFlow
    valid: Array
    agreeing: Array


class PreparedImage(NamedTuple):
    """Image of a sequence, prepared for tracking.

    frame: 0 for the first. plane: tracked channel. secondary_match: input of
    `ConfidenceEstimator.check`. ahead_px: predicted motion by coarse node. start_s: process time
    at its arrival.
    """

    frame: int
    image: Array | SampledImage
    plane: Plane
    secondary_match: list[Array]
    ahead_px: Array | None
    start_s: float
