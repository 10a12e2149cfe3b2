"""What a run needs of its rig and its disk: time, room, frames a second."""

from __future__ import annotations

from pathlib import Path

from .. import record
from ..optics import Rectified
from ..protocols import budget, limits
from ..protocols.plan import Protocol, Step
from ..rig.config import RigConfig
from ..rig.job import RigKind
from ..shapes import SensorDimensions

USUAL_PX = (1280, 720)  # of a camera that does not say how large its images are


def needs(
    protocol: Protocol,
    sensor: SensorDimensions,
    steps: list[Step],
    rig: RigConfig,
    kind: RigKind,
    out: Path,
    wall_clock: bool,
) -> list[limits.LimitCheck]:
    """Rows of the least feed, the time, the disk and the camera's rate, see `protocols.budget`.

    out: of the run, or any folder on its disk; what a run that goes on has there already is not
    needed again. wall_clock: whether frames that come too fast are
    lost. Raises InputError for a calibration that is of no use.
    """
    px = image_px(protocol, sensor, rig, kind)
    held_hz = record.rate_held_hz(record.image_format({"rig": rig.recorded()}), px)
    camera_hz = getattr(rig.camera, "rate_hz", None)
    return budget.check(
        protocol,
        steps,
        limits.estimate(protocol, px, rig.stage.box),
        out,
        held_hz if camera_hz is None else min(held_hz, camera_hz),
        wall_clock=wall_clock,
        kept_mb=budget.size_mb(out) if (out / "run.json").is_file() else 0.0,
    )


def image_px(protocol: Protocol, sensor: SensorDimensions, rig: RigConfig, kind: RigKind) -> int:
    """Pixels of a frame as it is stored. Raises InputError for a calibration that is of no use."""
    camera = kind.camera(protocol, sensor)
    if camera is not None:
        stored = camera.lens if isinstance(camera, Rectified) else camera
        return stored.width_px * stored.height_px
    declared = getattr(rig.camera, "width_px", None), getattr(rig.camera, "height_px", None)
    width_px, height_px = (a or b for a, b in zip(declared, USUAL_PX, strict=True))
    return width_px * height_px
