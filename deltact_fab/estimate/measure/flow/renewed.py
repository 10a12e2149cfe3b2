"""Flow between two images by named method, and the paper's tracker of a sequence.

Dense Optical Flow and Adaptive Reference, after Du et al. 2021: the reference is renewed during the
sequence. Baseline for the anchored tracker.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np

from deltact_fab.common import Array, InputError, did_you_mean

from ..compose import compose, is_inside, landing_px, sample
from .confidence import ConfidenceEstimator, PreparedImage, TrackedFrame
from .fused import Plane, RefinementReference, SampledImage, to_full, to_gray, to_half

# Farneback 2003: 5 levels, a window of 13 and 10 iterations are the defaults of OpenCV's GPU
# version, which the paper cites.
_FARNEBACK_SETTINGS: dict[str, Any] = {
    "pyr_scale": 0.5, "levels": 5, "winsize": 13, "iterations": 10, "poly_n": 5, "poly_sigma": 1.1,
}  # fmt: skip
# Dense Inverse Search (Kroeger 2016): to half resolution; finer patches and refinement.
_DIS_PRESETS = {
    "dis-fast": cv2.DISOPTICAL_FLOW_PRESET_FAST,
    "dis-medium": cv2.DISOPTICAL_FLOW_PRESET_MEDIUM,
}
FUSED_METHOD = "fused"  # Dense Inverse Search at half the size, then inverse-compositional steps


class FlowMethod:
    """Flow method for two grey images (h, w) uint8 of one size.

    name: PAPER or one of NAMES; raises InputError for any other. Caches the prepared reference of
    `fused` and Farneback's last flow, which a summed and a composed tracker that share a method
    request twice.
    """

    NAMES = ("farneback-paper", *_DIS_PRESETS, FUSED_METHOD)
    PAPER = "paper"
    """The paper's method, Farneback; by default with a summed reference, as the paper's tracker."""

    def __init__(self, name: str = FUSED_METHOD) -> None:
        if name not in (valid_names := (self.PAPER, *self.NAMES)):
            raise InputError(f"flow method {name!r}: unknown; {did_you_mean(name, valid_names)}")
        self.name = name = "farneback-paper" if name == self.PAPER else name
        self._dis = cv2.DISOpticalFlow.create(_DIS_PRESETS[name]) if name in _DIS_PRESETS else None
        self._prepared: tuple[Array, RefinementReference] | None = None
        self._last: tuple[list[bytes | None], Array] | None = None

    @staticmethod
    def prepare(image: Array) -> Array:
        """Convert an image (h, w[, 3]) for `between` as trackers do: blurred luma."""
        return Plane.from_image(image).gray

    def between(self, ref_gray: Array, cur_gray: Array, initial: Array | None = None) -> Array:
        """Compute the flow from the reference to the current image at the reference's pixels.

        ref_gray: must not change between calls. initial: (h, w, 2) px initial flow, None for a
        cold start. Returns (h, w, 2) float32 px, never the array passed as initial.
        """
        if self.name == FUSED_METHOD:
            return self._fused(ref_gray, cur_gray, initial)
        # cv2 methods write into the initial array, and need it contiguous.
        start: Any = None if initial is None else np.array(initial, dtype=np.float32, order="C")
        if self._dis is not None:
            return self._dis.calc(ref_gray, cur_gray, start)
        key = [None if image is None else image.tobytes() for image in (ref_gray, cur_gray, start)]
        if self._last is None or self._last[0] != key:
            flags = cv2.OPTFLOW_USE_INITIAL_FLOW if start is not None else 0
            flow = cv2.calcOpticalFlowFarneback(
                ref_gray, cur_gray, start, flags=flags, **_FARNEBACK_SETTINGS
            )
            self._last = key, flow
        return self._last[1]

    def _fused(self, ref_gray: Array, cur_gray: Array, initial: Array | None) -> Array:
        if self._prepared is None or self._prepared[0] is not ref_gray:
            self._prepared = ref_gray, RefinementReference(Plane.from_image(ref_gray))
        start = None if initial is None else to_half(initial)
        refined = self._prepared[1].refine(Plane.from_image(cur_gray), start)
        return to_full(refined.flow_px, ref_gray.shape)


CompositionRule = Literal["composed", "summed", "static"]
LIGHT_SIGMA_PX, BLOB_SIGMA_PX, BLOB_FACTOR = 24.0, 3.0, 3.0  # by hand: larger blobs leave dots in
SHIFTS_PX = tuple((60 + 7 * k, 200 - 11 * k) for k in range(16))
"""By hand: 16, as a periodic pattern of two colours may match itself under one shift."""


@dataclass(frozen=True)
class _Keyframe:
    gray: Array
    flow_px: Array
    inside: Array


class RenewedTracker:
    """Tracker of one sequence with a renewed reference.

    The current image, warped back by its flow, is compared with the reference; if they differ by
    more than `share` of the difference of unrelated views of the pattern (mean absolute, grey
    levels, at full size), the current image becomes the reference.

    total: "composed" F(x) = F_ref(x) + f(x + F_ref(x)); "summed" F_ref(x) + f(x), plain
    superposition; the paper's text allows both. "static" keeps the first image.
    Each flow starts from the last one against the same reference; after a switch it starts cold.
    first, judge: of the first image, to judge the total flow.
    """

    def __init__(
        self,
        method: FlowMethod,
        total: CompositionRule,
        image: Array,
        first: RefinementReference,
        judge: ConfidenceEstimator,
        share: float,
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
        """No-op: each flow starts from the last one."""

    def step(self, ready: PreparedImage) -> TrackedFrame:
        assert not isinstance(ready.image, SampledImage), "for the anchored reference only"
        gray, ref = to_gray(ready.image), self._ref
        relative = self._relative = self._method.between(ref.gray, gray, self._relative)
        if not self._switches:
            flow = relative
        elif self._total == "summed":
            flow = ref.flow_px + relative
        else:
            flow = compose(ref.flow_px, relative)
        # Flow that left the image earlier is extrapolated from the border: excluded for good.
        within = ref.inside & is_inside(landing_px(flow), *flow.shape[:2])
        if self._total != "static" and photometric_error(ref.gray, gray, relative) > self.threshold:
            self._ref = _Keyframe(gray, flow, within)
            self._relative = None
            self._switches += 1
        nodes = to_half(flow)
        valid, agreeing = self.judge.check(
            ready.secondary_match, self._first.evaluate(ready.plane, nodes)
        )
        confident = self.judge.supported(agreeing)
        known = self.judge.surround(confident)
        return TrackedFrame(nodes, valid, known, confident, flow, within, self._switches)


def photometric_error(reference: Array, current: Array, flow: Array) -> float:
    """Mean absolute difference, grey levels, of the reference and the current image warped back.

    Pixels that land outside the image are ignored; 255 if all do.
    """
    landing = landing_px(flow)
    difference = cv2.absdiff(reference, sample(current, landing))
    within = is_inside(landing, *reference.shape)
    return float(difference[within].mean()) if within.any() else 255.0


def unrelated_difference(gray: Array) -> float:
    """Mean absolute difference, grey levels, between views of different places of a pattern.

    Estimated from one image (h, w) and large shifts of itself, without slowly varying light and
    without marker dots.
    """
    image = gray.astype(np.float32)
    detail = image - cv2.GaussianBlur(image, (0, 0), LIGHT_SIGMA_PX)
    blobs = np.abs(cv2.GaussianBlur(detail, (0, 0), BLOB_SIGMA_PX))
    plain = blobs < BLOB_FACTOR * np.median(blobs)
    differences = []
    for shift in SHIFTS_PX:
        overlap = plain & np.roll(plain, shift, (0, 1))
        differences.append(np.abs(detail - np.roll(detail, shift, (0, 1)))[overlap].mean())
    return float(np.mean(differences))
