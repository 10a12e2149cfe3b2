"""Total flow through a sequence of images, with its confidence."""

from __future__ import annotations

import time

import cv2
import numpy as np

from deltact_fab.common import Array, InputError, SensorError, did_you_mean

from ..compose import denoise, fill_gaps, landing_px, sample, shrink
from .confidence import (
    DEVIATION_MAX_PX,
    TEXTURE_MIN,
    CheckedMatch,
    ConfidenceEstimator,
    FlowDiagnostics,
    FlowObservation,
    PreparedImage,
    TrackedFrame,
    landing_nodes,
)
from .fused import (
    COARSE_NODES,
    Plane,
    RefinedFlow,
    RefinementReference,
    SampledImage,
    predict,
    to_full,
)
from .renewed import FUSED_METHOD, PUBLISHED_METHOD, FlowMethod, RenewedTracker

TOO_DARK_GREY, TOO_BRIGHT_GREY = 25, 235  # by hand: no room for a pattern beyond them
LOST_SHARE = 0.1  # of textured nodes that agree; fewer: the reference is not in view; decision 0061
SEARCH_SHARE = 0.02  # of textured nodes; more lost at once are searched for; by hand
MAX_SEARCHES = 3  # images in a row in which a search finds nothing; by hand
MAX_ROUNDS = 6  # of a search from neighbours, which gains a window's half each; by hand
ROUND_SHARE = 0.002  # of textured nodes; a round that gains less is the last; by hand
LIKE_PX = 1.0  # of what observed neighbours predict; by hand: farther is another match


class AnchoredTracker:
    """Tracker of one sequence against its first image, of which reference and judge are made."""

    def __init__(self, reference: RefinementReference, judge: ConfidenceEstimator) -> None:
        self._reference = reference
        self.judge = judge
        self._previous = reference.plane
        self._flow: Array = np.zeros((*reference.plane.small.shape, 2), np.float32)
        self._last_seen = shrink(self._flow, COARSE_NODES)
        self._n_textured, self._n_agreeing = _count(judge.textured), 0
        self._n_searches, self._is_lost = 0, False

    def ahead(self, plane: Plane) -> Array:
        """Predict the flow in px from the previous image to this one, at coarse nodes."""
        previous, self._previous = self._previous, plane
        return shrink(predict(previous, plane), COARSE_NODES)

    def step(self, ready: PreparedImage) -> TrackedFrame:
        """Track one more image.

        Where much of the face is lost at once, it is searched for in this image and the next ones:
        from rest, from where each node was last seen, and from its neighbours.
        """
        assert ready.ahead_px is not None, "made by `ahead`"
        start = shrink(self._flow, COARSE_NODES)
        if not self._is_lost:
            landing = landing_px(start * np.float32(0.5 / COARSE_NODES))
            start += sample(ready.ahead_px, landing)
        checked = self._match(ready, start)
        least_change = SEARCH_SHARE * self._n_textured
        n_agreeing = _count(checked.agreeing)
        if n_agreeing < self._n_agreeing - least_change:
            self._n_searches = MAX_SEARCHES
        if self._n_searches or self._is_lost:
            checked = self._search(ready, checked)
            gained = _count(checked.agreeing) > n_agreeing + least_change
            self._n_searches = MAX_SEARCHES if gained else max(self._n_searches - 1, 0)
        match, valid, agreeing = checked
        confident, observed = self.judge.select(*checked)
        # Gaps are filled from agreeing nodes only: a valid but wrong match would spread.
        filled = fill_gaps(match.flow_px, agreeing, observed)
        flow = cv2.copyTo(match.flow_px, valid.view(np.uint8), filled)
        flow, rough_px2 = denoise(flow, match.deviation_px, valid)
        smooth = rough_px2 < DEVIATION_MAX_PX**2
        confident, observed = confident & smooth, observed & smooth
        self._is_lost = _count(agreeing) < LOST_SHARE * self._n_textured
        if not self._is_lost:
            self._flow, self._n_agreeing = flow, _count(agreeing)
            coarse = shrink(observed.astype(np.float32), COARSE_NODES) > 0.5
            self._last_seen[coarse] = shrink(flow, COARSE_NODES)[coarse]
        # A match that is not observed starts the next image, and is a result only if it is like
        # those that are.
        enclosed = self.judge.enclose(observed)
        near = cv2.inRange(flow - filled, (-LIKE_PX,) * 2, (LIKE_PX,) * 2).view(bool)
        flow = cv2.copyTo(flow, (near | ~enclosed).view(np.uint8), filled)
        return TrackedFrame(flow, valid & near, enclosed, confident)

    def _search(self, ready: PreparedImage, checked: CheckedMatch) -> CheckedMatch:
        """Search for the nodes that do not agree."""
        starts = [shrink(predict(self._reference.plane, ready.plane), COARSE_NODES)]
        if not self._is_lost:  # else tried: it is the last flow
            starts.append(self._last_seen)
        for start in starts:
            checked = self._add(checked, self._match(ready, start))
        for _ in range(MAX_ROUNDS):
            match, _, agreeing = checked
            n_agreeing = _count(agreeing)
            if n_agreeing < LOST_SHARE * self._n_textured:
                break
            supported = self.judge.supported(agreeing)
            start = shrink(fill_gaps(match.flow_px, supported, supported), COARSE_NODES)
            checked = self._add(checked, self._match(ready, start))
            if _count(checked.agreeing) - n_agreeing < ROUND_SHARE * self._n_textured:
                break
        return checked

    def _match(self, ready: PreparedImage, start: Array) -> CheckedMatch:
        """Refine from a start at coarse nodes, and check."""
        match = self._reference.refine(ready.plane, start)
        return CheckedMatch(match, *self.judge.check(ready.secondary_match, match))

    @staticmethod
    def _add(checked: CheckedMatch, extra: CheckedMatch) -> CheckedMatch:
        """Add the nodes that agree in the second only."""
        new = extra.agreeing & ~checked.agreeing
        parts = (
            cv2.copyTo(part, new.view(np.uint8), into)
            for into, part in zip(checked.match, extra.match, strict=True)
        )
        return CheckedMatch(RefinedFlow(*parts), checked.valid | new, checked.agreeing | new)


