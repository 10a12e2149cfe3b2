"""What a run needs of its rig and its disk: time, room, frames a second."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from .. import record
from ..protocols import limits
from ..protocols.limits import LimitCheck, RunEstimate
from ..protocols.plan import Protocol, Step
from ..rig.camera.model import raw_size_px
from ..rig.config import RigConfig

if TYPE_CHECKING:
    from ..optics import CameraModel

USUAL_PX = (1280, 720)  # of a camera that does not say how large its images are
# The planner of GRBL 1.1 (MINIMUM_FEED_RATE of its config.h) takes anything slower for this, so
# that a press would be faster than its protocol says.
MIN_FEED_MM_MIN = 1.0
LONG_H, LONGEST_H = 24.0, 30 * 24.0


def needs(
    protocol: Protocol, steps: list[Step], rig: RigConfig, view: CameraModel | None, out: Path
) -> list[LimitCheck]:
    """Rows of the least feed, the time, the disk and the camera's rate, see `budget`.

    view: of the images that are tracked. out: of the run, or any folder on its disk; what a run
    that goes on has there already is not needed again.
    """
    px = image_px(view, rig)
    held_hz = record.rate_held_hz(record.image_format({"rig": rig.recorded()}), px)
    camera_hz = getattr(rig.camera, "rate_hz", None)
    estimate = limits.estimate(protocol, px, rig.stage, steps)
    kept_mb = size_mb(out) if (out / "run.json").is_file() else 0.0
    most_hz = held_hz if camera_hz is None else min(held_hz, camera_hz)
    return budget(protocol, steps, estimate, out, most_hz, not rig.simulated, kept_mb)


def image_px(view: CameraModel | None, rig: RigConfig) -> int:
    """Pixels of a frame as it is stored. view: of the images that are tracked."""
    if view is not None:
        width_px, height_px = raw_size_px(view)
    else:
        declared = getattr(rig.camera, "width_px", None), getattr(rig.camera, "height_px", None)
        width_px, height_px = (a or b for a, b in zip(declared, USUAL_PX, strict=True))
    return width_px * height_px


def budget(
    protocol: Protocol,
    steps: Sequence[Step],
    estimate: RunEstimate,
    out: Path,
    held_hz: float | None,
    wall_clock: bool = True,
    kept_mb: float = 0.0,
) -> list[LimitCheck]:
    """Rows of the least feed, the time, the disk and the camera's rate.

    out: of the run, or any folder on its disk. held_hz: frames a second that camera, format and
    disk hold; None without a camera. wall_clock: whether time passes by itself, so that a rate
    that is too high loses frames; on a rig that waits it is a warning. kept_mb: there already, of a
    run that goes on.
    """
    slowest = min(steps, key=lambda step: step.feed_mm_min)
    feed = slowest.feed_mm_min
    hours, at = estimate.seconds / 3600, "the whole run"
    where = next(p for p in (out.absolute(), *out.absolute().parents) if p.exists())
    free_mb, mb = shutil.disk_usage(where).free / 1e6, max(0.0, estimate.disk_mb - kept_mb)
    rows = [
        LimitCheck("least feed", feed >= MIN_FEED_MM_MIN, "feed (mm/min)", feed, MIN_FEED_MM_MIN,
                   slowest.id, least=True),
        LimitCheck("time", hours <= LONGEST_H, "of the whole run (h)", hours, LONGEST_H, at,
                   LONG_H < hours <= LONGEST_H),
        LimitCheck("disk", mb <= free_mb, "needed of what is free (MB)", mb, free_mb,
                   f"the disk of {where}"),
    ]  # fmt: skip
    rates_hz = protocol.capture.rates_hz()
    if held_hz is not None and rates_hz and "image" in protocol.channels:
        kind = max(rates_hz, key=rates_hz.__getitem__)
        table = f"{kind}." if kind in ("hold", "retract") else ""
        over, what = rates_hz[kind] > held_hz, "frames a second that can be kept"
        rows.append(
            LimitCheck("camera rate", not (over and wall_clock), what, rates_hz[kind], held_hz,
                       f"capture.{table}rate_hz", over and not wall_clock)
        )  # fmt: skip
    return rows


def size_mb(folder: Path) -> float:
    """What stands in a run folder, in MB."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6
