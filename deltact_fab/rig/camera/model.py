"""What is known of a rig's camera from its calibration: the view that is tracked, and the light.

The same for a real camera and a simulated one: both know their lens only as it was calibrated.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ...optics import (
    CameraModel,
    Fisheye,
    FlatField,
    Rectified,
    aliased_share,
    load_camera,
    raw_mm_per_px,
)
from ...optics.rectified import MIN_PX
from ...reading import is_file
from ...shapes import SensorDimensions
from ..tables import CameraConfig

NOTICED = 0.005
"""Share of the view that may alias without a word."""


def calibrated(path: Path, source: str = "camera.model") -> CameraModel:
    """The camera of a camera file; source: what names it in a rig file. Raises InputError."""
    if not is_file(path):
        raise InputError(f"{source}: {path}: no such file; `deltact-fab calibrate lens` makes one")
    return load_camera(path)[0]


def tracked_view(
    config: CameraConfig, sensor: SensorDimensions, source: Path
) -> CameraModel | None:
    """The view that trackers take of a real camera's images, None where it was not calibrated.

    A fisheye's is rectified at the design's scale. source: of the rig file. Raises InputError for a
    camera file that is missing or of images of another size.
    """
    if config.model is None:
        return None
    path = source.parent / config.model
    camera = calibrated(path, f"{source}: camera.model")
    if config.width_px is not None:
        made, asked = raw_size_px(camera), (config.width_px, config.height_px)
        if made != asked:
            raise InputError(
                f"{source}: camera.width_px, height_px: {asked[0]} x {asked[1]} px, and {path} is "
                f"of images of {made[0]} x {made[1]} px"
            )
    return Rectified.of(sensor, camera) if isinstance(camera, Fisheye) else camera


def flat_field(model: str | None, source: Path) -> FlatField | None:
    """How the light falls off over raw images, where the camera file says it. Raises InputError."""
    return None if model is None else FlatField.beside(source.parent / model)


def raw_size_px(camera: CameraModel) -> tuple[int, int]:
    """Width and height of the raw images that a camera's view is made from."""
    raw: Any = getattr(camera, "lens", camera)
    return raw.width_px, raw.height_px


def view_notes(view: CameraModel | None, patch_mm: float | None) -> list[str]:
    """What a reader of a run through a view must know.

    view: None: not calibrated. patch_mm: side of the pattern's patches, None without.
    """
    if view is None:
        return [
            "WARNING: the camera is not calibrated: its images are kept, and nothing can be "
            "tracked in them; `deltact-fab calibrate lens` makes a file to name as [camera] model"
        ]
    if not isinstance(view, Rectified):
        return []
    w, h = view.width_px, view.height_px
    scales = raw_mm_per_px(view, np.array([[w / 2, h / 2], [0, 0], [w, 0], [0, h], [w, h]]))
    middle, corner = scales[0].min(), scales[1:].max()
    lines = [f"pixel scale: {middle:.3f} mm in the middle, {corner:.3f} mm in the corners"]
    aliased = 0.0 if patch_mm is None else aliased_share(view, patch_mm)
    if aliased >= NOTICED:
        lines.append(
            f"WARNING: patches of {patch_mm:g} mm alias over {aliased:.0%} of the view: the lens "
            f"has less than {MIN_PX:g} pixels for one there"
        )
    return [*lines, "images are stored raw and rectified when they are read"]