def _count(mask: Array) -> int:
    return int(np.count_nonzero(mask))


class FlowTracker:
    """Total flow through a sequence of images.

    name: PAPER, a method, or method/reference: "anchored" (`AnchoredTracker`, by `fused` only),
    "composed", "summed", "static" or, by `dis-medium` only, "published" (`RenewedTracker`); by
    default anchored for `fused` and composed for the others. renew_share: see `RenewedTracker`.
    full: False returns all arrays on the half grid (see `FlowObservation`). shared: methods by name
    of trackers of one sequence, to compute equal flows once. Raises InputError with valid names.
    """

    REFERENCES = ("anchored", "composed", "summed", "static", "published")
    PAPER = "paper"
    """Name of the tracker that the paper's group has published."""
    RENEW_SHARE = 0.25
    """By hand: share of the difference between unrelated views. The paper has a fixed threshold on
    a coarser flow, as the published tracker. By this one, on the flow itself, its order of patterns
    and nearly its figures come out; at 0.5 they do not (docs/evidence/study-methods.md)."""

    def __init__(
        self,
        name: str = FUSED_METHOD,
        *,
        full: bool = True,
        renew_share: float = RENEW_SHARE,
        shared: dict[str, FlowMethod] | None = None,
    ) -> None:
        current = f"{PUBLISHED_METHOD}/published" if name == self.PAPER else name
        method, _, reference = current.partition("/")
        if method not in FlowMethod.NAMES:
            valid = did_you_mean(method, (self.PAPER, *FlowMethod.NAMES))
            raise InputError(f"flow method {method!r}: unknown; {valid}")
        self.method = FlowMethod(method)
        if shared is not None:
            self.method = shared.setdefault(name.partition("/")[0], self.method)
        needed = {"anchored": FUSED_METHOD, "published": PUBLISHED_METHOD}
        available = [k for k in self.REFERENCES if needed.get(k, method) == method]
        self.reference = reference or available[0]
        if self.reference not in available:
            raise InputError(
                f"flow reference {reference!r} of {method!r}: not available; "
                f"{did_you_mean(reference, available)}"
            )
        self.full, self.renew_share = full, renew_share
        self._tracker: AnchoredTracker | RenewedTracker | None = None
        self._shape: tuple[int, ...] = ()
        self._frame = 0

    def update(self, image: Array) -> FlowObservation:
        """Track one more image: (h, w, 3) BGR or (h, w) grey, uint8, like the first one.

        Raises InputError for another type, size or number of channels, SensorError for a first
        image without texture.
        """
        ready = self.prepare(image)
        return self.judge(ready, self.follow(ready))

    # Three parts of an update. Each may run in its own thread if each takes the images in order;
    # later parts do not change what an earlier part needs of the previous image.

    def prepare(self, image: Array | SampledImage) -> PreparedImage:
        """First part of an update, independent of the previous flow. Raises as `update`.

        A SampledImage is for the anchored reference only, and then for the whole sequence.
        """
        start_s = time.process_time()
        plane = Plane.from_image(image)
        if self._tracker is None:
            self._tracker, self._shape = self._begin(image, plane), image.shape
            return PreparedImage(0, image, plane, [], None, start_s)
        if image.shape != self._shape:
            # Show height and width, unless only the channels differ.
            size = slice(0, 2 if image.ndim == len(self._shape) else 3)
            raise InputError(
                f"flow: the image is {image.shape[size]}, the first one was {self._shape[size]}"
            )
        self._frame += 1
        match, ahead = self._tracker.judge.secondary_match(image), self._tracker.ahead(plane)
        return PreparedImage(self._frame, image, plane, match, ahead, start_s)

    def follow(self, ready: PreparedImage) -> TrackedFrame:
        """Second part of an update, which needs the previous flow."""
        assert self._tracker is not None, "made ready"
        if ready.frame:
            return self._tracker.step(ready)
        textured = self._tracker.judge.textured
        nothing, everywhere = np.zeros((*textured.shape, 2), np.float32), np.ones_like(textured)
        return TrackedFrame(nothing, everywhere, everywhere, textured)

    def judge(self, ready: PreparedImage, frame: TrackedFrame) -> FlowObservation:
        """Third part of an update, which the next image does not need."""
        assert self._tracker is not None, "made ready"
        judge, shape, flow = self._tracker.judge, ready.plane.shape, frame.flow_px
        inside = judge.inside(landing_nodes(flow))
        confident, trusted = frame.confident, judge.is_trusted(frame.confident)
        state = judge.node_states(frame.matched, frame.enclosed & inside)
        if self.full:
            flow = to_full(flow, shape) if frame.full_px is None else frame.full_px
            visible = _to_pixels(inside, shape) if frame.inside is None else frame.inside
            state, confident = _to_pixels(state, shape), _to_pixels(confident, shape)
        else:
            visible = inside if frame.inside is None else frame.inside[::2, ::2]
        share = _count(confident & visible) / max(_count(visible), 1)
        for out in (flow, visible, confident, state):
            out.setflags(write=False)  # some are used for later frames
        cpu_ms = (time.process_time() - ready.start_s + frame.reused_s) * 1e3
        return FlowObservation(
            flow, visible, confident, state,
            FlowDiagnostics(ready.frame, frame.n_reference_switches, judge.textured_share, trusted,
                            share, cpu_ms),
        )  # fmt: skip

    def _begin(self, image: Array | SampledImage, plane: Plane) -> AnchoredTracker | RenewedTracker:
        judge = ConfidenceEstimator(image, plane)
        if not judge.textured.any():
            raise SensorError(
                "flow: the first image has no texture anywhere: its fine detail is "
                f"{judge.contrast:.1f} grey levels strong, {TEXTURE_MIN:g} are needed; "
                + _explain_plain(plane.gray)
            )
        first = RefinementReference(plane)
        if self.reference == "anchored":
            return AnchoredTracker(first, judge)
        assert not isinstance(image, SampledImage), "for the anchored reference only"
        return RenewedTracker(self.method, self.reference, image, first, judge, self.renew_share)


def _explain_plain(gray: Array) -> str:
    """Explain the lack of fine detail in an image (h, w) uint8."""
    dark, light = (float(np.percentile(gray, p)) for p in (5, 95))
    if light < TOO_DARK_GREY:
        return (
            f"it is dark (95 % of it below grey level {light:.0f}): is the light on, the lens open?"
        )
    if dark > TOO_BRIGHT_GREY:
        return f"it is overexposed (95 % of it above grey level {dark:.0f}): less light or exposure"
    return (
        f"its light is right (grey levels {dark:.0f} to {light:.0f}): the view is covered, far out "
        "of focus, or the skin has no pattern"
    )


def _to_pixels(nodes: Array, shape: tuple[int, int]) -> Array:
    """Expand a mask or state at nodes (hh, ww) to pixels (h, w), 2 x 2 per node."""
    # A byte times 257 is that byte twice: three times as quick as a resize.
    rows = (nodes.view(np.uint8) * np.uint16(257)).view(np.uint8)
    doubled = np.repeat(rows, 2, axis=0)
    return np.ascontiguousarray(doubled[: shape[0], : shape[1]]).view(nodes.dtype)
