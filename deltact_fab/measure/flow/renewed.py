"""Total flow through a sequence, its reference renewed (paper, after Du et al. 2021)."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError, SensorError, did_you_mean
from ..compose import block_ncc, blocks_to_pixels, compose, inside, landing_px, sample_mask
from .image import to_gray
from .method import DEFAULT_METHOD, MIN_SIDE_PX, FlowMethod
from .observation import FlowDiagnostics, FlowObservation

Array = NDArray[Any]
Reference = Literal["composed", "summed", "static"]
Renewal = Literal["adaptive", "every-frame"]


@dataclass(frozen=True)
class RenewalRule:
    """When the reference is renewed and when a frame is believed.

    A block is bad when its NCC is below `ncc_min`. A frame is good while its share of bad blocks is
    at most `renew_share` above the least seen against the same reference: a lasting speck or
    reflection, up to half of trust_share, must not stop the renewal. When a frame is not good, the
    last good one is tried as the reference, and kept if it at least halves the share. Above
    `trust_share` the frame is flagged, and never becomes a reference.

    With `calibrate`, the first frame after the reference (a small motion, by protocol) may lower
    `ncc_min` to `calibrated_part` of its median NCC, never below `ncc_floor`: a pattern of low
    contrast has its NCC limited by camera noise. Unrelated images stay well below the floor.
    """

    block_px: int = 32
    ncc_min: float = 0.7
    renew_share: float = 0.01
    trust_share: float = 0.25
    stride_px: int = 2
    calibrate: bool = True
    calibrated_part: float = 0.8
    ncc_floor: float = 0.5

    def __post_init__(self) -> None:
        if not 0 < self.ncc_floor <= self.ncc_min < 1:
            raise InputError(
                f"0 < ncc_floor <= ncc_min < 1: {self.ncc_floor}, {self.ncc_min} fails"
            )
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


@dataclass(frozen=True)
class _Keyframe:
    frame: int
    gray: Array
    flow_px: Array
    visible: Array
    confident: Array


@dataclass(frozen=True)
class _Match:
    against: _Keyframe
    flow_px: Array
    ncc: Array
    bad_share: float


class FlowTracker:
    """Total flow through a sequence of images, with a reference that is renewed.

    reference: "composed" F(x) = F_ref(x) + f(x + F_ref(x)); "summed" F_ref(x) + f(x), the plain
    superposition of Du et al. 2021 (and of the paper's text); "static" keeps the first image.
    renew: "adaptive" by the rule, or "every-frame" (each good frame is the next reference).
    warm: start each flow from the last one against the same reference; after a switch the start is
    cold. Raises InputError for unknown names.
    """

    def __init__(
        self,
        method: FlowMethod | str = DEFAULT_METHOD,
        reference: Reference = "composed",
        renew: Renewal = "adaptive",
        warm: bool = True,
        rule: RenewalRule | None = None,
    ) -> None:
        for what, word, known in (
            ("reference", reference, get_args(Reference)),
            ("renew", renew, get_args(Renewal)),
        ):
            if word not in known:
                raise InputError(f"flow {what} {word!r}: unknown; {did_you_mean(str(word), known)}")
        self.method = FlowMethod(method) if isinstance(method, str) else method
        self.reference = reference
        self.renew = renew
        self.warm = warm
        self.rule = rule or RenewalRule()
        self.reset()

    def reset(self) -> None:
        """Forget everything: the next image is the first."""
        self._first: _Keyframe | None = None
        self._ref: _Keyframe | None = None
        self._good: _Keyframe | None = None
        self._least = self.rule.trust_share / 2
        self._relative: Array | None = None
        self._ncc_min = self.rule.ncc_min
        self._calibrated = not self.rule.calibrate
        self._frame = -1
        self._switches = 0

    def update(self, image: Array) -> FlowObservation:
        """Follow one more image: (h, w, 3) BGR or (h, w) grey, uint8, of the first image's size.

        Raises InputError for another type or size, SensorError for a first image without texture.
        """
        start_s = time.process_time()
        gray = to_gray(image)
        self._frame += 1
        if not (self._first and self._ref and self._good):
            return self._begin(gray, start_s)
        if gray.shape != self._first.gray.shape:
            self._frame -= 1
            raise InputError(
                f"flow: the image is {gray.shape}, the first one was {self._first.gray.shape}"
            )
        rule = self.rule
        match = self._match(self._ref, gray, self._relative if self.warm else None)
        n_flows = 1
        if not self._calibrated:
            match = self._calibrate(match)
        if (
            self.reference != "static"
            and self._good is not self._ref
            and match.bad_share > rule.renew_share + self._least
        ):
            retry = self._match(self._good, gray, None)
            n_flows = 2
            if retry.bad_share <= 0.5 * match.bad_share:
                match = retry
        total, visible, confident = self._total(match)
        for shared in (total, visible, confident):
            shared.setflags(write=False)  # they may become the reference's
        trusted = match.bad_share <= rule.trust_share
        if trusted:
            # A frame that is not believed leaves reference and warm start as they were.
            if match.against is not self._ref:
                self._renew_to(match.against)
            self._relative = match.flow_px
            self._least = min(self._least, match.bad_share)
            if match.bad_share <= rule.renew_share + self._least:
                self._good = _Keyframe(self._frame, gray, total, visible, confident)
                if self.renew == "every-frame" and self.reference != "static":
                    self._renew_to(self._good)
        return FlowObservation(
            total,
            visible,
            confident,
            match.ncc,
            FlowDiagnostics(
                frame=self._frame,
                reference_frame=match.against.frame,
                n_reference_switches=self._switches,
                n_flows=n_flows,
                bad_share=match.bad_share,
                ncc_min=self._ncc_min,
                trusted=trusted,
                confident_share=float(np.mean(confident[visible])) if visible.any() else 0.0,
                cpu_ms=(time.process_time() - start_s) * 1e3,
            ),
        )

    def _renew_to(self, frame: _Keyframe) -> None:
        self._ref = frame
        self._relative = None
        self._least = self.rule.trust_share / 2
        self._switches += 1

    def _begin(self, gray: Array, start_s: float) -> FlowObservation:
        h, w = gray.shape
        if min(h, w) < MIN_SIDE_PX:
            self._frame -= 1
            raise InputError(
                f"flow: the image is {gray.shape}; sides of {MIN_SIDE_PX} px or more are needed"
            )
        zero = np.zeros((h, w, 2), np.float32)
        ncc = block_ncc(
            gray, gray, zero, block_px=self.rule.block_px, stride_px=self.rule.stride_px
        )
        if not np.isfinite(ncc).any():
            self.reset()
            raise SensorError(
                "flow: no block of the first image has texture (a standard deviation of 4 grey "
                "levels or more): covered, dark, out of focus, or no pattern"
            )
        confident = blocks_to_pixels(np.isfinite(ncc), (h, w), self.rule.block_px)
        first = _Keyframe(0, gray, zero, np.ones((h, w), bool), confident)
        self._first = self._ref = self._good = first
        return FlowObservation(
            zero.copy(),
            first.visible.copy(),
            confident.copy(),
            ncc,
            FlowDiagnostics(
                frame=0,
                reference_frame=0,
                n_reference_switches=0,
                n_flows=0,
                bad_share=0.0,
                ncc_min=self._ncc_min,
                trusted=True,
                confident_share=float(confident.mean()),
                cpu_ms=(time.process_time() - start_s) * 1e3,
            ),
        )

    def _match(self, against: _Keyframe, gray: Array, initial: Array | None) -> _Match:
        flow = self.method.between(against.gray, gray, initial)
        ncc = block_ncc(
            against.gray, gray, flow, block_px=self.rule.block_px, stride_px=self.rule.stride_px
        )
        return _Match(against, flow, ncc, _bad_share(ncc, self._ncc_min))

    def _calibrate(self, match: _Match) -> _Match:
        known = match.ncc[np.isfinite(match.ncc)]
        typical = float(np.median(known)) if known.size else 0.0
        if typical <= self.rule.ncc_floor:
            return match  # an unrelated image says nothing about the pattern
        lowered = max(self.rule.ncc_floor, self.rule.calibrated_part * typical)
        self._ncc_min = min(self.rule.ncc_min, lowered)
        self._calibrated = True
        return replace(match, bad_share=_bad_share(match.ncc, self._ncc_min))

    def _total(self, match: _Match) -> tuple[Array, Array, Array]:
        ref = match.against
        good = blocks_to_pixels(match.ncc >= self._ncc_min, ref.gray.shape, self.rule.block_px)
        if ref.frame == 0:
            total = match.flow_px.copy()
        else:
            good = ref.confident & sample_mask(good, landing_px(ref.flow_px))
            if self.reference == "summed":
                total = ref.flow_px + match.flow_px
            else:
                total = compose(ref.flow_px, match.flow_px)
        # What left the image before the reference was continued from the border, so it stays out.
        return total, ref.visible & inside(landing_px(total), *total.shape[:2]), good


def _bad_share(ncc: Array, ncc_min: float) -> float:
    """Share of the blocks with evidence that do not match; 1 when there is no evidence at all."""
    known = np.isfinite(ncc)
    return float(np.mean(ncc[known] < ncc_min)) if known.any() else 1.0
