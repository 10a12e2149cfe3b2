"""The flow: error against exact truth and CPU time, on frames that the virtual camera draws.

All frames are simulated: `flow_frames` draws them, `flow_hard` spoils them; here is what is timed
and what is expected of methods and tracker.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import get_args

import numpy as np

from ...aliases import Image
from ...measure.flow import FLOW_METHODS, PAPER, FlowMethod, Reference, named_tracker
from ...measure.flow.fused import Plane
from ...virtual.picture import TOLERANCE_PX
from ..engine import Case, CurveSetting, Engine, Work
from . import flow_hard
from .flow_frames import MM_PER_PX, FlowSequence, Vectors, scene

PRESS = "sphere:10, 1.2 mm deep and 1.5 mm of shear"
FAR = "121 px in ten frames, det F from .3 to 2"


def tracked(image: Image) -> Image:
    """What the tracker sees of an image: luma, blurred."""
    return Plane.of(image).gray


def found(method: str, pair: FlowSequence) -> Vectors:
    """Flow (h, w, 2) px from first to last image from a cold start, as the tracker sees them."""
    return FlowMethod(method).between(tracked(pair.images[0]), tracked(pair.last))


def _pair(method: str, scratch: Path) -> Work:
    pair = scene(scratch, "press")
    rest, moved = tracked(pair.images[0]), tracked(pair.last)
    return Work(lambda: FlowMethod(method).between(rest, moved), pair.mean_error_mm)


def _followed(name: str, scratch: Path) -> Work:
    frames = scene(scratch, "far")

    def run() -> Vectors:
        tracker = named_tracker(name)
        for image in frames.images:
            seen = tracker.update(image)
        return np.asarray(seen.flow_px)

    return Work(run, frames.mean_error_mm)


def curves(quick: bool) -> Sequence[CurveSetting]:
    """Methods on a pair, and trackers by their reference through ten frames."""
    millimetres = partial(
        CurveSetting, unit="mm, mean over moving pixels", reference="the field that was drawn",
        reference_error=TOLERANCE_PX * MM_PER_PX,
    )  # fmt: skip
    methods = ("fused", "dis-medium", "dis-fast") if quick else FLOW_METHODS
    pairs = [
        millimetres(case=PRESS, series="a pair", name=method, build=partial(_pair, method))
        for method in methods
    ]
    trackers = [(kept, "fused") for kept in get_args(Reference)]
    trackers += [(kept, "dis-medium") for kept in get_args(Reference) if kept != "anchored"]
    named = {f"{method}/{kept}": (kept, method) for kept, method in trackers}
    named[PAPER] = ("the paper's", PAPER)
    return pairs + [
        millimetres(case=FAR, series=series, name=name, build=partial(_followed, tracker))
        for tracker, (series, name) in ({} if quick else named).items()
    ]


def _accuracy(method: str, scratch: Path) -> float:
    pair = scene(scratch, "press")
    return pair.mean_error_mm(found(method, pair))


def cases(quick: bool) -> Sequence[Case]:
    """What may not be answered silently: no relation, too much motion."""
    methods = ("fused", "dis-fast") if quick else FLOW_METHODS
    return [
        *(Case(f"{method}: press", "right", partial(_accuracy, method), 0.03, "mm")
          for method in methods),
        *flow_hard.cases(quick),
    ]  # fmt: skip


ENGINE = Engine(
    "Optical flow",
    "Flow between two frames of the virtual camera and through sequences (simulated): the fused "
    "steps, Dense Inverse Search, Farneback.",
    cases,
    curves,
)
