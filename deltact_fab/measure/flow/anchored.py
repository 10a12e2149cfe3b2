"""Total flow against the first image, whatever was hidden in between.

Frame-to-frame flow, composed, says where to look; each frame is then refined against the first
image, so errors do not add up. What is not found goes on as its trustworthy neighbours do, instead
of taking the motion of what hides it, and is found again there when it reappears.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compose import landing_px, sample
from .confidence import Judge
from .fill import filled
from .fused import Plane, Reference, predict
from .observation import Followed

Array = NDArray[Any]


class Anchored:
    """Follows one sequence.

    reference: of the first image. judge: of the same.
    """

    def __init__(self, reference: Reference, judge: Judge) -> None:
        self._reference = reference
        self._judge = judge
        self._last = reference.plane
        self._flow: Array = np.zeros((*reference.plane.small.shape, 2), np.float32)

    def step(self, image: Array, plane: Plane) -> Followed:
        """Follow one more image, (h, w[, 3]) uint8; plane: of the same."""
        start = self._flow + sample(
            predict(self._last, plane), landing_px(self._flow * np.float32(0.5))
        )
        match = self._reference.refine(plane, start)
        kept, agreeing = self._judge.look(image, match)
        # Neighbours are asked only where they agree: a match that is kept and wrong would draw
        # others after it.
        flow = filled(match.flow_px, agreeing, kept)
        self._flow, self._last = flow, plane
        return Followed(flow, kept, agreeing & self._judge.settled(match, kept))
