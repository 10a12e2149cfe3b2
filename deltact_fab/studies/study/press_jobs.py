"""Jobs of single presses, in a temporary folder or as a stream.

Each press runs on the virtual rig and its record is analysed like any other; the images are
deleted, the results kept. Calibrations are passed as file texts, so that a job is self-contained.
Pattern studies track a press under several patterns.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from deltact_fab.bench import Protocol, RigSetup, VirtualConfig, open_run
from deltact_fab.common import SensorError
from deltact_fab.estimate import (
    Follower,
    TrackingPlan,
    calibrate_depth,
    measure_force_points,
    measure_press,
)
from deltact_fab.fabricate import PatternRecipe
from deltact_fab.sensor import SensorDimensions
from deltact_fab.simulate import VirtualKind, run_presses

from .stream import PressStream

if TYPE_CHECKING:
    from deltact_fab.bench import Run
    from deltact_fab.simulate import VirtualRig


@dataclass(frozen=True)
class PressJob:
    """Arguments of a job of a press on a virtual rig.

    press: as `sphere-10/p1`. recipe: of a recorded press. rig_file: base of the rig's paths. The
    job reads a camera file that it names again; camera, flat: content of that file, for the key.
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
    """Arguments of `force_points_job`. features: names of feature sets."""

    features: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class ShapeJob(PressJob):
    """Arguments of `shape_job`. depth, force: texts of calibration files."""

    depth: str
    force: str


@dataclass(frozen=True, kw_only=True)
class TrackingJob(PressJob):
    """Arguments of `track_press`.

    patterns: recipes by name, of any seed. seeds: of realisations of pattern, print and noise.
    method: of the tracker.
    """

    patterns: dict[str, PatternRecipe]
    seeds: tuple[int, ...]
    method: str


@contextmanager
def recorded_press(job: PressJob) -> Iterator[tuple[Run, dict[str, Any]]]:
    """Context of the finished run of a press, and its gel report. Raises RunFailed."""
    import cv2

    protocol, sensor, source = job.protocol, job.sensor, Path(job.rig_file)
    assert job.recipe is not None, "a press that is recorded"
    with TemporaryDirectory(prefix="deltact-fab-") as scratch:
        folder = Path(scratch) / protocol.name
        view = VirtualKind(job.rig, source).camera(protocol, sensor)
        setup = RigSetup(protocol, sensor, job.recipe, view, job.seed, folder)
        cv2.setNumThreads(1)  # one job per core
        bench = run_presses(setup, job.rig, source, [job.press])
        yield open_run(folder), gel_report(bench)


def gel_report(bench: VirtualRig) -> dict[str, Any]:
    """Report of the gel on the presses, plain data.

    cells_mm: of each mesh. coarse: largest cell size over that required by the tolerance. flags:
    ids. left_out: notes of the rig.
    """
    presses = bench.presses
    gel_presses = presses.open_presses
    flags = [flag.id for press in gel_presses for knot in press.solver.knots for flag in knot.flags]
    by_name = {path.press: path for path in presses.paths}
    choices = [presses.choice(by_name[press.name]) for press in gel_presses]
    return {
        "cells_mm": sorted({choice.spacing_mm for choice in choices}),
        "coarse": max((c.spacing_mm / c.goal_mm for c in choices if c.goal_mm), default=1.0),
        "flags": list(dict.fromkeys(flags)),
        "left_out": list(bench.omissions()),
    }


def force_points_job(job: ForcePointsJob) -> dict[str, Any]:
    """Measure `PressPoints` of a press for a force fit: "points", and the gel report.

    Raises RunFailed.
    """
    with recorded_press(job) as (run, gel):
        points = measure_force_points(run, job.protocol.name, job.press, job.features)
    return {"points": points, **gel}


def depth_calibration_job(job: PressJob) -> dict[str, Any]:
    """Calibrate depth by the press of a ball. Raises RunFailed."""
    with recorded_press(job) as (run, gel):
        calibration = calibrate_depth(run.folder)
        return {"toml": calibration.toml(), "line": calibration.line, **gel}


def shape_job(job: ShapeJob) -> dict[str, Any]:
    """Measure the `PressShape` of a press: "shape", and the gel report. Raises RunFailed."""
    with recorded_press(job) as (run, gel), TemporaryDirectory() as folder:
        depth, force = Path(folder, "depth.toml"), Path(folder, "force.toml")
        depth.write_text(job.depth, encoding="utf-8")
        force.write_text(job.force, encoding="utf-8")
        return {"shape": measure_press(run.folder, job.press, depth, force), **gel}


# By hand: CPU seconds on one core; too small promises too much. Geometry is that of deep presses.
GEOMETRY_COST_S, PATTERN_COST_S, PRINT_COST_S = 0.6, 0.1, 0.6
MAX_FOLLOWED = 17
"""By hand: each pattern takes some 95 MB; fewer share the geometry, most of a deep frame's cost."""
TRACKED_FIGURES = ("mean_at_dots_mm", "mean_off_dots_mm", "coverage")
"""Figures of `ErrorTally` that a press under a pattern is stored with."""


def cost_s(frames: int, patterns: int) -> float:
    """Estimated seconds of a job on one core."""
    return frames * (GEOMETRY_COST_S + patterns * PATTERN_COST_S) + patterns * PRINT_COST_S


def seed_groups(seeds: Sequence[int], patterns: int) -> list[tuple[int, ...]]:
    """Groups of seeds for jobs of so many patterns."""
    size = max(1, MAX_FOLLOWED // patterns)
    return [tuple(seeds[k : k + size]) for k in range(0, len(seeds), size)]


def track_press(job: TrackingJob) -> dict[str, Any]:
    """Track every frame of a press under every pattern and seed; geometry is computed once.

    Returns `figures`, TRACKED_FIGURES by seed and pattern; `refused`, lines on those that cannot be
    tracked; and the `flags` of the gel. Truth is computed only for patterns without dots. Raises
    SolverError if the gel cannot be solved or rendered.
    """
    import cv2

    cv2.setNumThreads(1)  # one job per core
    stream = PressStream(job.protocol, job.press, job.sensor, job.rig, Path(job.rig_file))
    printed, refused = {}, {}
    for seed in job.seeds:
        for name, recipe in job.patterns.items():
            seeded = recipe.model_copy(update={"seed": seed})
            marks = stream.marks(seeded)
            plan = TrackingPlan((job.method,), bool(len(marks.dots_mm)), ())
            picture = stream.picture(seeded, seed)
            printed[seed, name] = picture, stream.noise(seed), Follower(plan, marks)
    has_truth = any(follower.dots is None for _, _, follower in printed.values())
    for frame in stream.frames(has_truth=has_truth):
        for key, (picture, noise, follower) in printed.items():
            if key in refused:
                continue
            image = stream.tracker_image(picture.expose(frame.at_px, noise, frame.displacement_mm))
            try:
                follower.track(image, frame.true)
            except SensorError as error:  # the camera sees only grey
                refused[key] = str(error)
    figures: dict[int, dict[str, dict[str, float | None]]] = {seed: {} for seed in job.seeds}
    for (seed, name), (_, _, follower) in printed.items():
        tallied = follower.tallies[job.method].figures()
        figures[seed][name] = {key: tallied[key] for key in TRACKED_FIGURES}
        if follower.left_out:
            refused.setdefault((seed, name), follower.left_out[0])
    lines = [
        f"{name}, seed {seed}, {job.press}: {reason}" for (seed, name), reason in refused.items()
    ]
    return {"figures": figures, "refused": lines, "flags": stream.solver.flags}
