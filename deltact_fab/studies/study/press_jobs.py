"""Presses inside a pure job: in a folder removed at the end, or as a stream.

Each is carried out on the virtual rig as a run has it, and its record analysed as any other; then
the images go, and what was found in them stays. Calibrations come as the text of their files, so
that a job depends on nothing of its caller. The pattern selection's are followed under several
patterns, simulated or recorded.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from deltact_fab.bench import Protocol, RigSetup, VirtualConfig, open_run
from deltact_fab.common import Field, SensorError
from deltact_fab.estimate import (
    Follower,
    TrackingPlan,
    analyse_press,
    calibrate_depth,
    measure_force_points,
    measure_press,
)
from deltact_fab.fabricate import PatternRecipe
from deltact_fab.sensor import SensorDimensions
from deltact_fab.simulate import VirtualKind, run_presses

from .pattern_errors import PressErrors
from .stream import PressStream

if TYPE_CHECKING:
    from deltact_fab.bench import Run
    from deltact_fab.estimate import ErrorTally
    from deltact_fab.simulate import VirtualRig


@dataclass(frozen=True)
class PressJob:
    """A press on a virtual rig; its jobs depend on nothing else of their caller.

    press: as `sphere-10/p1`. recipe: of a press that is recorded. rig_file: from which the paths in
    it count. Where it names the file of a camera, that is read again by the job, from the same
    place; camera, flat: what is in it.
    """

    protocol: Protocol
    sensor: SensorDimensions
    rig: VirtualConfig
    press: str
    seed: int
    recipe: PatternRecipe | None = None
    rig_file: str = "rig.toml"
    camera: dict[str, Any] | None = None
    flat: str | None = None


@dataclass(frozen=True, kw_only=True)
class ForcePointsJob(PressJob):
    """Forces and features of a press. features: names of feature sets."""

    features: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class ShapeJob(PressJob):
    """The shape that is found under a press. depth, force: texts of calibrations."""

    depth: str
    force: str


@dataclass(frozen=True, kw_only=True)
class TrackingJob(PressJob):
    """A press tracked under several patterns: recipes by name."""

    patterns: dict[str, PatternRecipe]
    methods: tuple[str, ...]


@dataclass(frozen=True)
class RecordedTrackingJob:
    """A recorded press tracked. content: digest of what is read of the run."""

    folder: str
    press: str
    indenter: str
    pattern: str
    methods: tuple[str, ...]
    content: str


@contextmanager
def carried_out(job: PressJob) -> Iterator[tuple[Run, dict[str, Any]]]:
    """The finished run of a press, until the end of the block, and what the gel reports of it.

    Raises RunFailed.
    """
    import cv2

    protocol, sensor, source = job.protocol, job.sensor, Path(job.rig_file)
    assert job.recipe is not None, "a press that is recorded"
    with TemporaryDirectory(prefix="deltact-fab-") as scratch:
        folder = Path(scratch) / protocol.name
        view = VirtualKind(job.rig, source).camera(protocol, sensor)
        setup = RigSetup(protocol, sensor, job.recipe, view, job.seed, folder)
        cv2.setNumThreads(1)  # a processor has a job of its own
        bench = run_presses(setup, job.rig, source, [job.press])
        yield open_run(folder), gel_report(bench)


def gel_report(bench: VirtualRig) -> dict[str, Any]:
    """What the gel reports of a press, plain data.

    cells_mm: of each mesh. coarse: cells over those that the tolerance requires, the worst. flags:
    ids. left_out: by the rig.
    """
    presses = bench.presses
    opened = presses.opened
    flags = [flag.id for press in opened for knot in press.solver.knots for flag in knot.flags]
    by_name = {path.press: path for path in presses.paths}
    choices = [presses.choice(by_name[press.name]) for press in opened]
    return {
        "cells_mm": sorted({choice.spacing_mm for choice in choices}),
        "coarse": max((c.spacing_mm / c.asked_mm for c in choices if c.asked_mm), default=1.0),
        "flags": list(dict.fromkeys(flags)),
        "left_out": list(bench.omissions()),
    }


def force_points_job(job: ForcePointsJob) -> dict[str, Any]:
    """The `PressPoints` of a press, for a fit of forces, as "points", and what its gel reports.

    Raises RunFailed.
    """
    with carried_out(job) as (run, gel):
        points = measure_force_points(run, job.protocol.name, job.press, job.features)
    return {"points": points, **gel}


def depth_calibration_job(job: PressJob) -> dict[str, Any]:
    """A calibration of depth by the press of a ball. Raises RunFailed."""
    with carried_out(job) as (run, gel):
        calibration = calibrate_depth(run.folder)
        return {"toml": calibration.toml(), "line": calibration.line, **gel}


def shape_job(job: ShapeJob) -> dict[str, Any]:
    """The `PressShape` of a press as "shape", and what its gel reports. Raises RunFailed."""
    with carried_out(job) as (run, gel), TemporaryDirectory() as folder:
        depth, force = Path(folder, "depth.toml"), Path(folder, "force.toml")
        depth.write_text(job.depth, encoding="utf-8")
        force.write_text(job.force, encoding="utf-8")
        return {"shape": measure_press(run.folder, job.press, depth, force), **gel}


# CPU seconds on one core, about, for the time that is announced beforehand.
GEOMETRY_S, PATTERN_S, PRINT_S = 0.2, 0.45, 1.2
FIGURES = ("mean_at_dots_mm", "mean_off_dots_mm", "lost_share")
"""Columns of a job's table of frames."""


