"""What the measurement does on this machine: `python -m benchmarks.measure_rate` prints JSON.

Images a second, latency, CPU, error and coverage.

It measures the frames of a shipped press and shear through the fisheye: runs of the virtual rig,
kept in the user's cache folder, one a pattern. The gel is solved once for both: its store finds the
solution again.
"""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Sequence
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np

from deltact_fab.bench.record.run import Run, open_run
from deltact_fab.common import cache, catalog, digest
from deltact_fab.common.aliases import Array, Progress
from deltact_fab.estimate.analysis.force.dataset import gather_data
from deltact_fab.estimate.analysis.force.judge import fit_force
from deltact_fab.estimate.analysis.runs import view_of_run
from deltact_fab.estimate.analysis.shape.ball import calibrate_depth
from deltact_fab.estimate.analysis.tracking_error.tally import TrueFrame
from deltact_fab.estimate.measure.flow.confidence import FlowState
from deltact_fab.estimate.measure.flow.fused import to_full
from deltact_fab.estimate.measure.pipeline.measurement import Measurement, Pipeline
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment
from deltact_fab.studies.numerics.harness import describe_machine

FRAMES = 300
TIMED = 150  # of them, the press and two drags of the four
JUDGED = 10  # every so many frames the flow is held against the truth
PACED_HZ = 60.0
PROTOCOL, RIG = "deep-drag", "fisheye"
RATE_HZ = 3.0  # enough frames of the shipped protocol
PATTERNS = {"0.15/0.1": (0.15, 0.1), "0.075/0.6": (0.075, 0.6)}
DRAWN_BY = (
    "simulate.virtual.drawing",
    "simulate.virtual.presses",
    "physics.imaging",
    "fabricate.patterns.raster",
)
# case: outputs, goal in images a second
CASES: dict[str, tuple[tuple[str, ...], float]] = {
    "everything": (("flow", "shape", "contacts", "force", "traction"), 60.0),
    "force": (("force",), 75.0),
    "track": (("flow",), 90.0),
}
AGE_MS, IN_TIME = 35.0, 0.95
"""The goal of the latency: a share of the results of a camera of PACED_HZ is complete so soon."""
PARTS = ("prepare", "follow", "finish")  # of `Measurement.steps`
_FORCE = "inverse-placed"
_BLAS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def run_benchmark(
    patterns: Sequence[str] = tuple(PATTERNS),
    frames: int = FRAMES,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Every case on every pattern, as plain data.

    The first run draws the frames, which takes minutes; they are simulated and kept in the user's
    cache folder. They lie in memory, so no decoding is counted; rectification is. hz: TIMED frames
    as fast as they go. latency_ms: from an image's time until its result is complete, paced at
    PACED_HZ, the newest image first. cpu_ms: of the process, an image; by_part_ms: of each part,
    which run side by side, alone: what hz falls short of is lost between them. Goals are those of
    two idle cores. mean_error_mm: over all moving visible pixels; coverage: share of them whose
    motion is known, as the `cover` of a result counts it; confident: share that the tracker is
    confident of. Raises as `experiment.run` does.
    """
    import cv2

    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        found: dict[str, Any] = {"about": _about(frames), "load_average": {"before": _load()}}
        for pattern in patterns:
            found[pattern] = _pattern(_drawn(pattern, progress), frames)
        found["load_average"]["after"] = _load()
    finally:
        cv2.setNumThreads(before)
    return found


def _pattern(run: Run, frames: int) -> dict[str, Any]:
    view = view_of_run(run)
    raw = [run.raw(file) for file in run.frames()["file"].iloc[:frames]]
    # By these frames themselves: for their time, not for their error.
    force, depth = (
        fit_force(gather_data([run], [_FORCE]), _FORCE),
        calibrate_depth(run.folder).model,
    )
    judged, rows = _judged(run, raw), {}
    for case, (outputs, goal_hz) in CASES.items():
        measurement = Measurement(view, outputs, [force, depth])
        rows[case] = {
            "by_part_ms": _by_part_ms(measurement, raw[: TIMED // 3]),  # first: it compiles
            **_rate(measurement, raw[:TIMED]),
            "goal_hz": goal_hz,
            **_latency(measurement, raw[:TIMED]),
            **judged,
        }
    return rows


def _by_part_ms(measurement: Measurement, raw: list[Array]) -> dict[str, float]:
    """CPU time an image of each part that the pipeline runs side by side, one after another."""
    for image in raw[:2]:
        measurement.update(image)
    measurement.reset()
    taken_s = dict.fromkeys(PARTS, 0.0)
    for image in raw:
        job = measurement.job(image)
        for part, step in zip(PARTS, measurement.steps(), strict=True):
            start_s = time.thread_time()
            step(job)
            taken_s[part] += time.thread_time() - start_s
    return {part: s / len(raw) * 1e3 for part, s in taken_s.items()}


def _rate(measurement: Measurement, raw: list[Array]) -> dict[str, float]:
    measurement.reset()
    with Pipeline(measurement) as pipeline:
        start_s, start_cpu_s = time.perf_counter(), time.process_time()
        for image in raw:
            pipeline.submit(image)
        pipeline.close()
        n = sum(1 for _ in pipeline.results())
        taken_s, cpu_s = time.perf_counter() - start_s, time.process_time() - start_cpu_s
    return {"hz": n / taken_s, "cpu_ms": cpu_s / n * 1e3}


def _latency(measurement: Measurement, raw: list[Array]) -> dict[str, Any]:
    measurement.reset()
    with Pipeline(measurement, "newest") as pipeline:
        camera = Thread(target=_paced, args=(pipeline, raw), daemon=True)
        camera.start()
        ages_ms = [result.age_ms for result in pipeline.results() if result.frame > 0]
        camera.join()
        dropped = pipeline.dropped
    p50, p95 = np.percentile(ages_ms, (50, 95)).tolist()
    return {
        "latency_ms": {"p50": p50, "p95": p95},
        "in_time": float(np.mean(np.array(ages_ms) < AGE_MS)),
        "goal_in_time": IN_TIME,
        "paced_hz": PACED_HZ,
        "dropped": dropped,
    }


def _paced(pipeline: Pipeline, raw: list[Array]) -> None:
    start_s = time.monotonic()
    for k, image in enumerate(raw):
        due_s = start_s + k / PACED_HZ
        time.sleep(max(0.0, due_s - time.monotonic()))
        pipeline.submit(image, due_s)
    pipeline.close()


def _judged(run: Run, images: list[Array]) -> dict[str, float]:
    measurement = Measurement(run.camera, ("observation",))
    truth, ids, in_view = run.truth(), run.frames()["frame_id"], TrueFrame.imaged_pixels(run.camera)
    assert truth is not None, "the virtual rig writes it"
    parts: list[Array] = []  # (3, n) at the moving pixels: error in mm, whether known, confident
    peaks_mm = [0.0]
    for k, raw in enumerate(images):
        seen = measurement.update(raw).observation
        assert seen is not None, "it was asked for"
        if k == 0 or k % JUDGED:
            continue
        motion = truth.flow_and_in_plane(ids[k])
        true = TrueFrame.from_flow(*motion, in_view, run.camera.mm_per_px)
        h, w = true.moving.shape
        off_px = np.linalg.norm(to_full(seen.flow_px, (h, w)) - true.flow_px, axis=-1)
        known, confident = (
            np.kron(mask, np.ones((2, 2), bool))[:h, :w]
            for mask in ((seen.state > FlowState.LOST) & seen.visible, seen.confident)
        )
        figures = (off_px * run.camera.mm_per_px, known, confident)
        parts.append(np.stack([part[true.moving] for part in figures]).astype(float))
        peaks_mm.append(true.peak_mm or 0.0)
    error_mm, coverage, sure = np.concatenate(parts, axis=1).mean(axis=1).tolist()
    return {
        "mean_error_mm": error_mm,
        "coverage": coverage,
        "confident": sure,
        "true_motion_mm": max(peaks_mm),
    }


def _drawn(pattern: str, progress: Progress | None) -> Run:
    """The run on a pattern of PATTERNS, made if the cache folder has none."""
    home = cache.cache_folder() / "benchmark"
    name = pattern.replace("/", "-")
    folder = home / f"{name}-{digest.code_digest(*DRAWN_BY)}"
    folder.parent.mkdir(parents=True, exist_ok=True)
    for old in home.glob(f"{name}-*"):
        if old != folder and old.is_dir():
            shutil.rmtree(old, ignore_errors=True)
    protocol = _protocol(home, name, *PATTERNS[pattern])
    if not (folder.is_dir() and open_run(folder).finished):
        request = RunRequest(str(protocol), RIG, folder, seed=0, progress=progress)
        run_experiment(request, resume=True)
    return open_run(folder)


def _protocol(home: Path, name: str, patch_mm: float, r: float) -> Path:
    """The shipped protocol, filmed faster, with force, on the pattern."""
    recipe = {"law": "algorithm1", "seed": 7, "size_mm": 35.0, "patch_mm": patch_mm, "r": r}
    pattern = home / f"pattern-{name}.toml"
    pattern.write_text(catalog.toml_text(recipe))
    plan = catalog.read_toml(catalog.find_file("protocols", PROTOCOL))
    plan["channels"] = ["image", "force", "shear"]
    plan["capture"]["rate_hz"] = RATE_HZ
    plan["specimen"]["pattern"] = str(pattern)
    path = home / f"{PROTOCOL}-{name}.toml"
    path.write_text(catalog.toml_text(plan))
    return path


def _about(frames: int) -> dict[str, Any]:
    return {
        "frames": frames,
        "scene": f"protocol {PROTOCOL} on rig {RIG}, simulated, seed 0",
        "machine": describe_machine(),
        "threads": {"cv2": 1, **{name: os.environ.get(name) for name in _BLAS}},
        "left_out": "decoding: the frames lie in memory",
        "calibrations": "by these frames themselves: for their time, not for their error",
        "force": f"features {_FORCE!r}",
    }


def _load() -> list[float] | None:
    """Load averages of the whole machine, over 1, 5 and 15 minutes."""
    return list(os.getloadavg()) if hasattr(os, "getloadavg") else None


if __name__ == "__main__":
    print(json.dumps(run_benchmark(), indent=1))
