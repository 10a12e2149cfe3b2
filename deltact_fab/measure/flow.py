"""Dense optical flow of the colour pattern, and its total from the first image on.

The paper (Dense Optical Flow and Adaptive Reference) uses Farneback's algorithm on a GPU, gives no
parameters, and adds an adaptive reference after Du et al. 2021. `FlowMethod` is one flow between
two images; `FlowTracker` keeps the reference and the bookkeeping.

Results of DIS depend on cv2's number of threads (it splits the image by thread): the caller fixes
it with cv2.setNumThreads, and records it where bytes must repeat.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, SensorError, did_you_mean
from .compose import block_ncc, blocks_to_pixels, compose, inside, landing_px, sample_mask

Array = NDArray[Any]
Reference = Literal["composed", "summed", "static"]
Renewal = Literal["adaptive", "every-frame"]

MIN_SIDE_PX = 64  # below it the pyramids of every method degenerate


@dataclass(frozen=True)
class FlowPreset:
    """One named method: what it is, and the library's own options."""

    about: str
    kind: Literal["farneback", "dis"]
    options: tuple[tuple[str, float], ...] = ()
    dis_preset: int = 0


# 5 levels and a window of 13 are the defaults of OpenCV's GPU version, which the paper cites; 3
# iterations (CPU default) instead of its 10 cost a third of the time.
FLOW_METHODS: dict[str, FlowPreset] = {
    "farneback": FlowPreset(
        "Farneback 2003 as in the paper: 5 levels, window 13, 3 iterations",
        "farneback",
        (
            ("pyr_scale", 0.5),
            ("levels", 5),
            ("winsize", 13),
            ("iterations", 3),
            ("poly_n", 5),
            ("poly_sigma", 1.1),
        ),
    ),
    "dis-ultrafast": FlowPreset(
        "Dense Inverse Search (Kroeger 2016), coarsest and quickest preset",
        "dis",
        dis_preset=cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST,
    ),
    "dis-fast": FlowPreset(
        "Dense Inverse Search, to half resolution",
        "dis",
        dis_preset=cv2.DISOPTICAL_FLOW_PRESET_FAST,
    ),
    "dis-medium": FlowPreset(
        "Dense Inverse Search, finer patches and refinement; the default",
        "dis",
        dis_preset=cv2.DISOPTICAL_FLOW_PRESET_MEDIUM,
    ),
}
DEFAULT_METHOD = "dis-medium"


class FlowMethod:
    """One way to find the flow between two grey images.

    name: a key of FLOW_METHODS. Raises InputError for any other.
    """

    def __init__(self, name: str = DEFAULT_METHOD) -> None:
        if name not in FLOW_METHODS:
            raise InputError(
                f"flow method {name!r}: unknown; {did_you_mean(str(name), FLOW_METHODS)}"
            )
        self.name = name
        self.preset = FLOW_METHODS[name]
        self._options: dict[str, Any] = dict(self.preset.options)
        self._dis = (
            cv2.DISOpticalFlow.create(self.preset.dis_preset) if self.preset.kind == "dis" else None
        )

    def between(self, ref_gray: Array, cur_gray: Array, initial: Array | None = None) -> Array:
        """Flow from the reference to the current image at the reference's pixels.

        ref_gray, cur_gray: (h, w) uint8; initial: (h, w, 2) px to start from, or None for a cold
        start. Returns (h, w, 2) float32 px, never the array given as initial. Raises InputError
        for shapes or types that do not fit.
        """
        for what, image in (("reference", ref_gray), ("current", cur_gray)):
            if image.ndim != 2 or image.dtype != np.uint8:
                raise InputError(
                    f"flow: the {what} image is {image.dtype} {image.shape}; "
                    "a grey image (h, w) of uint8 is needed"
                )
        if ref_gray.shape != cur_gray.shape:
            raise InputError(
                f"flow: the images are {ref_gray.shape} and {cur_gray.shape}; one size is needed"
            )
        if min(ref_gray.shape) < MIN_SIDE_PX:
            raise InputError(
                f"flow: the image is {ref_gray.shape}; sides of {MIN_SIDE_PX} px or more are needed"
            )
        start: Any = None
        if initial is not None:
            if initial.shape != (*ref_gray.shape, 2):
                raise InputError(
                    f"flow: the initial flow is {initial.shape}, not {(*ref_gray.shape, 2)}"
                )
            # Both methods write into the array they start from, and need it contiguous.
            start = np.array(initial, dtype=np.float32, order="C")
        if self._dis is not None:
            return self._dis.calc(ref_gray, cur_gray, start)
        flags = cv2.OPTFLOW_USE_INITIAL_FLOW if start is not None else 0
        return cv2.calcOpticalFlowFarneback(
            ref_gray,
            cur_gray,
            start,
            flags=flags,
            **self._options,
        )


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


def to_gray(image: Array) -> Array:
    """BGR (h, w, 3) or grey (h, w) uint8 to a contiguous grey (h, w) uint8 that is our own.

    Raises InputError for anything else.
    """
    if image.dtype == np.uint8 and image.ndim == 3 and image.shape[2] == 3:
        return cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    if image.dtype == np.uint8 and image.ndim == 2:
        # Kept across frames, while a camera may reuse its buffer.
        return np.array(image, order="C")
    raise InputError(
        f"image is {image.dtype} {image.shape}; (h, w, 3) BGR or (h, w) grey of uint8 is needed"
    )


def _bad_share(ncc: Array, ncc_min: float) -> float:
    """Share of the blocks with evidence that do not match; 1 when there is no evidence at all."""
    known = np.isfinite(ncc)
    return float(np.mean(ncc[known] < ncc_min)) if known.any() else 1.0
