"""Sound sensors and bad ones: the row that each must fail, those that may follow, what is found."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from spoiled_sensor import Made, bubble, gone, light, lint, ring_without, soft, turned

from deltact_fab.imaging import ImageSensor

SOUND: dict[str, Made] = {
    "as designed": Made(images=12),
    "finest patches, fisheye": Made(recipe="dense", fisheye=True, seed=2),
    "little light, little sharpness": Made(
        camera=ImageSensor(blur_px=0.9, corner_blur_px=1.2, shading=0.4, full_well_electrons=4000),
        paint=(light(lambda x, y: 0.45 + 0 * x),), seed=4,
    ),
    "a webcam's sharpening and JPEG": Made(
        camera=ImageSensor(format="mjpeg-422", sharpening=0.6),
        paint=(light(lambda x, y: 0.7 + 0 * x),), seed=5,
    ),
    "lens put in by hand": Made(
        lens=(("tilt_x_deg", 0.6), ("tilt_y_deg", -0.4), ("x0_mm", 0.12), ("gel_mm", 0.03)), seed=6
    ),
    "film stretched, turned and aside": Made(move=turned(-0.8, -0.3, 0.5, 1.01), seed=8),
}  # fmt: skip


def _band(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return x < -13.6


BAD: dict[str, tuple[Made, tuple[str, ...], dict[str, Any]]] = {
    "far out of focus": (Made(camera=ImageSensor(blur_px=4.0)), ("focus",), {}),
    "lens askew, one side soft": (
        Made(paint=(soft(lambda x, y: 0.16 * (x + 4)),)), ("focus",), {}),
    "lens tilted by 2.6 degrees": (
        Made(lens=(("tilt_x_deg", 2.6),)), ("lens square to the face",),
        {"keystone": pytest.approx(0.066, abs=0.01)}),
    "one LED dead": (
        Made(paint=(light(ring_without(3)),)), ("light, all LEDs", "light, even"), {}),
    "diffuser missing": (
        Made(paint=(light(lambda x, y: np.exp(-(x**2 + y**2) / 160)),)), ("light, even",), {}),
    "far too dark": (Made(paint=(light(lambda x, y: 0.08 + 0 * x),)), ("light, level",), {}),
    "over-exposed": (
        Made(paint=(light(lambda x, y: 1.9 + 0 * x),)), ("saturation", "light, level"), {}),
    "bubble, fisheye": (
        Made(fisheye=True, paint=(bubble(9.0, 6.0, 1.0),)), ("bubbles, lint, dust",), {}),
    "lint, finest patches": (
        Made(recipe="dense", paint=(lint(5.0, 4.0, 2.5),)), ("bubbles, lint, dust",), {}),
    "film torn at a side": (
        Made(paint=(gone(lambda x, y: np.hypot(x, y - 11) < 3.0, 0.05),)), ("film",), {}),
    "sticker turned by 95 degrees": (
        Made(recipe="dense", move=turned(95.0)), ("turn",),
        {"turned_deg": pytest.approx(95, abs=0.05)}),
    "mirrored": (Made(recipe="dense", move=((-1, 0, 0), (0, 1, 0))), ("mirror",), {}),
    "sticker aside, dots out of view": (
        Made(move=turned(0.0, 0.3, -2.0)), ("place",),
        {"place_mm": pytest.approx((0.3, -2.0), abs=0.03)}),
    "film stretched": (
        Made(recipe="dense", move=turned(0.0, scale=1.06)), ("scale",),
        {"scale": pytest.approx(1.06, abs=0.001)}),
    "wrong pattern": (Made(recipe="iid"), ("recipe",), {}),
    "frame in view": (
        Made(paint=(gone(_band, 0.03),)), ("edges of the view",),
        {"edges": {"-x": pytest.approx(1.5, abs=0.1)}}),
    "touched at rest": (
        Made(images=12, press_mm=(0.0,) * 9 + (0.1, 0.2, 0.3)), ("at rest",), {}),
    "noisy": (
        Made(images=12, camera=ImageSensor(full_well_electrons=150.0, read_noise_electrons=10.0),
             paint=(light(lambda x, y: 0.5 + 0 * x),)),
        ("noise at rest", "at rest"), {}),
}  # fmt: skip
