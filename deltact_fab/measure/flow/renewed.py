"""Total flow with a reference that is renewed on the way (paper, after Du et al. 2021)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from ...aliases import Array
from ..compose import block_ncc, compose, inside, landing_px, sample
from .confidence import ConfidenceEstimator
from .fused import Plane, RefinementReference, to_half
from .image import Sampled, to_gray
from .method import FlowMethod, PreparedReference
from .observation import PreparedImage, TrackedFrame

Sum = Literal["composed", "summed", "static"]
Renewal = Literal["adaptive", "every-frame", "photometric"]


NCC_MIN = 0.7
RENEW_SHARE = 0.01
TRUST_SHARE = 0.25
PHOTOMETRIC_MAX = 12.0


@dataclass(frozen=True)
class _Keyframe:
    frame: int
    prepared: PreparedReference
    flow_px: Array
    stayed: Array


@dataclass(frozen=True)
class _Match:
    against: _Keyframe
    flow_px: Array
    off: float
    """Share of bad blocks, or the photometric error: what the rule in use looks at."""


class RenewedTracker:
    """Follows one sequence from its first image on.

    total: "composed" F(x) = F_ref(x) + f(x + F_ref(x)); "summed" F_ref(x) + f(x), the plain
    superposition of Du et al. 2021 (and of the paper's text); "static" keeps the first image.
    Each flow starts from the last one against the same reference; after a switch it starts cold.
    first, judge: of the first image, for what is said of the total.

    renew, when the reference is renewed. "adaptive": a block is bad when its NCC is below NCC_MIN.
    A frame is good while its share of bad blocks is at most RENEW_SHARE above the least seen
    against the same reference: a lasting speck or reflection, up to half of TRUST_SHARE, must not
    stop the renewal. When a frame is not good, the last good one is tried as the reference, and
    kept if it at least halves the share. Above TRUST_SHARE a frame never becomes a reference;
    "every-frame" keeps to that, too.

    "photometric", the paper's: the current image, warped back, is compared with the reference,
    both at a quarter of the size with the flow taken there; when they differ by more than
    PHOTOMETRIC_MAX grey levels (mean absolute), the current image is the reference from then on.
    The paper gives no threshold. On the smoke run, where nothing is hidden, 12 and more renew never
    (.0042 mm), 6 renews 11 times a press (.039 mm): so 12.
    """

    def __init__(
        self,
        method: FlowMethod,
        total: Sum,
        renew: Renewal,
        image: Array,
        first: RefinementReference,
        judge: ConfidenceEstimator,
    ) -> None:
        self._method, self._total, self._renew = method, total, renew
        self._first, self._judge = first, judge
        gray = to_gray(image)
        zero = np.zeros((*gray.shape, 2), np.float32)
        self._ref = self._good = self._keyframe(0, gray, zero, np.ones(gray.shape, bool))
        self._least = TRUST_SHARE / 2
        self._relative: Array | None = None
        self._frame = 0
        self._switches = 0

    def ahead(self, plane: Plane) -> None:
        """Nothing: each flow starts from the last one."""

    def step(self, ready: PreparedImage) -> TrackedFrame:
        """Follow one more image."""
        self._frame += 1
        assert not isinstance(ready.image, Sampled), "for the anchored reference only"
        gray = to_gray(ready.image)
        match, n_flows = self._match(self._ref, gray, self._relative), 1
        if (
            self._renew != "photometric"
            and self._good is not self._ref
            and match.off > RENEW_SHARE + self._least
        ):
            retry, n_flows = self._match(self._good, gray, None), 2
            if retry.off <= 0.5 * match.off:
                match = retry
        flow, stayed = self._sum(match)
        self._settle(match, gray, flow, stayed)
        nodes = to_half(flow)
        kept, agreeing = self._judge.look(
            ready.secondary_match, self._first.evaluate(ready.plane, nodes)
        )
        return TrackedFrame(
            nodes, kept, agreeing, flow, stayed, match.against.frame, self._switches, n_flows
        )

    def _settle(self, match: _Match, gray: Array, flow: Array, stayed: Array) -> None:
        """Choose the reference and the start of the next frame."""
        if self._renew == "photometric":
            self._relative = match.flow_px
            if match.off > PHOTOMETRIC_MAX and self._total != "static":
                self._renew_to(self._keyframe(self._frame, gray, flow, stayed))
            return
        if match.off > TRUST_SHARE:
            return  # a frame that matches nothing leaves reference and start as they were
        if match.against is not self._ref:
            self._renew_to(match.against)
        self._relative = match.flow_px
        self._least = min(self._least, match.off)
        if match.off <= RENEW_SHARE + self._least and self._total != "static":
            self._good = self._keyframe(self._frame, gray, flow, stayed)
            if self._renew == "every-frame":
                self._renew_to(self._good)

    def _keyframe(self, frame: int, gray: Array, flow: Array, stayed: Array) -> _Keyframe:
        return _Keyframe(frame, self._method.prepare(gray), flow, stayed)

    def _renew_to(self, frame: _Keyframe) -> None:
        self._ref = self._good = frame
        self._relative = None
        self._least = TRUST_SHARE / 2
        self._switches += 1

    def _match(self, against: _Keyframe, gray: Array, start: Array | None) -> _Match:
        flow = against.prepared.to(gray, start)
        if self._renew == "photometric":
            return _Match(against, flow, photometric_error(against.prepared.gray, gray, flow))
        return _Match(against, flow, _bad_share(block_ncc(against.prepared.gray, gray, flow)))

    def _sum(self, match: _Match) -> tuple[Array, Array]:
        ref = match.against
        if ref.frame == 0:
            total = match.flow_px
        elif self._total == "summed":
            total = ref.flow_px + match.flow_px
        else:
            total = compose(ref.flow_px, match.flow_px)
        # What left the image before the reference was continued from the border, so it stays out.
        return total, ref.stayed & inside(landing_px(total), *total.shape[:2])


def photometric_error(reference: Array, current: Array, flow: Array) -> float:
    """Mean absolute difference, grey levels, of the reference and the current image warped back.

    Both are taken at a quarter of their size, with the flow there; what lands outside is left out.
    """
    h, w = (s // 4 for s in reference.shape)

    def small(a: Array) -> Array:
        return cv2.resize(a[: 4 * h, : 4 * w], (w, h), interpolation=cv2.INTER_AREA)

    landing = landing_px(small(flow) / np.float32(4))
    off = cv2.absdiff(small(reference), sample(small(current), landing))
    within = inside(landing, h, w)
    return float(off[within].mean()) if within.any() else 255.0


def _bad_share(ncc: Array) -> float:
    """Share of the blocks with evidence that do not match; 1 when there is no evidence at all."""
    known = np.isfinite(ncc)
    return float(np.mean(ncc[known] < NCC_MIN)) if known.any() else 1.0
