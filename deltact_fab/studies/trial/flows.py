"""Flows of a press on drawn sensors: tracked in rendered images, or true ones with their noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from deltact_fab.bench import expand_protocol
from deltact_fab.common import Array
from deltact_fab.estimate import FaceFlow, FlowTracker
from deltact_fab.fabricate import PatternRecipe

from ..study.stream import FrameMoment, PressStream


def settled_stops(stream: PressStream) -> dict[FrameMoment, str]:
    """Settled moments of a press, with the kinds of their steps."""
    last = {moment.step: moment for moment in stream.moments}
    steps = [s for s in expand_protocol(stream.protocol) if s.press == stream.press and s.settled]
    return {last[step.id]: step.kind for step in steps}


def track_stops(stream: PressStream, recipe: PatternRecipe, seed: int) -> list[FaceFlow]:
    """Track a press in its images: the flow at each settled stop."""
    cv2.setNumThreads(1)  # one job per core
    stops, flows, tracker = settled_stops(stream), [], FlowTracker(full=False)
    picture, noise = stream.picture(recipe, seed), stream.noise(seed)
    for frame in stream.frames(has_truth=False):
        image = stream.tracker_image(picture.expose(frame.at_px, noise, frame.displacement_mm))
        observed = tracker.update(image)
        if frame.moment in stops:
            flows.append(FaceFlow.from_flow(observed, stream.view, FaceFlow.SPACING_PX))
    return flows


def true_shifts_mm(stream: PressStream) -> list[Array]:
    """Return the true shift (h, w, 2) float32 at the points of a `FaceFlow`, at settled stops."""
    n, view = FaceFlow.SPACING_PX, stream.view
    y, x = (
        side % n // 2 + n * np.arange(side // n) + (n - 1) / 2
        for side in (view.height_px, view.width_px)
    )
    nodes_px = np.stack(np.meshgrid(x, y), axis=-1)
    rest_mm, shifts = stream.face.rest_mm(nodes_px).reshape(-1, 2), []
    for moment in settled_stops(stream):
        u_mm, shift_mm = stream.displacement_mm(moment), np.zeros(nodes_px.shape)
        if u_mm is not None:
            shift_mm += view.mm_per_px * stream.face.points_px(u_mm, rest_mm).reshape(
                shift_mm.shape
            )
        shifts.append(shift_mm.astype(np.float32))
    return shifts


def add_noise(
    shifts_mm: Sequence[Array], tracked: Sequence[FaceFlow], tracked_mm: Sequence[Array]
) -> list[FaceFlow]:
    """Add to true shifts what tracking images of another sensor gave beyond its own.

    It is of the same press, so a bias of the tracker is in it as well.
    """
    return [
        replace(flow, shift_mm=mm + flow.shift_mm - flow_mm)
        for mm, flow, flow_mm in zip(shifts_mm, tracked, tracked_mm, strict=True)
    ]
