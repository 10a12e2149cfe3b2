"""Tracking of runs and presses by every method, compared with dots and truth.

Images and truth may come from a record, or be rendered on the fly without being stored. The presses
of a run are analysed in parallel.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from deltact_fab.bench import Run, open_run
from deltact_fab.common import InputError, Progress, RunFailed, SensorError, run_each

from ...measure.flow.confidence import FlowObservation, FlowState
from ...measure.flow.renewed import FUSED_METHOD, FlowMethod
from ...measure.flow.tracker import FlowTracker
from ..runs import read_frames
from .result import TrackingResult
from .tally import (
    DOTS_METHOD,
    DotFollower,
    DotTally,
    ErrorTally,
    PatternDots,
    TrueFrame,
    off_dots,
    sample_flow,
)

DEFAULT_METHODS = (FUSED_METHOD, FlowTracker.PAPER)
"""The recommended tracker, and the paper's beside it."""


@dataclass(frozen=True)
class TrackingPlan:
    """Plan of an analysis: which methods follow a run, and whether its dots are followed.

    left_out: one line per comparison that is not possible.
    """

    DOTS_ONLY_LAW: ClassVar = "dot-matrix"
    """The law of patterns with nothing between the dots."""

    methods: tuple[str, ...]
    dots: bool
    left_out: tuple[str, ...]

    @classmethod
    def for_run(cls, run: Run, methods: Sequence[str] | None) -> TrackingPlan:
        """Plan the analysis of a run; methods: None for the default ones, names of 0.3 are read.

        Raises InputError for an unknown method, or a dense one for a pattern of dots only.
        """
        methods = list(dict.fromkeys(map(_current_name, methods or ())))
        for name in methods:
            FlowTracker(name)
        n_dots = len(run.dots_mm())
        if run.pattern["recipe"]["law"] == cls.DOTS_ONLY_LAW:
            if methods:
                raise InputError(
                    f"{run.folder}: the pattern has only dots (law {cls.DOTS_ONLY_LAW!r}) and no "
                    f"texture between them for {methods[0]!r} to match; omit --method to track "
                    "the dots"
                )
            return cls((DOTS_METHOD,), True, ("dense flow: the pattern has only dots",))
        left_out = []
        requested = "dots" in run.meta["protocol"]["channels"]
        if not n_dots:
            left_out.append("error at the dots: the pattern has none")
        elif not requested:
            left_out.append("error at the dots: no channel 'dots' in the protocol")
        if run.truth() is None:
            left_out.append("error against truth: not available on a real rig")
        return cls(tuple(methods or DEFAULT_METHODS), bool(n_dots and requested), tuple(left_out))


def _current_name(name: str) -> str:
    """Name of a method, given that or the one of 0.3, of which it warns."""
    method, slash, reference = name.partition("/")
    if method != "farneback-paper" and (method != FlowTracker.PAPER or not slash):
        return name
    current = f"farneback{slash}{reference}"
    warnings.warn(f"method {name!r} is now {current!r}; the old name goes in 0.5", FutureWarning, 2)
    return current


class Follower:
    """Tracker of a press by all methods; the first frame is the reference of flow and dots.

    tallies: by method. dots: None where they are not tracked. left_out: one line per failure.
    """

    def __init__(self, plan: TrackingPlan, marks: PatternDots) -> None:
        self.tallies = {name: ErrorTally() for name in plan.methods}
        self.dots = DotFollower(marks) if plan.dots else None
        self.left_out: list[str] = []
        shared: dict[str, FlowMethod] = {}
        names = [name for name in plan.methods if name != DOTS_METHOD]
        self._flows = {name: FlowTracker(name, shared=shared) for name in names}
        self._scale = marks.camera.mm_per_px
        self._off_dots = off_dots(marks.camera, marks.dots_mm, marks.diameter_mm)
        self._has_reference = False

    def track(self, image: NDArray[np.uint8], frame: TrueFrame | None) -> dict[str, dict[str, Any]]:
        """Track the next image, (h, w, 3) BGR; return its figures by method, none of the reference.

        frame: the truth where it is known. Raises SensorError for a first image without a pattern;
        one in which only the dots are missing is analysed without them.
        """
        compared, self._has_reference = self._has_reference, True
        # Moving pixels that lie on no dot, as dots are no part of the pattern.
        frame = frame and replace(frame, moving=frame.moving & self._off_dots)
        dots = None
        try:
            dots = self.dots.follow(image) if self.dots else None
        except SensorError as error:
            if not self._flows:
                raise
            # The flow still has its error against truth, and its confidence.
            self.left_out.append(str(error))
            self.dots = None
        tallies: dict[str, ErrorTally] = {}
        for name, flow in self._flows.items():
            observed = flow.update(image)
            if compared:
                tally = tallies[name] = _tally_frame(observed, frame, self._scale)
                tally.switches -= self.tallies[name].switches
                if self.dots and dots:
                    errors, moving = self.dots.flow_errors(observed.flow_px, dots)
                    tally.at_dots.add(errors)
                    tally.at_moving_dots.add(errors[moving])
        if self.dots and dots and compared:
            true_px = None
            if frame is not None:
                first_px = self.dots.tracker.first_px
                at_px = np.where(np.isfinite(first_px), first_px, self.dots.rest_px)
                true_px = sample_flow(frame.flow_px, at_px)
                self.dots.add_frame(dots, true_px)
            if DOTS_METHOD in self.tallies:
                tallies[DOTS_METHOD] = self.dots.as_method(dots, true_px)
        for name, tally in tallies.items():
            self.tallies[name].join(tally)
        return {name: tally.figures() for name, tally in tallies.items()}


