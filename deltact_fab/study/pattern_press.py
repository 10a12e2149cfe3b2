"""The jobs of the pattern selection: a gel of a press, and the press under several patterns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..analysis.tracking_error.follow import Follower, TrackingPlan
from ..errors import SensorError
from ..jobs import tell
from ..patterns.recipe import recipe_from
from . import press_jobs
from .stream import PressStream, StreamTruth

# CPU seconds on one core, about, for the time that is announced beforehand.
GEOMETRY_S, PATTERN_S, PRINT_S, KNOT_S = 0.2, 0.45, 1.2, 5.0


def cost_s(frames: int, patterns: int) -> float:
    """Seconds of one core that a job takes, about."""
    return frames * (GEOMETRY_S + patterns * PATTERN_S) + patterns * PRINT_S


def follow(given: dict[str, Any]) -> dict[str, Any]:
    """Every frame of a press, its geometry and truth once, tracked under every pattern.

    given: as `press_jobs.given`, with press, patterns (recipes by name), methods and seed. Returns
    what `packed` does, `frames`, and `gel` (its flags). Raises SolverError where the gel cannot be
    solved or drawn.
    """
    import cv2

    cv2.setNumThreads(1)  # the other cores have jobs of their own
    protocol, sensor, config, source = press_jobs.read(given)
    stream = PressStream(protocol, given["press"], sensor, config, source)
    truth, seed, methods = StreamTruth(stream), given["seed"], given["methods"]
    printed, followers = {}, {}
    for name, data in given["patterns"].items():
        recipe = recipe_from(data, name)
        marks = stream.marks(recipe)
        printed[name] = stream.picture(recipe, seed), stream.noise(seed), marks
        followers[name] = Follower(
            TrackingPlan(tuple(methods), bool(len(marks.dots_mm)), (), timed=False), marks
        )
    lost: dict[str, list[str]] = {}
    count = len(stream.looks)
    for frame in stream.frames():
        for name, (picture, noise, marks) in printed.items():
            if name in lost:
                continue
            image = stream.tracked(picture.expose(frame.at_px, noise, frame.displacement_mm))
            true = truth.of(frame, marks) if frame.number else None
            try:
                followers[name].take(image, true)
            except SensorError as why:  # a print that the camera cannot tell from grey
                lost[name] = [str(why)]
        tell((frame.number + 1) / count)
    found = {
        name: (
            one.tallies, one.dots.tally.figures() if one.dots else None,
            lost.get(name, one.left_out),
        )
        for name, one in followers.items()
    }  # fmt: skip
    return {
        "frames": count,
        "gel": {"flags": stream.solver.flags},
        **packed(found),
    }


def packed(found: Mapping[str, Any]) -> dict[str, Any]:
    """A press as a grid keeps it, and `pattern_errors.cells_of` reads it.

    found: by pattern its tallies by method, its dots' figures, and what was left out.
    """
    value: dict[str, Any] = {"tallies": {}, "dots": {}, "left_out": {}}
    for name, (tallies, dots, left_out) in found.items():
        value["tallies"][name] = {method: tally.plain() for method, tally in tallies.items()}
        value["dots"][name], value["left_out"][name] = dots, left_out
        for method, tally in tallies.items():
            value[f"histogram|{name}|{method}"] = tally.histogram
    return value
