"""What an ordinary camera does to an image: each key of a rig's camera by itself."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from deltact_fab.physics.imaging import Exposure, view_grid
from deltact_fab.sensor.shapes.imaging import ImageSensor

H, W = 240, 320


class ThreeChips(ImageSensor):
    mosaic = False


EVEN = np.full((H, W, 3), 0.4, np.float32)


def exposed(
    light: NDArray[np.float32], depth_mm: Any = None, mosaic: bool = True, **keys: Any
) -> NDArray[np.uint8]:
    """Without noise and falloff, but for what is said."""
    still = {"shading": 0.0, "read_noise_electrons": 0.0, "full_well_electrons": 1e7}
    exposure = Exposure((ImageSensor if mosaic else ThreeChips)(**(still | keys)), view_grid(H, W))
    return exposure.expose(light, np.random.default_rng(0), depth_mm)


def colours(seed: int = 1) -> NDArray[np.float32]:
    """A random colour a pixel, smooth over two."""
    noise = np.random.default_rng(seed).random((H, W, 3), dtype=np.float32)
    return cv2.GaussianBlur(noise, (0, 0), 1.0)


def fine(channel: NDArray[Any]) -> NDArray[np.float64]:
    """Power of what changes from pixel to pixel along x and along y."""
    steps = (np.diff(channel.astype(float), 2, axis=a) for a in (1, 0))
    return np.array([np.mean(s**2) for s in steps])


def pairs(channel: NDArray[Any]) -> NDArray[np.float64]:
    """Power of what differs within pairs of columns, and of rows."""
    c = channel.astype(float)
    return np.array([np.mean((c[:, ::2] - c[:, 1::2]) ** 2), np.mean((c[::2] - c[1::2]) ** 2)])


def test_led_light_peaks_at_the_edge() -> None:
    linear = (exposed(EVEN, led_gradient=4.0).astype(float) / 255) ** 2.2
    assert linear[0, 0, 1] / linear[H // 2, W // 2, 1] == pytest.approx(4, rel=0.05)


def test_contact_glow_saturates_to_white() -> None:
    depth = np.zeros((H, W), np.float32)
    depth[:, W // 2 :] = 2.0
    image = exposed(EVEN, depth, contact_glow_per_mm=1.0)
    assert image[:, W - 20].min() == 255
    assert np.array_equal(image[:, 20], exposed(EVEN)[:, 20])
    assert np.array_equal(exposed(EVEN, None, contact_glow_per_mm=1.0), exposed(EVEN))


def test_corners_are_less_sharp() -> None:
    image = exposed(colours(), corner_blur_px=2.0, blur_px=0.3)[..., 1]
    corner, middle = fine(image[:40, :40]), fine(image[100:140, 140:180])
    assert (corner < 0.5 * middle).all()


@pytest.mark.parametrize(
    ("format_", "halved"),
    [("yuyv", (1, 0)), ("mjpeg-422", (1, 0)), ("nv12", (1, 1)), ("mjpeg-420", (1, 1))],
)
def test_chroma_is_subsampled_luma_is_not(format_: str, halved: tuple[int, int]) -> None:
    keys = {"mosaic": False, "blur_px": 0.3, "jpeg_quality": 95}
    whole, sent = (
        cv2.split(cv2.cvtColor(exposed(colours(), format=f, **keys), cv2.COLOR_BGR2YCrCb))
        for f in ("raw", format_)
    )
    assert fine(sent[0]) / fine(whole[0]) == pytest.approx(1, abs=0.15)
    kept = pairs(sent[1]) / pairs(whole[1])
    for share, half in zip(kept, halved, strict=True):
        assert (share < 0.5) if half else (share > 0.6)
