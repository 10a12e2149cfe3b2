"""The flow's methods beside other people's correlators, pyvale and al-dic, on the same frames.

Every one gets the same two grey images: luma, blurred, as the tracker sees them. Its flow is
judged at the nodes of a grid; a correlator that answers elsewhere is asked there.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import cv2
import numpy as np

from benchmarks.star import Star
from deltact_fab.common.errors import RunFailed
from deltact_fab.estimate.measure.flow.renewed import FlowMethod
from deltact_fab.sensor.shapes.imaging import ImageSensor
from deltact_fab.studies.numerics.engine import finite_or_none
from deltact_fab.studies.numerics.engines.flow_frames import (
    COARSE_RECIPE,
    DEFAULT_CAMERA,
    FRAMES_SEED,
    FlowSequence,
    Vectors,
    bump,
    far_bump,
    in_plane,
    pressed,
)

from . import peer

PEERS = {"pyvale": "pyvale_flow.py", "al-dic": "al_dic_flow.py"}
MARGIN_PX = 32  # no correlator answers nearer to the border
REPEATS = 3
# v = 0.5 cos(2 pi y / p(x)) px, p from 10 to 300 px, as of the DIC Challenge 2.0.
STAR = Star(DEFAULT_CAMERA.width_px, DEFAULT_CAMERA.height_px)
_short = partial(bump, 22.0, 90.0, 90.0)


def speckle_star() -> FlowSequence:
    """The star on grey speckle, without printer, lens and mosaic, with the Challenge's noise.

    Speckle and noise as measured on its image "Star, noise": 118 +- 38 grey levels, correlation
    exp(-(d / 2.74 px)^2), noise of variance 0.5 + 0.031 x grey level.
    """
    rng = np.random.default_rng(FRAMES_SEED)
    w, h, fine = DEFAULT_CAMERA.width_px, DEFAULT_CAMERA.height_px, 4
    size = (h + 16) * fine, (w + 16) * fine
    white = rng.standard_normal(size, dtype=np.float32)
    field = cv2.GaussianBlur(white, (0, 0), 1.37 * fine)
    level = 118 + 55 * np.tanh(field / field.std())
    x, y = np.meshgrid(np.arange(float(w)), np.arange(float(h)))
    truth = STAR.motion(x, y)
    back = y.copy()
    for _ in range(30):  # the slope is 0.31 at most
        back = y - STAR.motion(x, back)[..., 1]
    images = []
    columns = ((x + 8.5) * fine - 0.5).astype(np.float32)
    for rows in (y, back):
        at = ((rows + 8.5) * fine - 0.5).astype(np.float32)
        seen = cv2.remap(level, columns, at, cv2.INTER_CUBIC)
        noisy = seen + np.sqrt(0.5 + 0.031 * seen) * rng.standard_normal(seen.shape)
        images.append(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    return FlowSequence(np.stack(images), truth.astype(np.float32))


class Question(NamedTuple):
    """scene: made in the row's process. reach_px: a bound of its motion, told to the correlators.

    step_px: between their nodes.
    """

    scene: Callable[[], FlowSequence]
    reach_px: int
    step_px: int = 8


class ThreeChips(ImageSensor):
    """A camera that measures every colour in every pixel."""

    mosaic = False


THREE_CHIPS = ThreeChips()
STARS = {
    "speckle": Question(speckle_star, 16, 4),
    "three chips": Question(
        partial(in_plane, COARSE_RECIPE, STAR.motion, sensor=THREE_CHIPS), 16, 4
    ),
    "Bayer mosaic": Question(partial(in_plane, COARSE_RECIPE, STAR.motion), 16, 4),
}
MOTIONS = {
    "press": Question(pressed, 40),
    "press, three chips": Question(partial(pressed, sensor=THREE_CHIPS), 40),
    "22 px": Question(partial(in_plane, COARSE_RECIPE, _short), 32),
    "22 px, three chips": Question(
        partial(in_plane, COARSE_RECIPE, _short, sensor=THREE_CHIPS), 32
    ),
    "121 px": Question(partial(in_plane, COARSE_RECIPE, far_bump), 128),
    "121 px, three chips": Question(
        partial(in_plane, COARSE_RECIPE, far_bump, sensor=THREE_CHIPS), 128
    ),
}


def peer_row(method: str) -> dict[str, Any]:
    """One method's figures on every scene. Raises RunFailed where there is no such peer."""
    out: dict[str, Any] = {"method": method, "stars": {}, "motions": {}}
    for name, question in STARS.items():
        scene = question.scene()
        flow, cpu_s, out["version"] = answer(method, question, scene)
        noise_px, loss_px = STAR.figures(flow)
        out["stars"][name] = {
            "noise_px": noise_px, "loss_px": finite_or_none(loss_px), "cpu_s": cpu_s,
        }  # fmt: skip
    for name, question in MOTIONS.items():
        scene = question.scene()
        flow, cpu_s, _ = answer(method, question, scene)
        judged = scene.moving()
        judged[:MARGIN_PX] = judged[-MARGIN_PX:] = False
        judged[:, :MARGIN_PX] = judged[:, -MARGIN_PX:] = False
        asked = np.zeros_like(judged)
        asked[::8, ::8] = judged[::8, ::8]
        off = scene.error_px(flow)
        # A correlator's nodes are where it likes.
        where = asked if method in FlowMethod.NAMES else judged & np.isfinite(off)
        share = 1.0 if method in FlowMethod.NAMES else where.sum() / asked.sum()
        out["motions"][name] = {
            "mean_px": float(off[where].mean(dtype=np.float64)),
            "median_px": float(np.median(off[where])),
            "p99_px": float(np.percentile(off[where], 99)),
            "cover": min(1.0, float(share)),
            "cpu_s": cpu_s,
        }
    return out


def compute_flow(method: str, pair: FlowSequence) -> Vectors:
    """Flow (h, w, 2), px, from the first to the last image, from a cold start."""
    views = (FlowMethod.prepare(image) for image in (pair.images[0], pair.last))
    return FlowMethod(method).between(*views)


def answer(method: str, question: Question, scene: FlowSequence) -> tuple[Vectors, float, str]:
    """Flow (h, w, 2) px, nan where there is none; CPU seconds; the version."""
    if method in FlowMethod.NAMES:
        compute_flow(method, scene)
        times = []
        for _ in range(REPEATS):
            before = time.process_time()
            flow = compute_flow(method, scene)
            times.append(time.process_time() - before)
        return flow, min(times), f"cv2 {cv2.__version__}"
    given = {
        "rest": FlowMethod.prepare(scene.images[0]), "moved": FlowMethod.prepare(scene.last),
        "step_px": question.step_px, "reach_px": question.reach_px,
    }  # fmt: skip
    told = peer.ask(method, PEERS[method], given, timeout_s=600)
    if told is None:
        raise RunFailed(f"{method}: not run: no .venv-peers (make peers)")
    dense = np.full(scene.truth_px.shape, np.nan, np.float32)
    x, y = np.rint(told["nodes_px"]).astype(int).T
    dense[y, x] = told["flow_px"]
    return dense, told["cpu_s"], f"{method} {told['version']}"
