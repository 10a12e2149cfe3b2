"""The jobs of the pattern selection: a press under several patterns, simulated or recorded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from .. import record
from ..analysis.tracking_error.follow import Follower, TrackingPlan, analyse_press, scene_of
from ..errors import SensorError
from ..jobs import tell
from ..patterns.recipe import recipe_from
from . import press_jobs
from .stream import PressStream

# CPU seconds on one core, about, for the time that is announced beforehand.
GEOMETRY_S, PATTERN_S, PRINT_S, KNOT_S = 0.2, 0.45, 1.2, 5.0
FIGURES = ("mean_at_dots_mm", "mean_off_dots_mm", "lost_share")
"""Columns of a job's table of frames."""


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
    seed, methods = given["seed"], given["methods"]
    printed, followers = {}, {}
    for name, data in given["patterns"].items():
        recipe = recipe_from(data, name)
        marks = stream.marks(recipe)
        printed[name] = stream.picture(recipe, seed), stream.noise(seed)
        followers[name] = Follower(
            TrackingPlan(tuple(methods), bool(len(marks.dots_mm)), (), timed=False), marks
        )
    rows: dict[str, dict[str, list[dict[str, Any]]]] = {
        name: {method: [] for method in methods} for name in printed
    }
    lost: dict[str, list[str]] = {}
    count = len(stream.looks)
    for frame in stream.frames():
        for name, (picture, noise) in printed.items():
            if name in lost:
                continue
            image = stream.tracked(picture.expose(frame.at_px, noise, frame.displacement_mm))
            try:
                said = followers[name].take(image, frame.true)
            except SensorError as why:  # a print that the camera cannot tell from grey
                lost[name] = [str(why)]
                continue
            for method, figures in said.items():
                rows[name][method].append(figures)
        tell((frame.number + 1) / count)
    found = {
        name: (
            one.tallies, rows[name], one.dots.tally.figures() if one.dots else None,
            lost.get(name, one.left_out),
        )
        for name, one in followers.items()
    }  # fmt: skip
    return {
        "frames": count,
        "gel": {"flags": stream.solver.flags},
        **packed([look.tip_mm for look in stream.looks[1:]], stream.path.at_mm, found),
    }


def packed(
    tips_mm: Sequence[Sequence[float]], at_mm: Sequence[float], found: Mapping[str, Any]
) -> dict[str, Any]:
    """A press as a grid keeps it, and `pattern_errors.cells_of` reads it.

    tips_mm (n, 3): at all frames but the first; at_mm: where the press is. found: by pattern its
    tallies, kept without times, and rows of figures by method, its dots' figures, and what was
    left out.
    """
    x, y, z = np.array(tips_mm, float).reshape(-1, 3).T
    path = np.column_stack((np.maximum(-z, 0.0), np.hypot(x - at_mm[0], y - at_mm[1])))
    cells = [
        {
            "pattern": name,
            "tallies": {method: replace(tally, ms=[]) for method, tally in tallies.items()},
            "rows": {
                method: np.array([[row.get(key) for key in FIGURES] for row in rows[method]], float)
                .reshape(-1, len(FIGURES))
                for method in tallies
            },
            "dots": dots,
            "left_out": left_out,
        }
        for name, (tallies, rows, dots, left_out) in found.items()
    ]  # fmt: skip
    return {"path": path, "cells": cells}


def follow_recorded(given: dict[str, Any]) -> dict[str, Any]:
    """One press of a run, as `follow` returns one of a simulated gel."""
    run, name = record.open(given["folder"]), given["name"]
    scene = scene_of(run, given["methods"])
    found = analyse_press(given["folder"], given["press"], scene)
    rows = {m: [row for row in found.rows if row["method"] == m] for m in given["methods"]}
    tips = run.frames(given["press"])[["x_mm", "y_mm", "z_mm"]].to_numpy(float)
    here = {name: (found.tallies, rows, found.dots.figures(), found.left_out)}
    return packed(tips[1:].tolist(), tips[0, :2].tolist(), here)
