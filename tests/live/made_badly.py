"""Ten sound sensors and thirty bad ones: the row that each must fail, and those that may follow."""

from __future__ import annotations

import numpy as np
from spoiled_sensor import (
    Made,
    bubble,
    gone,
    light,
    lint,
    ring_without,
    soft,
    speck,
    turned,
)

from deltact_fab.imaging import ImageSensor

SOUND: dict[str, Made] = {
    "as designed": Made(images=12),
    "finest patches": Made(recipe="dense"),
    "through the fisheye": Made(fisheye=True, seed=1),
    "finest patches, fisheye": Made(recipe="dense", fisheye=True, seed=2),
    "a little turned and aside": Made(move=turned(1.5, 0.6, -0.4), seed=3),
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
    "skin a little thick": Made(lens=(("gel_mm", 0.15), ("air_gap_mm", 0.1)), seed=7),
    "film stretched by a hundredth": Made(move=turned(-0.8, -0.3, 0.5, 1.01), seed=8),
}  # fmt: skip


def _band(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return x < -13.6


BAD: dict[str, tuple[Made, tuple[str, ...]]] = {
    "out of focus": (Made(camera=ImageSensor(blur_px=2.5)), ("focus",)),
    "far out of focus": (Made(camera=ImageSensor(blur_px=4.0)), ("focus",)),
    "out of focus, finest patches": (
        Made(recipe="dense", camera=ImageSensor(blur_px=1.8)), ("focus",)),
    "corners out of focus": (Made(camera=ImageSensor(corner_blur_px=4.5)), ("focus",)),
    "lens askew, one side soft": (Made(paint=(soft(lambda x, y: 0.16 * (x + 4)),)), ("focus",)),
    "lens tilted by 2.6 degrees": (
        Made(lens=(("tilt_x_deg", 2.6),)), ("lens square to the face",)),
    "one LED dead": (Made(paint=(light(ring_without(0)),)), ("light, all LEDs", "light, even")),
    "another LED dead": (Made(paint=(light(ring_without(3)),)), ("light, all LEDs", "light, even")),
    "diffuser missing": (
        Made(paint=(light(lambda x, y: np.exp(-(x**2 + y**2) / 160)),)), ("light, even",)),
    "far too dark": (Made(paint=(light(lambda x, y: 0.08 + 0 * x),)), ("light, level",)),
    "over-exposed": (
        Made(paint=(light(lambda x, y: 1.9 + 0 * x),)), ("saturation", "light, level")),
    "a lamp's highlight": (
        Made(camera=ImageSensor(highlight=2.5)), ("saturation", "bubbles, lint, dust")),
    "bubble of 1 mm": (Made(paint=(bubble(4.0, -3.0, 1.0),)), ("bubbles, lint, dust",)),
    "bubble of 2 mm": (Made(paint=(bubble(-7.0, 5.0, 2.0),)), ("bubbles, lint, dust",)),
    "bubble, finest patches": (
        Made(recipe="dense", paint=(bubble(2.0, 2.0, 1.0),)), ("bubbles, lint, dust",)),
    "bubble, fisheye": (
        Made(fisheye=True, paint=(bubble(9.0, 6.0, 1.0),)), ("bubbles, lint, dust",)),
    "lint": (Made(paint=(lint(-3.0, 1.0, 3.0),)), ("bubbles, lint, dust",)),
    "lint, finest patches": (
        Made(recipe="dense", paint=(lint(5.0, 4.0, 2.5),)), ("bubbles, lint, dust",)),
    "dust": (Made(paint=(speck(6.0, 2.0, 0.5),)), ("bubbles, lint, dust",)),
    "film torn at a corner": (
        Made(paint=(gone(lambda x, y: x - y > 22.0, 0.9),)), ("film",)),
    "film torn at a side": (
        Made(paint=(gone(lambda x, y: np.hypot(x, y - 11) < 3.0, 0.05),)), ("film",)),
    "sticker turned by 5 degrees": (Made(recipe="dense", move=turned(5.0)), ("turn",)),
    "sticker turned by 90 degrees": (Made(recipe="dense", move=turned(90.0)), ("turn",)),
    "mirrored": (Made(recipe="dense", move=((-1, 0, 0), (0, 1, 0))), ("mirror",)),
    "sticker aside, dots out of view": (Made(move=turned(0.0, 0.3, -2.0)), ("place",)),
    "film stretched": (Made(recipe="dense", move=turned(0.0, scale=1.06)), ("scale",)),
    "wrong pattern": (Made(recipe="iid"), ("recipe",)),
    "frame in view": (Made(paint=(gone(_band, 0.03),)), ("edges of the view",)),
    "touched at rest": (
        Made(images=12, press_mm=(0.0,) * 9 + (0.1, 0.2, 0.3)), ("at rest",)),
    "noisy": (
        Made(images=12, camera=ImageSensor(full_well_electrons=150.0, read_noise_electrons=10.0),
             paint=(light(lambda x, y: 0.5 + 0 * x),)),
        ("noise at rest", "at rest")),
}  # fmt: skip
