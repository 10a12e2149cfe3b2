"""Looking through a camera until it is over."""

from __future__ import annotations

from deltact_fab.bench.rig.interface import Camera, CameraFrame
from deltact_fab.common.errors import SensorError

MOST = 1000


def to_the_end(camera: Camera) -> tuple[list[CameraFrame], str]:
    """Every frame that comes, and the line that the camera ends with; it is closed."""
    frames: list[CameraFrame] = []
    why = ""
    try:
        while len(frames) < MOST:
            frames.append(camera.capture())
    except SensorError as error:
        why = str(error)
    camera.close()
    assert why, "it does not end"
    assert "\n" not in why
    return frames, why
