"""What is known of one frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

Array = NDArray[Any]


@dataclass(frozen=True)
class FlowDiagnostics:
    """What is known of one frame's flow besides the flow.

    frame: 0 for the first image. reference_frame: the frame it was matched against.
    n_reference_switches: since the first image. n_flows: flows computed for this frame.
    bad_share: share of textured blocks with an NCC below ncc_min. trusted: bad_share is within the
    rule's trust_share. confident_share: share of the visible pixels that are confident.
    cpu_ms: process time of the update, over all threads.
    """

    frame: int
    reference_frame: int
    n_reference_switches: int
    n_flows: int
    bad_share: float
    ncc_min: float
    trusted: bool
    confident_share: float
    cpu_ms: float


@dataclass(frozen=True)
class FlowObservation:
    """Total flow of one frame; the arrays are read-only.

    flow_px: (h, w, 2) float32, from the first image, at its pixels (Lagrangian).
    visible: (h, w) bool, the pixel's path has stayed inside the images it was followed through.
    confident: (h, w) bool, the pixel's block matched in every flow that its total is made of; what
    was composed from a bad block stays out, though later flows match.
    ncc: (h // block, w // block) float32 by block of this frame's *reference* image (NaN where
    nothing can be said).
    """

    flow_px: Array
    visible: Array
    confident: Array
    ncc: Array
    diagnostics: FlowDiagnostics
