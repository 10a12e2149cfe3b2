"""Flow between two images by named method, and trackers whose reference is renewed.

Dense Optical Flow and Adaptive Reference, after Du et al. 2021: by the paper's text, and as its
group published it. Baselines for the anchored tracker.
"""

from __future__ import annotations

import time
from typing import Any

import cv2
import numpy as np

from deltact_fab.common import Array, InputError, did_you_mean

from ..compose import compose, is_inside, landing_px, sample, shrink
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

    name: one of NAMES; raises InputError for any other. Caches the prepared reference of `fused`,
    and the last flow: trackers that share a method compute it once. reused_s: CPU time that the
    last request saved.
    """

    NAMES = ("farneback", *_DIS_PRESETS, FUSED_METHOD)

    def __init__(self, name: str = FUSED_METHOD) -> None:
        if name not in self.NAMES:
            raise InputError(f"flow method {name!r}: unknown; {did_you_mean(name, self.NAMES)}")
        self.name, self.reused_s = name, 0.0
        self._dis = cv2.DISOpticalFlow.create(_DIS_PRESETS[name]) if name in _DIS_PRESETS else None
        self._prepared: tuple[Array, RefinementReference] | None = None
        self._last: tuple[list[bytes | None], Array, float] | None = None

    @staticmethod
    def prepare(image: Array) -> Array:
        """Convert an image (h, w[, 3]) for `between` as trackers do: blurred luma."""
        return Plane.from_image(image).gray

    def between(self, ref_gray: Array, cur_gray: Array, initial: Array | None = None) -> Array:
        """Compute the flow from the reference to the current image at the reference's pixels.

        ref_gray: must not change between calls. initial: (h, w, 2) px initial flow, None for a
        cold start. Returns (h, w, 2) float32 px, never the array passed as initial.
        """
        key = [None if a is None else a.tobytes() for a in (ref_gray, cur_gray, initial)]
        if self._last is not None and self._last[0] == key:
            _, flow, self.reused_s = self._last
            return flow
        start_s, self.reused_s = time.process_time(), 0.0
        # cv2 methods write into the initial array, and need it contiguous.
        start: Any = None if initial is None else np.array(initial, dtype=np.float32, order="C")
        if self.name == FUSED_METHOD:
            flow = self._fused(ref_gray, cur_gray, start)
        elif self._dis is not None:
            flow = self._dis.calc(ref_gray, cur_gray, start)
        else:
            flags = cv2.OPTFLOW_USE_INITIAL_FLOW if start is not None else 0
            flow = cv2.calcOpticalFlowFarneback(
                ref_gray, cur_gray, start, flags=flags, **_FARNEBACK_SETTINGS
            )
        self._last = key, flow, time.process_time() - start_s
        return flow

    def _fused(self, ref_gray: Array, cur_gray: Array, initial: Array | None) -> Array:
        if self._prepared is None or self._prepared[0] is not ref_gray:
            self._prepared = ref_gray, RefinementReference(Plane.from_image(ref_gray))
        start = None if initial is None else to_half(initial)
        refined = self._prepared[1].refine(Plane.from_image(cur_gray), start)
        return to_full(refined.flow_px, ref_gray.shape)


LIGHT_SIGMA_PX, BLOB_SIGMA_PX, BLOB_FACTOR = 24.0, 3.0, 3.0  # by hand: larger blobs leave dots in
SHIFTS_PX = tuple((60 + 7 * k, 200 - 11 * k) for k in range(16))
"""By hand: 16, as a periodic pattern of two colours may match itself under one shift."""


# As published: duyipai/Contact-Modelling-with-Gaussian-Density at 767ed98, src/tracker.py.
PUBLISHED_METHOD, COARSE_PX, RENEW_GREY, RETURN_GREY = "dis-medium", 20, 18.0, 12.0


class RenewedTracker:
    """Tracker of one sequence with a renewed reference: an image that differs from it too much
    becomes the reference. Flows start from the last one; after a renewal from nothing.

    total: "composed" F(x) = F_ref(x) + f(x + F_ref(x)); "summed" F_ref(x) + f(x), plain
    superposition; the paper's text allows both. Renewed where the image, warped back by its flow,
    differs by more than `share` of the difference of unrelated views (mean absolute, grey levels,
    at full size). "static" keeps the first image.

    "published": the rule of the paper's group, summed, on images of half the size. Renewed where
    the image, warped back by a flow on COARSE_PX x COARSE_PX pixels, differs by more than
    RENEW_GREY. Before, the newest of the older references that differ by less than RETURN_GREY is
    taken again, and later ones are dropped. The fine flow is the program's on a CPU; on a GPU it is
    Farneback with the defaults of OpenCV's CUDA version.

    first, judge: of the first image, to judge the total flow.
    """

    def __init__(
        self,
        method: FlowMethod,
        total: str,
        image: Array,
        first: RefinementReference,
        judge: ConfidenceEstimator,
        share: float,
    ) -> None:
        self._method, self._total, self._published = method, total, total == "published"
        self._first, self.judge = first, judge
        gray = self._view(image)
        self._threshold = RENEW_GREY if self._published else share * unrelated_difference(gray)
        zero = np.zeros((*gray.shape, 2), np.float32)
        # Grey image, flow to it, pixels inside it and all before.
        self._references = [(gray, zero, np.ones(gray.shape, bool))]
        self._relative: Array | None = None
        self._coarse: Array | None = None
        self._switches = 0

    def ahead(self, plane: Plane) -> None:
        """No-op: each flow starts from the last one."""

    def step(self, ready: PreparedImage) -> TrackedFrame:
        assert not isinstance(ready.image, SampledImage), "for the anchored reference only"
        gray = self._view(ready.image)
        self._choose_reference(gray)
        reference, base, inside = self._references[-1]
        relative = self._relative = self._method.between(reference, gray, self._relative)
        join = compose if self._total == "composed" and self._switches else np.add
        flow = join(base, relative)
        # Flow that left the image earlier is extrapolated from the border: excluded for good.
        inside = inside & is_inside(landing_px(flow), *flow.shape[:2])
        if self._total != "static" and self._error(reference, gray, relative) > self._threshold:
            self._references.append((gray, flow, inside))
            self._relative = self._coarse = None
            self._switches += 1
        nodes, full = (2 * flow, None) if self._published else (to_half(flow), flow)
        if self._published:
            h, w = ready.plane.shape
            inside = inside.repeat(2, axis=0).repeat(2, axis=1)[:h, :w]
        match = self._first.evaluate(ready.plane, nodes)
        valid, agreeing = self.judge.check(ready.secondary_match, match)
        confident = self.judge.supported(agreeing)
        enclosed, reused_s = self.judge.enclose(confident), self._method.reused_s
        return TrackedFrame(
            nodes, valid, enclosed, confident, full, inside, self._switches, reused_s
        )

    def _view(self, image: Array) -> Array:
        return shrink(to_gray(image), 2) if self._published else to_gray(image)

    def _choose_reference(self, gray: Array) -> None:
        """Drop older references, or go back to one of them."""
        if not self._published:
            del self._references[:-1]
        for k in reversed(range(len(self._references) - 1)):
            if coarse_difference(self._references[k][0], gray)[0] < RETURN_GREY:
                del self._references[k + 1 :]
                self._switches += 1
                break

    def _error(self, reference: Array, gray: Array, relative: Array) -> float:
        if not self._published:
            return photometric_error(reference, gray, relative)
        error, self._coarse = coarse_difference(reference, gray, self._coarse)
        return error


def coarse_difference(
    reference: Array, current: Array, start: Array | None = None
) -> tuple[float, Array]:
    """Mean absolute difference, grey levels, of coarse images after the coarse flow, and that flow.

    reference, current: (h, w) uint8, halved. start: a coarse flow.
    """
    size, initial = (COARSE_PX, COARSE_PX), None if start is None else start.copy()
    a, b = (cv2.resize(g, size, interpolation=cv2.INTER_CUBIC) for g in (reference, current))
    dis: Any = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST)
    flow = dis.calc(a, b, initial)
    x, y = cv2.split(landing_px(flow))
    warped = cv2.remap(b, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return float(cv2.absdiff(a, warped).mean()), flow


def photometric_error(reference: Array, current: Array, flow: Array) -> float:
    """Mean absolute difference, grey levels, of the reference and the current image warped back.

    Pixels that land outside the image are ignored; 255 if all do.
    """
    landing = landing_px(flow)
    within = is_inside(landing, *reference.shape)
    difference = cv2.absdiff(reference, sample(current, landing))[within]
    return float(difference.mean()) if difference.size else 255.0


def unrelated_difference(gray: Array) -> float:
    """Mean absolute difference, grey levels, between views of different places of a pattern.

    Estimated from one image (h, w) and large shifts of itself, without slowly varying light and
    without marker dots.
    """
    image = gray.astype(np.float32)
    detail = image - cv2.GaussianBlur(image, (0, 0), LIGHT_SIGMA_PX)
    blobs = np.abs(cv2.GaussianBlur(detail, (0, 0), BLOB_SIGMA_PX))
    plain = blobs < BLOB_FACTOR * np.median(blobs)
    shifted = (np.roll((detail, plain), shift, (1, 2)) for shift in SHIFTS_PX)
    return float(np.mean([np.abs(detail - d)[plain & (p > 0)].mean() for d, p in shifted]))
