"""Total flow against the first image, whatever was hidden in between.

Frame-to-frame flow, composed, says where to look; each frame is then refined against the first
image, so errors do not add up. What is not found goes on as its trustworthy neighbours do, instead
of taking the motion of what hides it, and is found again there when it reappears.
"""

from __future__ import annotations

import numpy as np

from ...aliases import Array
from ..compose import landing_px, sample, shrunk
from .confidence import ConfidenceEstimator
from .fill import filled
from .fused import COARSE, Plane, RefinementReference, predict
from .observation import PreparedImage, TrackedFrame


class AnchoredTracker:
    """Follows one sequence.

    reference: of the first image. judge: of the same.
    """

    def __init__(self, reference: RefinementReference, judge: ConfidenceEstimator) -> None:
        self._reference = reference
        self._judge = judge
        self._before = reference.plane
        self._flow: Array = np.zeros((*reference.plane.small.shape, 2), np.float32)

    def ahead(self, plane: Plane) -> Array:
        """The flow in px from the image before to this one, as far as one look shows: coarse."""
        before, self._before = self._before, plane
        return shrunk(predict(before, plane), COARSE)

    def step(self, ready: PreparedImage) -> TrackedFrame:
        """Follow one more image."""
        assert ready.ahead_px is not None, "made by `ahead`"
        so_far = shrunk(self._flow, COARSE)
        at = landing_px(so_far * np.float32(0.5 / COARSE))
        start = so_far + sample(ready.ahead_px, at)
        match = self._reference.refine(ready.plane, start)
        kept, agreeing = self._judge.look(ready.secondary_match, match)
        # Neighbours are asked only where they agree: a match that is kept and wrong would draw
        # others after it.
        self._flow = filled(match.flow_px, agreeing, kept)
        return TrackedFrame(self._flow, kept, agreeing, match=match)
