"""What a protocol takes: time, disk, frames a second; checked before anything moves."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path

from .limits import LimitCheck, RunEstimate
from .plan import Protocol, Step

# The planner of GRBL 1.1 (MINIMUM_FEED_RATE of its config.h) takes anything slower for this, so
# that a press would be faster than its protocol says.
MIN_FEED_MM_MIN = 1.0
LONGEST_S = 30 * 86400.0
LONG_S = 86400.0


def check(
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
    rate_hz = protocol.capture.rate_hz
    if held_hz is not None and rate_hz is not None and "image" in protocol.channels:
        over = rate_hz > held_hz
        rows.append(
            LimitCheck(
                "camera rate", not (over and wall_clock), "frames a second that can be kept",
                rate_hz, held_hz, "capture.rate_hz", over and not wall_clock,
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
