"""What a run needs of its rig and its disk: time, room, frames a second."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Sequence
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
LONGEST_S = 30 * 86400.0
LONG_S = 86400.0


def needs(
    protocol: Protocol,
    steps: list[Step],
    rig: RigConfig,
    view: CameraModel | None,
    out: Path,
    wall_clock: bool,
) -> list[LimitCheck]:
    """Rows of the least feed, the time, the disk and the camera's rate, see `budget`.

    view: of the images that are tracked. out: of the run, or any folder on its disk; what a run
    that goes on has there already is not needed again. wall_clock: whether frames that come too
    fast are lost.
    """
    px = image_px(view, rig)
    held_hz = record.rate_held_hz(record.image_format({"rig": rig.recorded()}), px)
    camera_hz = getattr(rig.camera, "rate_hz", None)
    return budget(
        protocol,
        steps,
        limits.estimate(protocol, px, rig.stage.box, steps),
        out,
        held_hz if camera_hz is None else min(held_hz, camera_hz),
        wall_clock=wall_clock,
        kept_mb=size_mb(out) if (out / "run.json").is_file() else 0.0,
    )


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
    rows = [_feed(steps), _time(estimate), _disk(estimate, out, kept_mb)]
    rates_hz = protocol.capture.rates_hz()
    if held_hz is not None and rates_hz and "image" in protocol.channels:
        kind = max(rates_hz, key=rates_hz.__getitem__)
        rate_hz, key = (
            rates_hz[kind],
            f"{kind}.rate_hz" if kind in ("hold", "retract") else "rate_hz",
        )
        over = rate_hz > held_hz
        rows.append(
            LimitCheck(
                "camera rate", not (over and wall_clock), "frames a second that can be kept",
                rate_hz, held_hz, f"capture.{key}", over and not wall_clock,
            )
        )  # fmt: skip
    return rows


def size_mb(folder: Path) -> float:
    """What stands in a run folder, in MB."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6


def _feed(steps: Iterable[Step]) -> LimitCheck:
    slowest = min(steps, key=lambda step: step.feed_mm_min)
    ok = slowest.feed_mm_min >= MIN_FEED_MM_MIN
    return LimitCheck(
        "least feed", ok, "feed (mm/min)", slowest.feed_mm_min, MIN_FEED_MM_MIN, slowest.id,
        least=True,
    )  # fmt: skip


def _time(estimate: RunEstimate) -> LimitCheck:
    hours, at = estimate.seconds / 3600, "the whole run"
    ok = estimate.seconds <= LONGEST_S
    return LimitCheck(
        "time", ok, "of the whole run (h)", hours, LONGEST_S / 3600, at,
        ok and estimate.seconds > LONG_S,
    )  # fmt: skip


def _disk(estimate: RunEstimate, out: Path, kept_mb: float) -> LimitCheck:
    where = next(p for p in (out.absolute(), *out.absolute().parents) if p.exists())
    free_mb = shutil.disk_usage(where).free / 1e6
    needed_mb = max(0.0, estimate.disk_mb - kept_mb)
    return LimitCheck(
        "disk", needed_mb <= free_mb, "needed of what is free (MB)", needed_mb, free_mb,
        f"the disk of {where}",
    )  # fmt: skip
