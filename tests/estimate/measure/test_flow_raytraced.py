"""The flow on pictures that the product did not draw: an independent tracer, JPEG by Pillow."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from raytraced import Imaging, Lens, Motion, Tracer, true_motion_mm

from deltact_fab.common import validate
from deltact_fab.estimate.measure.flow.tracker import FlowTracker
from deltact_fab.fabricate.patterns.recipe import PatternRecipe
from deltact_fab.sensor.optics.fisheye import Fisheye
from deltact_fab.sensor.optics.rectified import Rectified
from deltact_fab.sensor.shapes.sensor import SensorDimensions

LENS = Lens()
VIEW = Rectified.from_sensor(SensorDimensions(), Fisheye(f_px=LENS.f_px))
MOTION = Motion(press_mm=2.0, drag_mm=(3.0, 0.0), twist_rad=0.1)
STEPS = 8
CAMERAS = {"edge-aware": Imaging(jpeg=0, demosaic="COLOR_BayerRG2BGR_EA"), "4:2:0": Imaging()}
PATTERNS = {"coarse": (0.15, 0.1), "dense": (0.075, 0.6)}
GOALS_MM = {"coarse": (0.0025, 0.9), "dense": (0.009, 0.7)}
"""Mean over the confident, and the share of the face that they are."""


@cache
def light(pattern: str, part: float, seed: int = 7) -> NDArray[np.float32]:
    patch_mm, r = PATTERNS[pattern]
    recipe = validate(
        PatternRecipe, {"law": "algorithm1", "seed": seed, "patch_mm": patch_mm, "r": r}, "test"
    )
    tracer = Tracer(recipe.patches(), recipe.printed_mm, LENS)
    return tracer.light(MOTION.share(part) if part else None)


def seen(pattern: str, camera: str, part: float, seed: int = 7) -> NDArray[np.uint8]:
    """As it is tracked, rectified: at that part of the motion."""
    rng = np.random.default_rng([round(100 * part), seed])
    return VIEW.rectify(CAMERAS[camera].develop(light(pattern, part, seed), rng))


def follow(images: Sequence[NDArray[np.uint8]]) -> Any:
    tracker = FlowTracker(full=False)
    for image in images:
        last = tracker.update(image)
    return last


def error_mm(found: Any) -> NDArray[np.float64]:
    px = np.stack(np.meshgrid(*(np.arange(n) * 2 + 0.5 for n in found.flow_px.shape[1::-1])), -1)
    true_mm = true_motion_mm(LENS, MOTION, VIEW.rest_mm(px))
    return np.linalg.norm(found.flow_px * VIEW.mm_per_px - true_mm, axis=-1)


@pytest.mark.parametrize(
    ("pattern", "camera"),
    [
        pytest.param(pattern, camera, marks=pytest.mark.slow if guards else pytest.mark.evidence)
        for pattern, camera, guards in (
            ("coarse", "4:2:0", True), ("dense", "edge-aware", True),
            ("coarse", "edge-aware", False), ("dense", "4:2:0", False),
        )
    ],
)  # fmt: skip
def test_drag_through_ordinary_camera(pattern: str, camera: str) -> None:
    found = follow([seen(pattern, camera, k / STEPS) for k in range(STEPS + 1)])
    assert found.diagnostics.trusted
    error = error_mm(found)[found.confident & found.visible]
    print(f"{pattern} {camera}: {error.mean():.4f} mm, {found.diagnostics.confident_share:.3f}")
    most_mm, cover = GOALS_MM[pattern]
    assert error.mean() <= most_mm
    assert found.diagnostics.confident_share >= cover
    assert (error > 0.1).mean() <= 0.001


@pytest.mark.parametrize(
    ("level", "says"), [(8, "it is dark"), (250, "overexposed"), (120, "its light is right")]
)
def test_textureless_first_image_explains_why(level: int, says: str) -> None:
    plain = np.random.default_rng(1).normal(level, 1.0, (240, 320, 3)).clip(0, 255)
    with pytest.raises(Exception, match=says):
        FlowTracker().update(plain.astype(np.uint8))
