"""One press of a run under several methods: a pure function of the run's folder."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import record
from ...errors import RunFailed, SensorError
from ...measure.flow import FlowObservation, FlowState, named_tracker
from .dots import DOTS, DotFrame, Dots, DotTally
from .scene import Scene
from .tally import MOVING_MM, Tally, confident_figures, largest, ratio
from .truth import TrueFrame, off_dots, sampled, seen_by

ARROW_STEP_PX = 26
COLUMNS = [
    "frame_id", "seq", "press", "indenter", "step_id", "method", "mean_at_dots_mm",
    "mean_off_dots_mm", "p95_off_dots_mm", "mean_confident_mm", "coverage",
    "confident_wrong_share", "n_moving_px", "peak_true_mm", "confident_share", "matched_share",
    "predicted_share", "lost_share", "trusted", "ms",
]  # fmt: skip
"""Of the table of frames; empty where a thing was left out."""


@dataclass(frozen=True)
class Job:
    """What one process does."""

    folder: str
    press: str
    scene: Scene


@dataclass
class PressResult:
    """Sums by method, rows of the table of frames, arrows by frame id, and what was left out."""

    tallies: dict[str, Tally]
    dots: DotTally = field(default_factory=DotTally)
    left_out: list[str] = field(default_factory=list)
    rows: list[dict[str, Any]] = field(default_factory=list)
    arrows: dict[str, NDArray[np.float32]] = field(default_factory=dict)


def analyse_press(job: Job) -> PressResult:
    """All frames of one press: the first one is the reference of flow and dots.

    Raises RunFailed for an image of another size, SensorError for a first one without a pattern;
    one in which only the dots are missing is analysed without them.
    """
    import cv2

    cv2.setNumThreads(1)  # one thread, so that milliseconds compare
    run = record.open(job.folder)
    camera, truth, scene = run.camera, run.truth(), job.scene
    scale = camera.mm_per_px
    dots = Dots(run) if scene.dots else None
    flows = {name: named_tracker(name) for name in scene.dense}
    off, in_view = off_dots(camera, run.dots_mm(), run.dot_diameter_mm()), seen_by(camera)
    tallies = {name: Tally() for name in scene.methods}
    result = PressResult(tallies)
    for at, row in enumerate(run.frames(job.press).itertuples()):
        frame_id = str(row.frame_id)
        image = run.image(str(row.file))
        if image.shape[:2] != off.shape:
            raise RunFailed(f"{row.file}: size {image.shape[1]} x {image.shape[0]} differs")
        seen = None
        try:
            seen = dots.follow(image) if dots else None
        except SensorError as why:
            if not flows:
                raise
            # The flow has its error against truth, and its own word, without them.
            result.left_out.append(f"error at the dots of {job.press}: {why}")
            dots = None
        frame = None
        if truth and flows and at:
            frame = TrueFrame.read(truth, frame_id, off, in_view, scale)
        said: dict[str, dict[str, Any]] = {}
        for name, flow in flows.items():
            observed = flow.update(image)
            if name == scene.methods[0]:
                half = ARROW_STEP_PX // 2
                arrows = observed.flow_px[half::ARROW_STEP_PX, half::ARROW_STEP_PX]
                result.arrows[frame_id] = arrows.copy()
            if at:
                said[name] = _take(tallies[name], observed, seen, frame, scale)
        if dots and seen and at:
            true_px = None
            if frame is not None:
                true_px = sampled(frame.flow_px, seen.first_px)
            elif truth is not None:
                true_px = dots.true_px(truth, frame_id)
            if true_px is not None:
                dots.take(seen, true_px)
            if DOTS in tallies:
                said[DOTS] = dots.as_method(tallies[DOTS], seen, true_px)
        # The reference compared with itself is no measurement, and said nothing.
        for name, figures in said.items():
            result.rows.append(
                {
                    "frame_id": row.frame_id,
                    "seq": row.seq,
                    "press": row.press,
                    "indenter": row.indenter,
                    "step_id": row.step_id,
                    "method": name,
                    **figures,
                }
            )
    if dots:
        result.dots = dots.tally
    return result


def _take(
    tally: Tally,
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
    tally: Tally, flow: NDArray[np.float32], dots: DotFrame, scale: float
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
    tally: Tally, observed: FlowObservation, frame: TrueFrame, scale: float
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
