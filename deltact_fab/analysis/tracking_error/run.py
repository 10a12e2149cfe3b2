"""A whole run, press by press in parallel."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from ... import record
from ...aliases import Progress
from ...errors import RunFailed
from ...jobs import each
from ..frames import recorded
from .dots import DotTally, Marks
from .follow import Follower, TrackingPlan, scene_of
from .result import TrackingResult
from .tally import ErrorTally
from .truth import TrueFrame, seen_by

FRAME = ("frame_id", "seq", "press", "indenter", "step_id")
COLUMNS = [*FRAME, "method", *ErrorTally().figures()]
"""Of the table of frames; empty where a thing was left out."""


@dataclass
class PressResult:
    """Sums by method, rows of the table of frames, and what was left out."""

    tallies: dict[str, ErrorTally]
    dots: DotTally = field(default_factory=DotTally)
    left_out: list[str] = field(default_factory=list)
    rows: list[dict[str, Any]] = field(default_factory=list)


def analyse_press(folder: str, press: str, scene: TrackingPlan) -> PressResult:
    """All frames of one press: the first one is the reference of flow and dots.

    Raises RunFailed for an image of another size, SensorError for a first one without a pattern;
    one in which only the dots are missing is analysed without them.
    """
    import cv2

    cv2.setNumThreads(1)  # one thread, so that milliseconds compare
    run = record.open(folder)
    camera, truth = run.camera, run.truth()
    follower = Follower(scene, Marks.of(camera, run.pattern))
    in_view = seen_by(camera)
    result = PressResult(follower.tallies)
    for at, row in enumerate(run.frames(press).itertuples()):
        image = run.image(str(row.file))
        if image.shape[:2] != in_view.shape:
            raise RunFailed(f"{row.file}: size {image.shape[1]} x {image.shape[0]} differs")
        frame = None
        if truth and at:
            motion = truth.flow_and_in_plane(str(row.frame_id))
            frame = TrueFrame.of(*motion, in_view, camera.mm_per_px)
        frame_of = {key: getattr(row, key) for key in FRAME}
        # The reference compared with itself is no measurement, and says nothing.
        for name, figures in follower.take(image, frame).items():
            result.rows.append({**frame_of, "method": name, **figures})
    result.left_out += [f"error at the dots of {press}: {why}" for why in follower.left_out]
    if follower.dots:
        result.dots = follower.dots.tally
    return result


def analyse(
    folder: str | Path,
    methods: Sequence[str] | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> TrackingResult:
    """Tracking error of every method over a whole run.

    methods: None for the default ones, or for the dots where a pattern has nothing else. What the
    run cannot tell (errors at dots that it has not, against a truth that nobody knows) is left out
    and named. Raises InputError for an unknown method, a run without images or one not finished.
    """
    run = record.open(folder)
    frames = recorded(run, "tracking")
    scene = scene_of(run, methods)
    indenter_of = dict(zip(frames["press"], frames["indenter"], strict=True))
    presses = list(indenter_of)
    results = each(
        partial(analyse_press, str(folder), scene=scene), presses, presses, executor, progress
    )
    total = {name: ErrorTally() for name in scene.methods}
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
        dots=dots.figures() if dots.seen + dots.lost else None,
        left_out=[*scene.left_out, *(line for part in results for line in part.left_out)],
        frames=pd.DataFrame(rows, columns=COLUMNS),
        mm_per_px=run.camera.mm_per_px,
        simulated=run.simulated,
        seed=int(run.meta["seed"]),
    )