def _tally_frame(observed: FlowObservation, frame: TrueFrame | None, scale: float) -> ErrorTally:
    """Tally a frame of one method: its confidence and its errors against truth. scale: mm/px."""
    flow, last = observed.flow_px, observed.diagnostics
    tally = ErrorTally.for_frame(last.confident_share, last.trusted, last.cpu_ms)
    tally.switches = last.n_reference_switches
    tally.lost_share.add(float((observed.state == FlowState.LOST).mean()))
    if frame is not None:
        index = np.flatnonzero(frame.moving)
        found_px, true_px, in_plane_mm = (
            vectors.reshape(-1, 2).take(index, axis=0)
            for vectors in (flow, frame.flow_px, frame.in_plane_mm)
        )
        confident = (observed.confident & observed.visible).ravel()[index]
        tally.add_moving(np.hypot(*(found_px - true_px).T) * scale, confident)
        tally.in_plane.add(np.hypot(*(found_px * scale - in_plane_mm).T))
        tally.peak_true_mm = frame.peak_mm
    return tally


FRAME_COLUMNS = ("frame_id", "seq", "press", "indenter", "step_id")
TRACKING_COLUMNS = [*FRAME_COLUMNS, "method", *ErrorTally().figures()]
"""Columns of the table of frames; empty where a figure is not available."""


@dataclass
class PressResult:
    """Tallies by method, rows of the table of frames, and lines on what was left out."""

    tallies: dict[str, ErrorTally]
    dots: DotTally = field(default_factory=DotTally)
    left_out: list[str] = field(default_factory=list)
    rows: list[dict[str, Any]] = field(default_factory=list)


def analyse_press(folder: str, press: str, plan: TrackingPlan) -> PressResult:
    """Analyse all frames of one press: the first one is the reference of flow and dots.

    Raises RunFailed for an image of another size, SensorError for a first one without a pattern;
    one in which only the dots are missing is analysed without them.
    """
    import cv2

    cv2.setNumThreads(1)  # one thread, so that milliseconds compare
    run = open_run(folder)
    camera, truth = run.camera, run.truth()
    follower = Follower(plan, PatternDots.from_record(camera, run.pattern))
    in_view = TrueFrame.imaged_pixels(camera)
    result = PressResult(follower.tallies)
    for index, row in enumerate(run.frames(press).itertuples()):
        image = run.image(str(row.file))
        if image.shape[:2] != in_view.shape:
            raise RunFailed(f"{row.file}: size {image.shape[1]} x {image.shape[0]} differs")
        frame = None
        if truth and index:
            motion = truth.flow_and_in_plane(str(row.frame_id))
            frame = TrueFrame.from_flow(*motion, in_view, camera.mm_per_px)
        frame_of = {key: getattr(row, key) for key in FRAME_COLUMNS}
        # The reference has no figures: comparing it with itself is no measurement.
        for name, figures in follower.track(image, frame).items():
            result.rows.append({**frame_of, "method": name, **figures})
    result.left_out += [f"error at the dots of {press}: {reason}" for reason in follower.left_out]
    if follower.dots:
        result.dots = follower.dots.tally
    return result


def analyse_tracking(
    folder: str | Path,
    methods: Sequence[str] | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> TrackingResult:
    """Analyse the tracking error of every method over a whole run.

    methods: None for the default ones, or the dots where a pattern has nothing else. Errors that
    the run does not allow (no dots, no truth) are listed in left_out. Raises InputError for an
    unknown method, a run without images or an unfinished one.
    """
    run = open_run(folder)
    frames = read_frames(run, "tracking")
    plan = TrackingPlan.for_run(run, methods)
    indenter_of = dict(zip(frames["press"], frames["indenter"], strict=True))
    presses = list(indenter_of)
    results = run_each(
        partial(analyse_press, str(folder), plan=plan), presses, presses, executor, progress
    )
    total = {name: ErrorTally() for name in plan.methods}
    parts: dict[tuple[str, str], ErrorTally] = {}
    dots = DotTally()
    for part, indenter in zip(results, indenter_of.values(), strict=True):
        for name, tally in part.tallies.items():
            total[name].join(tally)
            parts.setdefault((name, indenter), ErrorTally()).join(tally)
        dots.join(part.dots)
    rows = [row for part in results for row in part.rows]
    return TrackingResult(
        methods=[{"name": name, **tally.figures()} for name, tally in total.items()],
        by_indenter=[
            {"name": name, "indenter": indenter, **tally.figures()}
            for (name, indenter), tally in parts.items()
        ],
        dots=dots.figures() if dots.n_found + dots.n_lost else None,
        left_out=[*plan.left_out, *(line for part in results for line in part.left_out)],
        frames=pd.DataFrame(rows, columns=TRACKING_COLUMNS),
        mm_per_px=run.camera.mm_per_px,
        simulated=run.simulated,
        seed=int(run.meta["seed"]),
    )
