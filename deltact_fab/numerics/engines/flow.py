"""The flow: error against exact truth and CPU time, on frames that the virtual camera draws.

All frames are simulated: `flow_frames` draws them, `flow_hard` spoils them; here is what is timed
and what is expected of methods and tracker.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ...aliases import Image
from ...measure.flow import (
    FLOW_METHODS,
    PAPER,
    REFERENCES,
    FlowMethod,
    FlowTracker,
    named_tracker,
    to_gray,
)
from ...measure.flow.fused import Plane
from ...virtual.picture import TOLERANCE_PX
from ..engine import Case, CurveSetting, Engine, Work
from . import flow_hard
from .flow_frames import MM_PER_PX, STAR, FlowSequence, Vectors, scene

MOTIONS = {
    "press": "sphere:10, 1.2 mm deep and 1.5 mm of shear",
    "slide": "an analytic motion of 3.3 mm",
}
FAR = "121 px in ten frames, det F from .3 to 2"
NOISE_PX, LOSS_PX = 0.018, 34.0  # of the fused steps on the star
SILENT = 0.005  # share of an unrelated image that may be confident


def tracked(image: Image) -> Image:
    """What the tracker sees of an image: green, blurred."""
    return Plane.of(image).gray


def between(method: str, rest: Image, moved: Image, half: bool = False) -> Vectors:
    """Flow (h, w, 2) px of a grey pair from a cold start, at full or at half resolution."""
    flow = FlowMethod(method)
    if not half:
        return np.asarray(flow.between(rest, moved))
    h, w = rest.shape
    small = [cv2.resize(g, (w // 2, h // 2), interpolation=cv2.INTER_AREA) for g in (rest, moved)]
    wide = cv2.resize(flow.between(*small), (w, h), interpolation=cv2.INTER_LINEAR)
    return np.asarray(wide * np.array([w / (w // 2), h / (h // 2)], np.float32))


def found(method: str, pair: FlowSequence, half: bool = False) -> Vectors:
    """The flow of a pair as the tracker sees it."""
    return between(method, tracked(pair.images[0]), tracked(pair.last), half)


def _pair(method: str, name: str, half: bool, scratch: Path) -> Work:
    pair = scene(scratch, name)
    rest, moved = tracked(pair.images[0]), tracked(pair.last)
    return Work(lambda: between(method, rest, moved, half), pair.mean_error_mm)


def _followed(make: Callable[[], Any], scratch: Path) -> Work:
    frames = scene(scratch, "far")

    def run() -> Vectors:
        tracker = make()
        for image in frames.images:
            seen = tracker.update(image)
        return np.asarray(seen.flow_px)

    def error_mm(flow_px: Vectors) -> float:
        whole = flow_px.shape == frames.truth_px.shape
        return (frames if whole else frames.nodes()).mean_error_mm(flow_px)

    return Work(run, error_mm)


def curves(quick: bool) -> Sequence[CurveSetting]:
    """Methods on a pair, and trackers by their reference through ten frames."""
    millimetres = partial(
        CurveSetting, unit="mm, mean over moving pixels", reference="the field that was drawn",
        reference_error=TOLERANCE_PX * MM_PER_PX,
    )  # fmt: skip
    pairs = [
        millimetres(case=MOTIONS[motion], series=series, name=method,
                    build=partial(_pair, method, motion, half))
        for motion in (("press",) if quick else MOTIONS)
        for series, half in (("full resolution", False), ("half resolution", True))
        for method in (("fused", "dis-medium") if quick else FLOW_METHODS)
    ]  # fmt: skip
    if quick:
        return pairs
    makes: dict[tuple[str, str], Callable[[], Any]] = {
        (reference, method): partial(named_tracker, f"{method}/{reference}")
        for reference in REFERENCES
        for method in (("fused",) if reference == "anchored" else ("fused", "dis-medium"))
    }
    makes["the paper's", PAPER] = partial(named_tracker, PAPER)
    makes["anchored, no confidence map", "fused"] = partial(FlowTracker, confidence=False)
    makes["anchored, every second pixel", "fused"] = partial(FlowTracker, full=False)
    return pairs + [
        millimetres(case=FAR, series=series, name=name, build=partial(_followed, make))
        for (series, name), make in makes.items()
    ]


def _accuracy(method: str, motion: str, half: bool, scratch: Path) -> float:
    pair = scene(scratch, motion)
    return pair.mean_error_mm(found(method, pair, half))


def _still(scratch: Path) -> float:
    rest = scene(scratch, "press").images[0]
    tracker = FlowTracker()
    tracker.update(rest)
    flow = tracker.update(rest).flow_px
    return float(np.hypot(*np.moveaxis(flow, -1, 0)).max() * MM_PER_PX)


def _first(value: int, scratch: Path) -> float:
    shape = scene(scratch, "press").last.shape
    return float(np.abs(FlowTracker().update(np.full(shape, value, np.uint8)).flow_px).max())


def _one_frame(scratch: Path) -> float:
    seen = FlowTracker().update(scene(scratch, "press").images[0])
    return float(np.abs(seen.flow_px).max())


def _other_size(scratch: Path) -> float:
    rest = scene(scratch, "press").images[0]
    tracker = FlowTracker()
    tracker.update(rest)
    return float(np.abs(tracker.update(rest[:-40]).flow_px).max())


def _method(rest: Callable[[Image], Any], moved: Callable[[Image], Any], scratch: Path) -> float:
    gray = to_gray(scene(scratch, "press").images[0])
    return float(np.abs(FlowMethod().between(rest(gray), moved(gray))).max())


def _same(gray: Image) -> Image:
    return gray


def _threads(method: str, scratch: Path) -> float:
    """Mean difference of the flows on one and on two threads over the moving pixels, mm."""
    pair = scene(scratch, "press")
    flows = []
    for n in (1, 2):
        cv2.setNumThreads(n)
        flows.append(found(method, pair))
    cv2.setNumThreads(1)
    moved = np.hypot(*np.moveaxis(flows[1] - flows[0], -1, 0))[pair.moving()]
    return float(moved.mean(dtype=np.float64) * MM_PER_PX)


def _star_figure(figure: int, scratch: Path) -> float:
    return STAR.figures(found("fused", scene(scratch, "star: speckle")))[figure]


def _far(frames: int, name: str, scratch: Path) -> tuple[float, str]:
    found = flow_hard.long_motion(name, frames, scratch)
    return found.wrong, f"{100 * found.confident:.3g} % of the view is marked confident"


def cases(quick: bool) -> Sequence[Case]:
    """What may not be answered silently: no texture, no relation, too much motion."""
    out = [
        Case("a first image without texture", "refused", partial(_first, 90), says="texture"),
        Case("a first image all white", "refused", partial(_first, 255), says="texture"),
        Case("one frame alone", "right", _one_frame, 0.0, "px"),
        Case("nothing moves", "right", _still, 0.01, "mm"),
        Case("another image size", "refused", _other_size, says="the first one was"),
        Case("a pair of two sizes", "refused", partial(_method, _same, lambda g: g[:-2]),
             says="one size is needed"),
        Case("an image of 40 px", "refused",
             partial(_method, lambda g: g[:40, :40], lambda g: g[:40, :40]), says="64 px or more"),
        Case("float images", "refused",
             partial(_method, lambda g: g.astype(float), lambda g: g.astype(float)), says="uint8"),
    ]  # fmt: skip
    for method in ("fused", "dis-fast") if quick else FLOW_METHODS:
        # Half the pixels may cost no more than a doubled error.
        for name, half, bound in (("full", False, 0.03), ("half", True, 0.06)):
            out.append(Case(f"{method}: press, {name} resolution", "right",
                            partial(_accuracy, method, "press", half), bound, "mm"))  # fmt: skip
    near = ("press",) if quick else flow_hard.NEAR
    no_one = ("noise", "upside down") if quick else (*flow_hard.UNRELATED, flow_hard.OTHER_SEED)
    for what in no_one if quick else (*no_one, flow_hard.ONE_CORNER):
        out.append(Case(f"{what}: not trusted", "refused",
                        partial(flow_hard.never_trusted, what, near), says="flagged"))  # fmt: skip
    for what in no_one:
        out.append(Case(f"{what}: confident", "right",
                        partial(flow_hard.most_confident, what, near), SILENT,
                        "share of the view"))  # fmt: skip
    if quick:
        return out
    for what in (*flow_hard.SPOILT, flow_hard.HALF_OTHER):
        out.append(Case(f"{what}: confident pixels off by 1 px", "right or refused",
                        partial(flow_hard.most_wrong, what, near), flow_hard.WRONG,
                        "share of them", says="flagged"))  # fmt: skip
    for what, bound in flow_hard.BLIND.items():
        out.append(Case(f"{what}: not confident", "right",
                        partial(flow_hard.least_blind, what, near), bound,
                        "share of the view"))  # fmt: skip
    for name in flow_hard.LONG:
        several = flow_hard.LONG_WRONG.get(name, 0.0)
        for frames, bound in ((10, several), (5, several), (1, flow_hard.WRONG)):
            what = (
                f"{name.replace('far', '121 px')} in {frames} frames: confident pixels off by 1 px"
            )
            out.append(Case(what, "right", partial(_far, frames, name), bound, "share of them"))
    out += [
        Case("fused: star, noise", "right", partial(_star_figure, 0), NOISE_PX, "px"),
        Case("fused: star, 10 % loss", "right", partial(_star_figure, 1), LOSS_PX, "px"),
        *(Case(f"{method}: two threads against one", "right", partial(_threads, method), 0.002,
               "mm") for method in FLOW_METHODS),
    ]  # fmt: skip
    return out


ENGINE = Engine(
    "flow",
    "Optical flow",
    "Flow between two frames of the virtual camera and through sequences (simulated): the fused "
    "steps, Dense Inverse Search, Farneback.",
    curves,
    cases,
)
