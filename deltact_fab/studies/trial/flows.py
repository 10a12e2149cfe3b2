"""Flows of presses on drawn sensors: tracked in rendered images, or true ones with measured noise.

The noise of a flow is what tracking images of other sensors gave beyond the true flow, at a stop of
the same kind and of nearly the same motion, moved to the place of the press.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from deltact_fab.bench import expand_protocol
from deltact_fab.common import Array
from deltact_fab.estimate import FaceFlow, FlowTracker
from deltact_fab.fabricate import PatternRecipe
from deltact_fab.sensor import axes_mm

from ..study.stream import FrameMoment, PressStream

SIMILAR_STOPS = 5  # by hand: enough to vary, few enough to be alike


@dataclass(frozen=True)
class StopNoise:
    """Noise of a tracked flow: kind and place of the stop, motion of the face, error (h, w, 2) mm.

    mask: (h, w), where the flow is known.
    """

    kind: str
    at_mm: tuple[float, float]
    motion_mm: float
    error_mm: Array
    mask: Array


def settled_stops(stream: PressStream) -> list[tuple[str, FrameMoment]]:
    """Settled moments of a press, with the kinds of their steps."""
    last = {moment.step: moment for moment in stream.moments}
    steps = [s for s in expand_protocol(stream.protocol) if s.press == stream.press and s.settled]
    return [(step.kind, last[step.id]) for step in steps]


def track_stops(
    stream: PressStream, recipe: PatternRecipe, seed: int
) -> list[tuple[FaceFlow, StopNoise | None]]:
    """Track a press in its images: the flow at each settled stop, and its noise if trusted."""
    cv2.setNumThreads(1)  # one job per core
    stops = {moment.step: (kind, moment) for kind, moment in settled_stops(stream)}
    picture, noise = stream.picture(recipe, seed), stream.noise(seed)
    tracker, out = FlowTracker(full=False), []
    for frame in stream.frames():
        image = stream.tracker_image(picture.expose(frame.at_px, noise, frame.displacement_mm))
        observed = tracker.update(image)
        kind, moment = stops.get(frame.moment.step, ("", None))
        if frame.moment is not moment:
            continue
        flow = FaceFlow.from_flow(observed, stream.view, FaceFlow.SPACING_PX)
        true_mm = true_shift_mm(stream, frame.moment)
        error = StopNoise(
            kind, stream.path.at_mm, _peak(true_mm), flow.shift_mm - true_mm, flow.known
        )  # fmt: skip
        out.append((flow, error if flow.trusted else None))
    return out


def draw_stops(
    stream: PressStream, pool: list[StopNoise], rng: np.random.Generator
) -> list[FaceFlow]:
    """Return true flows at the settled stops of a press, each with noise from a pool."""
    x_mm, y_mm = node_axes_mm(stream)
    flows = []
    for kind, moment in settled_stops(stream):
        true_mm = true_shift_mm(stream, moment)
        peak_mm = _peak(true_mm)
        similar = sorted(
            (noise for noise in pool if noise.kind == kind),
            key=lambda noise: abs(noise.motion_mm - peak_mm),
        )[:SIMILAR_STOPS]
        noise = similar[int(rng.integers(len(similar)))]
        nodes = [
            round((a - b) / float(axis[1] - axis[0]))
            for a, b, axis in zip(stream.path.at_mm, noise.at_mm, (x_mm, y_mm), strict=True)
        ][::-1]
        error_mm, mask = (
            np.roll(field, nodes, axis=(0, 1)) for field in (noise.error_mm, noise.mask)
        )
        flows.append(FaceFlow(true_mm + error_mm, mask, x_mm, y_mm))
    return flows


def node_axes_mm(stream: PressStream) -> tuple[Array, Array]:
    """Return the points of a `FaceFlow` along x and y."""
    n = FaceFlow.SPACING_PX
    x, y = (
        axis[len(axis) % n // 2 :][: len(axis) // n * n].reshape(-1, n).mean(axis=1)
        for axis in axes_mm(stream.view)
    )
    return x, y


def true_shift_mm(stream: PressStream, moment: FrameMoment) -> Array:
    """Return the true shift (h, w, 2) float32 at the points of a `FaceFlow`."""
    u_mm, n = stream.displacement_mm(moment), FaceFlow.SPACING_PX
    h, w = stream.view.height_px, stream.view.width_px
    if u_mm is None:
        return np.zeros((h // n, w // n, 2), np.float32)
    rows, columns = (slice(side % n // 2, side % n // 2 + side // n * n) for side in (h, w))
    flow = stream.face.motion(u_mm)[0][rows, columns].astype(np.float32)
    mean = cv2.resize(flow, (w // n, h // n), interpolation=cv2.INTER_AREA)
    return np.asarray(mean * np.float32(stream.view.mm_per_px))


def _peak(shift_mm: Array) -> float:
    return float(np.hypot(shift_mm[..., 0], shift_mm[..., 1]).max())
