"""Total flow with a reference that is renewed on the way (paper, after Du et al. 2021)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from ...aliases import Array
from ...errors import InputError
from ..compose import block_ncc, compose, inside, landing_px, sample
from .confidence import ConfidenceEstimator
from .fused import Plane, to_half
from .fused import RefinementReference as FirstImage
from .image import Sampled, to_gray
from .method import FlowMethod, PreparedReference
from .observation import PreparedImage, TrackedFrame

Sum = Literal["composed", "summed", "static"]
Renewal = Literal["adaptive", "every-frame", "photometric"]


@dataclass(frozen=True)
class RenewalRule:
    """When the reference is renewed.

    "adaptive": a block is bad when its NCC is below `ncc_min`. A frame is good while its share of
    bad blocks is at most `renew_share` above the least seen against the same reference: a lasting
    speck or reflection, up to half of trust_share, must not stop the renewal. When a frame is not
    good, the last good one is tried as the reference, and kept if it at least halves the share.
    Above `trust_share` a frame never becomes a reference; "every-frame" keeps to that, too.

    "photometric", the paper's: the current image, warped back, is compared with the reference,
    both at a quarter of the size with the flow taken there; when they differ by more than
    `photometric_max` grey levels (mean absolute), the current image is the reference from then on.
    The paper gives no threshold. On the smoke run, where nothing is hidden, 12 and more renew never
    (.0042 mm), 6 renews 11 times a press (.039 mm): so 12.
    """

    block_px: int = 32
    ncc_min: float = 0.7
    renew_share: float = 0.01
    trust_share: float = 0.25
    stride_px: int = 2
    photometric_max: float = 12.0

    def __post_init__(self) -> None:
        if not 0 < self.ncc_min < 1:
            raise InputError(f"0 < ncc_min < 1: {self.ncc_min} fails")
        if not 0 <= self.renew_share <= self.trust_share <= 1:
            raise InputError(
                "0 <= renew_share <= trust_share <= 1: "
                f"{self.renew_share}, {self.trust_share} fails"
            )
        if self.stride_px < 1 or self.block_px < 8 or self.block_px % self.stride_px:
            raise InputError(
                "block_px >= 8 and a multiple of stride_px: "
                f"{self.block_px}, {self.stride_px} fails"
            )
        if not self.photometric_max > 0:
            raise InputError(f"photometric_max > 0: {self.photometric_max} fails")


@dataclass(frozen=True)
class _Keyframe:
    frame: int
    gray: Array
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
    """

    def __init__(
        self,
        method: FlowMethod,
        total: Sum,
        renew: Renewal,
        rule: RenewalRule,
        image: Array,
        first: FirstImage,
        judge: ConfidenceEstimator,
    ) -> None:
        self._method, self._total, self._renew, self._rule = method, total, renew, rule
        self._first, self._judge = first, judge
        gray = to_gray(image)
        zero = np.zeros((*gray.shape, 2), np.float32)
        self._ref = self._good = self._keyframe(0, gray, zero, np.ones(gray.shape, bool))
        self._least = rule.trust_share / 2
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
            and match.off > self._rule.renew_share + self._least
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
            nodes,
            kept,
            agreeing,
            flow,
            stayed,
            match.against.frame,
            self._switches,
            n_flows,
        )

    def _settle(self, match: _Match, gray: Array, flow: Array, stayed: Array) -> None:
        """Choose the reference and the start of the next frame."""
        if self._renew == "photometric":
            self._relative = match.flow_px
            if match.off > self._rule.photometric_max and self._total != "static":
                self._renew_to(self._keyframe(self._frame, gray, flow, stayed))
            return
        if match.off > self._rule.trust_share:
            return  # a frame that matches nothing leaves reference and start as they were
        if match.against is not self._ref:
            self._renew_to(match.against)
        self._relative = match.flow_px
        self._least = min(self._least, match.off)
        if match.off <= self._rule.renew_share + self._least and self._total != "static":
            self._good = self._keyframe(self._frame, gray, flow, stayed)
            if self._renew == "every-frame":
                self._renew_to(self._good)

    def _keyframe(self, frame: int, gray: Array, flow: Array, stayed: Array) -> _Keyframe:
        return _Keyframe(frame, gray, self._method.prepare(gray), flow, stayed)

    def _renew_to(self, frame: _Keyframe) -> None:
        self._ref = self._good = frame
        self._relative = None
        self._least = self._rule.trust_share / 2
        self._switches += 1

    def _match(self, against: _Keyframe, gray: Array, start: Array | None) -> _Match:
        flow = against.prepared.to(gray, start)
        if self._renew == "photometric":
            return _Match(against, flow, photometric_error(against.gray, gray, flow))
        ncc = block_ncc(
            against.gray, gray, flow, block_px=self._rule.block_px, stride_px=self._rule.stride_px
        )
        return _Match(against, flow, _bad_share(ncc, self._rule.ncc_min))

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


def _bad_share(ncc: Array, ncc_min: float) -> float:
    """Share of the blocks with evidence that do not match; 1 when there is no evidence at all."""
    known = np.isfinite(ncc)
    return float(np.mean(ncc[known] < ncc_min)) if known.any() else 1.0
