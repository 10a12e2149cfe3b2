"""A whole run, press by press in parallel."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from ... import record
from ...aliases import Progress
from ...jobs import each
from ..frames import recorded
from .dots import DotTally
from .press import COLUMNS, PressJob, PressResult, analyse_press
from .result import TrackingResult
from .scene import TrackingPlan, scene_of
from .tally import ErrorTally


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
    presses = list(dict.fromkeys(frames["press"]))
    indenter_of = dict(zip(frames["press"], frames["indenter"], strict=True))
    jobs = [PressJob(str(folder), press, scene) for press in presses]
    results = each(analyse_press, jobs, presses, executor, progress)
    return _assemble(run, scene, results, list(indenter_of.values()))


def _assemble(
    run: record.Run, scene: TrackingPlan, results: list[PressResult], indenters: list[str]
) -> TrackingResult:
    import pandas as pd

    total = {name: ErrorTally() for name in scene.methods}
    parts: dict[tuple[str, str], ErrorTally] = {}
    dots = DotTally()
    rows: list[dict[str, Any]] = []
    left_out = list(scene.left_out)
    arrows = {}
    for part, indenter in zip(results, indenters, strict=True):
        for name, tally in part.tallies.items():
            total[name].join(tally)
            parts.setdefault((name, indenter), ErrorTally()).join(tally)
        dots.join(part.dots)
        rows += part.rows
        left_out += part.left_out
        arrows.update(part.arrows)
    return TrackingResult(
        methods=[{"name": name, **tally.figures()} for name, tally in total.items()],
        by_indenter=[
            {"name": name, "indenter": indenter, **tally.figures()}
            for (name, indenter), tally in parts.items()
        ],
        dots=dots.figures() if dots.seen + dots.lost else None,
        left_out=left_out,
        frames=pd.DataFrame(rows, columns=COLUMNS),
        arrows=arrows,
        mm_per_px=run.camera.mm_per_px,
        simulated=run.simulated,
        seed=int(run.meta["seed"]),
    )
