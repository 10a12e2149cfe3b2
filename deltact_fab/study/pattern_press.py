"""The jobs of the pattern selection: a gel of a press, and the press under several patterns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ..analysis.tracking_error.follow import Follower, TrackingPlan
from ..errors import SensorError
from ..jobs import tell
from ..patterns.recipe import PatternRecipe
from ..protocols.plan import Protocol
from ..rig.config import VirtualConfig
from ..shapes import SensorDimensions
from ..virtual.presses import Presses, path_of
from .stream import PressStream, StreamTruth

# CPU seconds on one core, about, for the time that is announced beforehand.
GEOMETRY_S, PATTERN_S, PRINT_S, KNOT_S = 0.6, 0.34, 1.2, 10.0
FIGURES = ("mean_at_dots_mm", "mean_off_dots_mm", "coverage")
"""Columns of a job's table of frames."""


def given(
    protocol: Protocol,
    press: str,
    sensor: SensorDimensions,
    config: VirtualConfig,
    source: Path,
    patterns: dict[str, PatternRecipe],
    methods: Sequence[str],
    seed: int,
) -> dict[str, Any]:
    """All that `follow` needs and depends on, as plain data. patterns: by name."""
    dumped = protocol.model_dump(mode="json")
    lens = config.camera
    return {
        "protocol": dumped | {"channels": sorted(dumped["channels"])},
        "press": press,
        "sensor": {part: asdict(getattr(sensor, part)) for part in ("skin", "frame", "optics")},
        "rig": config.model_dump(mode="json"),
        "rig_file": None if lens is None else str(source.resolve()),
        "lens_file": None if lens is None else (source.parent / lens.model).read_text(),
        "patterns": {name: recipe.model_dump(mode="json") for name, recipe in patterns.items()},
        "methods": list(methods),
        "seed": seed,
    }


def cost_s(frames: int, patterns: int) -> float:
    """Seconds of one core that a job takes, about."""
    return frames * (GEOMETRY_S + patterns * PATTERN_S) + patterns * PRINT_S


def solve_gel(given: dict[str, Any]) -> dict[str, Any]:
    """The gel of a press into the store, where `follow` finds it; `given` without patterns.

    Raises SolverError where it cannot be solved.
    """
    sensor, protocol, config, _ = _read(given)
    presses = Presses(protocol, sensor.skin, config.virtual.gel)
    solver = presses.of(path_of(presses, given["press"])).solver
    solver.solve_all(lambda done, of, seconds: tell(done / of))
    return {"knots": len(solver.knots), "flags": solver.flags}


def follow(given: dict[str, Any]) -> dict[str, Any]:
    """Every frame of a press, its geometry and truth once, tracked under every pattern.

    Returns `tallies` (pattern -> method -> `Tally.plain`), `dots` and `left_out` by pattern,
    `frames`, `gel` (flags and interpolation), and arrays: `histogram|PATTERN|METHOD` and
    `rows|PATTERN|METHOD` (frames but the first, FIGURES), `steps` (their steps' ids).
    Raises SolverError where the gel cannot be solved or drawn.
    """
    import cv2

    cv2.setNumThreads(1)  # the other cores have jobs of their own
    sensor, protocol, config, source = _read(given)
    stream = PressStream(protocol, given["press"], sensor, config, source)
    truth, seed = StreamTruth(stream), given["seed"]
    printed = []
    for name, data in given["patterns"].items():
        recipe = PatternRecipe.model_validate(data)
        marks = stream.marks(recipe)
        scene = TrackingPlan(tuple(given["methods"]), bool(len(marks.dots_mm)), ())
        printed.append(
            (name, stream.picture(recipe, seed), stream.noise(seed), Follower(scene, marks), marks)
        )
    rows: dict[str, list[list[float]]] = {
        f"rows|{name}|{method}": [] for name in given["patterns"] for method in given["methods"]
    }
    lost: dict[str, list[str]] = {}
    count = len(stream.looks)
    for frame in stream.frames():
        for name, picture, noise, follower, marks in printed:
            if name in lost:
                continue
            image = stream.tracked(picture.expose(frame.at_px, noise))
            true = truth.of(frame, marks) if frame.number else None
            try:
                said = follower.take(image, true)
            except SensorError as why:  # a print that the camera cannot tell from grey
                lost[name] = [str(why)]
                continue
            for method, figures in said.items():
                line = [figures.get(key) for key in FIGURES]
                rows[f"rows|{name}|{method}"].append([np.nan if v is None else v for v in line])
        tell((frame.number + 1) / count)
    solver = stream.solver
    return {
        "frames": count,
        "steps": [look.step for look in stream.looks[1:]],
        "gel": {
            "flags": solver.flags,
            "between_mm": solver.between.displacement_mm,
            "knots": len(solver.knots),
        },
        "tallies": {
            name: {method: tally.plain() for method, tally in follower.tallies.items()}
            for name, _, _, follower, _ in printed
        },
        "dots": {
            name: follower.dots.tally.figures() if follower.dots else None
            for name, _, _, follower, _ in printed
        },
        "left_out": {
            name: lost.get(name, follower.left_out) for name, _, _, follower, _ in printed
        },
        **{key: np.asarray(lines, float).reshape(-1, len(FIGURES)) for key, lines in rows.items()},
        **{
            f"histogram|{name}|{method}": tally.histogram
            for name, _, _, follower, _ in printed
            for method, tally in follower.tallies.items()
        },
    }


def _read(
    given: dict[str, Any],
) -> tuple[SensorDimensions, Protocol, VirtualConfig, Path]:
    from pydantic import TypeAdapter

    return (
        TypeAdapter(SensorDimensions).validate_python(given["sensor"]),
        Protocol.model_validate(given["protocol"]),
        VirtualConfig.model_validate(given["rig"]),
        Path(given["rig_file"] or "rig.toml"),
    )
