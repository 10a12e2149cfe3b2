"""Shape, depth and contacts of a run's settled frames, against truth where there is one."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

from ... import record
from ...aliases import Progress
from ...jobs import each
from ...measure.sensor_id import require_same
from ...measure.shape import DepthModel
from ..frames import recorded
from ..view import sensor_of
from .press import PressShape, press_shape
from .result import ShapeResult

UNCALIBRATED = DepthModel(gain=1.0, deepest_mm=20.0)


@dataclass(frozen=True)
class _ShapeJob:
    folder: str
    press: str
    model: DepthModel


def analyse(
    folder: str | Path,
    depth: Path | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> ShapeResult:
    """Every settled frame of a run; depth: a calibration of it, else the inverse's own is taken.

    Raises InputError for a run that is not finished or has no images, and for a calibration that
    is none or another sensor's.
    """
    run = record.open(folder)
    frames = recorded(run, "shape")
    model = UNCALIBRATED
    if depth is not None:
        head, model = DepthModel.load(depth)
        require_same(head.sensor, sensor_of(run), str(depth))
    presses = list(dict.fromkeys(frames["press"]))
    jobs = [_ShapeJob(str(folder), press, model) for press in presses]
    parts = each(_press, jobs, presses, executor, progress)
    ways = {part.contact_by for part in parts} - {None}
    return ShapeResult(
        rows=[row for part in parts for row in part.rows],
        pictures=[part.deepest for part in parts if part.deepest is not None],
        calibration=None if depth is None else str(depth),
        contact_by=", ".join(sorted(map(str, ways))) or None,
        simulated=run.simulated,
        seed=int(run.meta["seed"]),
    )


def _press(job: _ShapeJob) -> PressShape:
    return press_shape(record.open(job.folder), job.press, job.model)
