"""What is known of one frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

from ...aliases import Array

if TYPE_CHECKING:
    from .confidence import ConfidenceEstimator
    from .fused import Plane, Refined, Sampled


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
    kept: Array
    agreeing: Array
    full_px: Array | None = None
    stayed: Array | None = None
    n_reference_switches: int = 0
    match: Refined | None = None


class SequenceTracker(Protocol):
    """A way to follow a sequence from its first image on, and the judge of what it finds."""

    judge: ConfidenceEstimator

    def ahead(self, plane: Plane) -> Array | None:
        """The flow in px from the image before to this one, by coarse node, where it is asked."""

    def step(self, ready: PreparedImage) -> TrackedFrame:
        """Follow one more image."""


class PreparedImage(NamedTuple):
    """An image of a sequence, made ready to be followed.

    frame: 0 for the first. plane, secondary_match: what is tracked of it and what
    `ConfidenceEstimator.look` asks of it. ahead_px: the way's look ahead, by coarse node.
    start_s: process time when it came.
    """

    way: SequenceTracker
    frame: int
    image: Array | Sampled
    plane: Plane
    secondary_match: list[Array]
    ahead_px: Array | None
    start_s: float
