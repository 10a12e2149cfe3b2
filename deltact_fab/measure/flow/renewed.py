"""Total flow with a reference that is renewed on the way: the paper's adaptive reference.

Dense Optical Flow and Adaptive Reference, after Du et al. 2021. It is what the anchored tracker is
compared with.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from ...aliases import Array
from ..compose import compose, inside, landing_px, sample
from .confidence import ConfidenceEstimator
from .fused import Plane, RefinementReference, Sampled, to_gray, to_half
from .method import FlowMethod
from .observation import PreparedImage, TrackedFrame

Sum = Literal["composed", "summed", "static"]
RENEW_SHARE = 0.25
"""Of the pattern's own difference between unrelated views. The paper gives no threshold: at .25 its
order of patterns and nearly its figures come out, at .5 not (docs/evidence/study-methods.md)."""
LIGHT_PX, BLOB_PX, BLOB = 24.0, 3.0, 3.0
SHIFTS_PX = tuple((60 + 7 * k, 200 - 11 * k) for k in range(16))
"""Many, for a pattern of two colours alternates: one shift may lay like on like."""


@dataclass(frozen=True)
class _Keyframe:
    gray: Array
    flow_px: Array
    stayed: Array


class RenewedTracker:
    """Follows one sequence from its first image on.

    The current image, warped back by its flow, is compared with the reference; when they differ by
    more than `share` of what unrelated views of the pattern differ by (mean absolute, grey levels,
    at full size), the current image is the reference from then on.

    total: "composed" F(x) = F_ref(x) + f(x + F_ref(x)); "summed" F_ref(x) + f(x), the plain
    superposition; the paper's text can mean both. "static" keeps the first image.
    Each flow starts from the last one against the same reference; after a switch it starts cold.
    first, judge: of the first image, for what is said of the total.
    """

    def __init__(
        self,
        method: FlowMethod,
        total: Sum,
        image: Array,
        first: RefinementReference,
        judge: ConfidenceEstimator,
        share: float = RENEW_SHARE,
    ) -> None:
        self._method, self._total = method, total
        self._first, self.judge = first, judge
        gray = to_gray(image)
        self.threshold = share * unrelated_difference(gray)
        zero = np.zeros((*gray.shape, 2), np.float32)
        self._ref = _Keyframe(gray, zero, np.ones(gray.shape, bool))
        self._relative: Array | None = None
        self._switches = 0

    def ahead(self, plane: Plane) -> None:
        """Nothing: each flow starts from the last one."""

    def step(self, ready: PreparedImage) -> TrackedFrame:
        """Follow one more image."""
        assert not isinstance(ready.image, Sampled), "for the anchored reference only"
        gray, ref = to_gray(ready.image), self._ref
        relative = self._relative = self._method.between(ref.gray, gray, self._relative)
        if not self._switches:
            flow = relative
        elif self._total == "summed":
            flow = ref.flow_px + relative
        else:
            flow = compose(ref.flow_px, relative)
        # What left the image before the reference was continued from the border, so it stays out.
        stayed = ref.stayed & inside(landing_px(flow), *flow.shape[:2])
        if self._total != "static" and photometric_error(ref.gray, gray, relative) > self.threshold:
            self._ref = _Keyframe(gray, flow, stayed)
            self._relative = None
            self._switches += 1
        nodes = to_half(flow)
        kept, agreeing = self.judge.look(
            ready.secondary_match, self._first.evaluate(ready.plane, nodes)
        )
        return TrackedFrame(nodes, kept, agreeing, flow, stayed, self._switches)


def photometric_error(reference: Array, current: Array, flow: Array) -> float:
    """Mean absolute difference, grey levels, of the reference and the current image warped back.

    What lands outside of the image is left out; 255 where everything does.
    """
    landing = landing_px(flow)
    off = cv2.absdiff(reference, sample(current, landing))
    within = inside(landing, *reference.shape)
    return float(off[within].mean()) if within.any() else 255.0


def unrelated_difference(gray: Array) -> float:
    """Mean absolute difference, grey levels, that views of other places of a pattern would show.

    Of one image (h, w) with itself shifted far; its light, which changes slowly, and marker dots,
    which stand out of the pattern, are left out.
    """
    image = gray.astype(np.float32)
    detail = image - cv2.GaussianBlur(image, (0, 0), LIGHT_PX)
    blobs = np.abs(cv2.GaussianBlur(detail, (0, 0), BLOB_PX))
    plain = blobs < BLOB * np.median(blobs)
    found = []
    for shift in SHIFTS_PX:
        both = plain & np.roll(plain, shift, (0, 1))
        found.append(np.abs(detail - np.roll(detail, shift, (0, 1)))[both].mean())
    return float(np.mean(found))
