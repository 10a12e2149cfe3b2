"""The flow's error against its CPU time: methods, resolution, channel, references, output."""

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
from ...measure.flow.fused import Plane, RefinementReference
from ...virtual.picture import TOLERANCE_PX
from ..engine import CurveSetting, Work
from .flow_frames import MM_PER_PX, STAR, FlowSequence, Vectors, scene

MOTIONS = {
    "press": "sphere:10, 1.2 mm deep and 1.5 mm of shear",
    "slide": "an analytic motion of 3.3 mm",
    "leap": "an analytic motion of 8.8 mm",
}
FAR = "121 px in ten frames, det F from .3 to 2"
DRAWN = "the field that the camera drew"
FOLLOWED = ("fused", "dis-fast", "dis-medium", "farneback")
QUICK = ("fused", "dis-medium")


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


def _pair(
    method: str, name: str, half: bool, channel: Callable[[Image], Image], scratch: Path
) -> Work:
    pair = scene(scratch, name)
    rest, moved = map(channel, pair.images)
    return Work(lambda: between(method, rest, moved, half), pair.mean_error_mm)


def _prepared(name: str, stride: int, scratch: Path) -> Work:
    """The fused steps from a colour image to what a tracker keeps, the reference ready."""
    pair = scene(scratch, name)
    reference, moved = RefinementReference.of(pair.images[0]), pair.last
    if stride == 1:
        prepared = FlowMethod("fused").prepare(tracked(pair.images[0]))
        return Work(lambda: prepared.to(tracked(moved)), pair.mean_error_mm)
    step = stride // 2
    return Work(
        lambda: reference.refine(Plane.of(moved)).flow_px[::step, ::step],
        lambda flow: pair.nodes(step).mean_error_mm(flow),
    )


def _star(method: str, name: str, figure: int, scratch: Path) -> Work:
    pair = scene(scratch, name)
    rest, moved = map(tracked, pair.images)
    return Work(lambda: between(method, rest, moved), lambda f: STAR.figures(f)[figure])


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


def trackers() -> dict[tuple[str, str], Callable[[], Any]]:
    """Every reference with its methods, and what the default may leave out: to a tracker each."""
    out: dict[tuple[str, str], Callable[[], Any]] = {}
    for reference in REFERENCES:
        for method in FOLLOWED[:1] if reference == "anchored" else FOLLOWED:
            out[reference, method] = partial(named_tracker, f"{method}/{reference}")
    out["the paper's", PAPER] = partial(named_tracker, PAPER)
    out["anchored, no confidence map", "fused"] = partial(FlowTracker, confidence=False)
    out["anchored, every second pixel", "fused"] = partial(FlowTracker, full=False)
    return out


def curves(quick: bool) -> Sequence[CurveSetting]:
    """All settings; a quick run has one motion and two methods."""
    millimetres = partial(
        CurveSetting, unit="mm, mean over moving pixels", reference=DRAWN,
        reference_error=TOLERANCE_PX * MM_PER_PX,
    )  # fmt: skip
    if quick:
        return [
            millimetres(case=MOTIONS["press"], series="full resolution", name=method,
                        build=partial(_pair, method, "press", False, tracked))
            for method in QUICK
        ]  # fmt: skip
    out = []
    for motion in ("press", "slide"):
        for method in FLOW_METHODS:
            for series, half, threads, channel in (
                ("full resolution", False, 1, tracked),
                ("half resolution", True, 1, tracked),
                ("full resolution, two threads", False, 2, tracked),
                ("full resolution, grey in place of green", False, 1, to_gray),
            ):
                out.append(millimetres(
                    case=MOTIONS[motion], series=series, name=method, threads=threads,
                    build=partial(_pair, method, motion, half, channel),
                ))  # fmt: skip
        for stride in (1, 2, 4):
            out.append(millimetres(
                case=MOTIONS[motion], series="fused, from the colour image, reference ready",
                name=f"every {stride} px", build=partial(_prepared, motion, stride),
            ))  # fmt: skip
    for (series, name), make in trackers().items():
        out.append(millimetres(case=FAR, series=series, name=name, build=partial(_followed, make)))
    for source, about in (("star: speckle", "DIC speckle"), ("star: coarse", "d 0.15 r 0.1")):
        for method in FLOW_METHODS:
            for i, (case, unit) in enumerate((
                ("star: noise", "px, standard deviation above a period of 119 px"),
                ("star: detail", "px, period at which 10 % of the amplitude is lost"),
            )):  # fmt: skip
                out.append(CurveSetting(
                    case=f"{case}, {about}", series="one pair", name=method, unit=unit,
                    reference="0.5 cos(2 pi y / p(x)) px", reference_error=TOLERANCE_PX,
                    build=partial(_star, method, source, i),
                ))  # fmt: skip
    return out
