"""One press of one pattern, image by image: followed by every method, compared with dots and truth.

Images and truth may come from a record, or be drawn on the spot and kept nowhere.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import record
from ...aliases import Points
from ...errors import InputError, SensorError
from ...measure.flow import FlowObservation, FlowState, named_tracker
from .dots import DOTS, DotFollower, DotFrame, Marks
from .tally import MOVING_MM, ErrorTally, confident_figures, largest, ratio
from .truth import TrueFrame, sampled

# The one to use, what it is compared with, and what the paper says.
DEFAULT_METHODS = (
    "fused",
    "dis-medium",
    "dis-medium/static",
    "dis-medium/composed-every",
    "dis-fast",
    "paper",
)
ONLY_DOTS = "dot-matrix"  # the law of patterns with nothing between the dots


@dataclass(frozen=True)
class TrackingPlan:
    """Which methods follow a run, whether its dots are followed, and a line a thing left out."""

    methods: tuple[str, ...]
    dots: bool
    left_out: tuple[str, ...]

    @property
    def dense(self) -> tuple[str, ...]:
        """The methods of dense flow among them."""
        return tuple(name for name in self.methods if name != DOTS)


def scene_of(run: record.Run, methods: Sequence[str] | None) -> TrackingPlan:
    """Of a run; methods: None for the default ones.

    Raises InputError for a method that is not known, or of dense flow where there are only dots.
    """
    for name in methods or ():
        named_tracker(name)
    n_dots = len(run.dots_mm())
    if run.pattern["recipe"]["law"] == ONLY_DOTS:
        if methods:
            raise InputError(
                f"{run.folder}: the pattern has only dots (law {ONLY_DOTS!r}) and nothing between "
                f"them that {methods[0]!r} could match; without --method the dots are followed"
            )
        return TrackingPlan((DOTS,), True, ("dense flow: the pattern has only dots to follow",))
    left_out = []
    asked = "dots" in run.meta["protocol"]["channels"]
    if not n_dots:
        left_out.append("error at the dots: the pattern has none")
    elif not asked:
        left_out.append("error at the dots: the channel 'dots' is not asked for")
    if run.truth() is None:
        left_out.append("error against truth: a real rig knows none")
    return TrackingPlan(tuple(methods or DEFAULT_METHODS), bool(n_dots and asked), tuple(left_out))


class Follower:
    """Counts the frames of a press; the first one is the reference of flow and dots.

    tallies: by method. dots: None where they are not followed. left_out: lines that say what could
    not be. flow_px: of the first method, after the last image, None before.
    """

    def __init__(self, scene: TrackingPlan, marks: Marks) -> None:
        self.tallies = {name: ErrorTally() for name in scene.methods}
        self.dots = DotFollower(marks) if scene.dots else None
        self.left_out: list[str] = []
        self.flow_px: NDArray[np.float32] | None = None
        self._first = scene.methods[0]
        self._flows = {name: named_tracker(name) for name in scene.dense}
        self._scale = marks.camera.mm_per_px
        self._begun = False

    def take(
        self,
        image: NDArray[np.uint8],
        frame: TrueFrame | None,
        dots_px: Callable[[], Points] | None = None,
    ) -> dict[str, dict[str, Any]]:
        """The next image, (h, w, 3) BGR; figures of a frame by method, none of the reference.

        frame: the truth where it is known and flow is asked for. dots_px: the true motion (n, 2) px
        of the dots one by one, of a pattern without flow. Raises SensorError for a first image
        without a pattern; one in which only the dots are missing is analysed without them.
        """
        at, self._begun = self._begun, True
        seen = None
        try:
            seen = self.dots.follow(image) if self.dots else None
        except SensorError as why:
            if not self._flows:
                raise
            # The flow has its error against truth, and its own word, without them.
            self.left_out.append(str(why))
            self.dots = None
        said: dict[str, dict[str, Any]] = {}
        for name, flow in self._flows.items():
            observed = flow.update(image)
            if name == self._first:
                self.flow_px = observed.flow_px
            if at:
                said[name] = _take(self.tallies[name], observed, seen, frame, self._scale)
        if self.dots and seen and at:
            true_px = None
            if frame is not None:
                true_px = sampled(frame.flow_px, seen.first_px)
            elif dots_px is not None:
                true_px = dots_px()
            if true_px is not None:
                self.dots.take(seen, true_px)
            if DOTS in self.tallies:
                said[DOTS] = self.dots.as_method(self.tallies[DOTS], seen, true_px)
        return said


def _take(
    tally: ErrorTally,
    observed: FlowObservation,
    dots: DotFrame | None,
    frame: TrueFrame | None,
    scale: float,
) -> dict[str, Any]:
    """Count one method's frame in; its row's figures."""
    last = observed.diagnostics
    tally.ms.append(last.cpu_ms)
    tally.bad_frames += not last.trusted
    tally.switches = last.n_reference_switches
    tally.believed.take(last.confident_share)
    counts = np.bincount(observed.state.ravel(), minlength=len(FlowState)) / observed.state.size
    shares = {state: float(counts[state]) for state in FlowState}
    tally.matched.take(shares[FlowState.MATCHED])
    tally.predicted.take(shares[FlowState.PREDICTED])
    tally.lost.take(shares[FlowState.LOST])
    figures: dict[str, Any] = {}
    if dots is not None:
        figures |= _at_dots(tally, observed.flow_px, dots, scale)
    if frame is not None:
        figures |= _against_truth(tally, observed, frame, scale)
    return {
        **figures,
        "confident_share": last.confident_share,
        "matched_share": shares[FlowState.MATCHED],
        "predicted_share": shares[FlowState.PREDICTED],
        "lost_share": shares[FlowState.LOST],
        "trusted": last.trusted,
        "ms": last.cpu_ms,
    }


def _at_dots(
    tally: ErrorTally, flow: NDArray[np.float32], dots: DotFrame, scale: float
) -> dict[str, Any]:
    """The paper's error: the flow at the dots against the dots."""
    found = dots.found
    moved_px = dots.moved_px[found]
    errors = np.linalg.norm(sampled(flow, dots.first_px[found]) - moved_px, axis=1) * scale
    moving = np.linalg.norm(moved_px, axis=1) * scale >= MOVING_MM
    tally.at_dots.take(errors)
    tally.at_moving_dots.take(errors[moving])
    return {"mean_at_dots_mm": ratio(float(errors.sum()), len(errors))}


def _against_truth(
    tally: ErrorTally, observed: FlowObservation, frame: TrueFrame, scale: float
) -> dict[str, Any]:
    flow = observed.flow_px
    errors = np.linalg.norm(flow - frame.flow_px, axis=-1) * scale
    moving = errors[frame.moving]
    sure = (observed.confident & observed.visible)[frame.moving]
    tally.take_moving(moving, sure)
    tally.still.take(errors[frame.still])
    in_plane = flow[frame.moving] * scale - frame.in_plane_mm[frame.moving]
    tally.in_plane.take(np.linalg.norm(in_plane, axis=-1))
    tally.peak_true_mm = largest(tally.peak_true_mm, frame.peak_mm)
    tally.peak_in_plane_mm = largest(tally.peak_in_plane_mm, frame.peak_in_plane_mm)
    return {
        "mean_off_dots_mm": ratio(float(moving.sum()), moving.size),
        "p95_off_dots_mm": float(np.percentile(moving, 95)) if moving.size else None,
        **confident_figures(moving[sure], moving.size),
        "n_moving_px": moving.size,
        "peak_true_mm": frame.peak_mm,
    }