def cost_s(frames: int, patterns: int) -> float:
    """Seconds of one core that a job takes, about."""
    return frames * (GEOMETRY_S + patterns * PATTERN_S) + patterns * PRINT_S


def follow(job: TrackingJob) -> dict[str, Any]:
    """Every frame of a press, its geometry and truth once, tracked under every pattern.

    Returns `cells` (`PressErrors`, one a pattern), `frames`, and `gel` (its flags). Raises
    SolverError where the gel cannot be solved or drawn.
    """
    import cv2

    cv2.setNumThreads(1)  # the other cores have jobs of their own
    stream = PressStream(job.protocol, job.press, job.sensor, job.rig, Path(job.rig_file))
    printed, followers = {}, {}
    for name, recipe in job.patterns.items():
        marks = stream.marks(recipe)
        printed[name] = stream.picture(recipe, job.seed), stream.noise(job.seed)
        plan = TrackingPlan(job.methods, bool(len(marks.dots_mm)), (), timed=False)
        followers[name] = Follower(plan, marks)
    rows: dict[str, dict[str, list[dict[str, Any]]]] = {
        name: {method: [] for method in job.methods} for name in printed
    }
    lost: dict[str, list[str]] = {}
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
    tips_mm = np.array([look.tip_mm for look in stream.looks])
    cells = [
        errors_of(
            job.press, stream.path.indenter, tips_mm, stream.path.at_mm, name, one.tallies,
            rows[name], one.dots.tally.figures() if one.dots else None,
            lost.get(name, one.left_out),
        )
        for name, one in followers.items()
    ]  # fmt: skip
    return {"cells": cells, "frames": len(stream.looks), "gel": {"flags": stream.solver.flags}}


def errors_of(
    press: str, indenter: str, tips_mm: Field, at_mm: Sequence[float], pattern: str,
    tallies: Mapping[str, ErrorTally], rows: Mapping[str, Sequence[Mapping[str, Any]]],
    dots: dict[str, Any] | None, left_out: Sequence[str],
) -> PressErrors:  # fmt: skip
    """The errors of a press under a pattern as a grid keeps them: FIGURES of frames, no times.

    tips_mm (n + 1, 3): at all frames, of which the first is the reference; at_mm: of the press.
    """
    x, y, z = tips_mm[1:].T
    path = np.column_stack((np.maximum(-z, 0.0), np.hypot(x - at_mm[0], y - at_mm[1])))
    sums = {method: replace(tally, ms=[]) for method, tally in tallies.items()}
    figures = {m: [[row.get(key) for key in FIGURES] for row in rows[m]] for m in tallies}
    arrays = {m: np.array(part, float).reshape(-1, len(FIGURES)) for m, part in figures.items()}
    return PressErrors(pattern, press, indenter, sums, arrays, path, dots, tuple(left_out))


def follow_recorded(job: RecordedTrackingJob) -> dict[str, Any]:
    """One press of a run, as `follow` returns one of a simulated gel."""
    run = open_run(job.folder)
    tracked = analyse_press(job.folder, job.press, TrackingPlan.of(run, job.methods))
    rows = {m: [row for row in tracked.rows if row["method"] == m] for m in job.methods}
    tips_mm = run.frames(job.press)[["x_mm", "y_mm", "z_mm"]].to_numpy(float)
    cell = errors_of(
        job.press, job.indenter, tips_mm, tips_mm[0, :2].tolist(), job.pattern, tracked.tallies,
        rows, tracked.dots.figures(), tracked.left_out,
    )  # fmt: skip
    return {"cells": [cell]}
