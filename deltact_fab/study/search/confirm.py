"""Several patterns on the same moving gel: frames drawn, tracked, and compared with the truth.

Simulated. The gel is solved once, or found; a frame's geometry once for all patterns.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from ... import jobs
from ...analysis.tracking_error.follow import Follower, TrackingPlan
from ...catalog import validate
from ...errors import SensorError
from ...patterns.recipe import recipe_from
from ...protocols.plan import Protocol
from ...rig.config import VirtualConfig
from ..stream import PressStream, StreamTruth
from .imager import PatternImager

SHOWN_MM = 3.0
"""Side of the square of the resting face that a picture shows."""


def confirm(given: dict[str, Any]) -> dict[str, Any]:
    """given: protocol, rig, bench (plain data), patterns: each {name, recipe, methods}, seed.

    Returns, by pattern's name, the tracking error's figures of each method, under `figures`; `why`
    in place of them for a pattern that cannot be tracked; frames: how many were judged. Arrays
    `picture/NAME`: (side, side, 3) RGB of the resting face.
    """
    cv2.setNumThreads(1)  # DIS splits the image by thread
    bench = PatternImager.from_dict(given["bench"])
    config = with_bench(validate(VirtualConfig, given["rig"], "rig"), bench)
    protocol = validate(Protocol, given["protocol"], "pattern-search")
    stream = PressStream(protocol, given["press"], bench.design(), config)
    truth, seed = StreamTruth(stream), given["seed"]
    out: dict[str, Any] = {"figures": {}}
    drawn = {}
    for pattern in given["patterns"]:
        recipe = recipe_from(pattern["recipe"], pattern["name"])
        marks = stream.marks(recipe)
        follower = Follower(TrackingPlan(tuple(pattern["methods"]), False, ()), marks)
        drawn[pattern["name"]] = (
            stream.picture(recipe, seed), stream.noise(seed), marks, follower
        )  # fmt: skip
    n = len(stream.looks)
    for frame in stream.frames():
        for name, (picture, noise, marks, follower) in list(drawn.items()):
            image = stream.tracked(picture.expose(frame.at_px, noise, frame.displacement_mm))
            try:
                follower.take(image, truth.of(frame, marks) if frame.number else None)
            except SensorError as why:  # nothing in it to follow
                out["figures"][name] = {"why": str(why)}
                del drawn[name]
                continue
            if frame.number == 0:
                out[f"picture/{name}"] = middle(image, bench.mm_per_px)
        jobs.tell((frame.number + 1) / n)
    for name, (_, _, _, follower) in drawn.items():
        out["figures"][name] = {m: t.figures() for m, t in follower.tallies.items()}
    return out | {"frames": n - 1}


def with_bench(config: VirtualConfig, bench: PatternImager) -> VirtualConfig:
    """A virtual rig with that printer and camera, and no lens but a pinhole."""
    simulator = config.virtual
    printer = simulator.printer.model_copy(update=vars(bench.printer))
    camera = simulator.camera.model_copy(
        update={k: v for k, v in vars(bench.sensor).items() if k != "mosaic"}
    )
    tables = simulator.model_copy(update={"printer": printer, "camera": camera, "lens": None})
    return config.model_copy(update={"virtual": tables, "camera": None})


def middle(image: Any, mm_per_px: float) -> Any:
    """The middle of an image (h, w, 3) BGR, SHOWN_MM a side, as RGB."""
    half = round(SHOWN_MM / mm_per_px / 2)
    row, column = image.shape[0] // 2, image.shape[1] // 2
    part = image[row - half : row + half, column - half : column + half, ::-1]
    return np.ascontiguousarray(part)
