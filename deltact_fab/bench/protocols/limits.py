"""Static checks: everything that can be known wrong before anything moves.

Each check is a row with the figure, its bound and the worst step, so that a lab sees the margin as
well as the verdict.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from deltact_fab.common import Check, graded
from deltact_fab.sensor import SensorDimensions, parse_indenter

from .motion import (
    LOCKSTEP,
    WALL_CLOCK,
    StageConfig,
    homing_s,
    move_duration_s,
    subtract_vectors,
)
from .plan import Protocol, Step, expand_protocol

PNG_BYTES_PER_PX = 2.2  # measured on rendered frames of a dense pattern: 1.9-2.3
FORCE_BYTES_PER_S = 14_000  # measured on the simulated sensor at 1 kHz, noise 0.01 N
EPS_MM = 1e-9
MAX_BETWEEN_FRAMES_MM = 0.25  # up to 7 pixels: as in `deep-drag`, which is followed throughout


def ends_mm(travel_mm: float, at_top: bool, pull_off_mm: float) -> tuple[float, float]:
    """How low and how high an axis may go: its switch, at 0 or at the other end, trips there."""
    return (-travel_mm, -pull_off_mm) if at_top else (pull_off_mm - travel_mm, 0.0)


@dataclass(frozen=True)
class RunEstimate:
    """Estimate of what a run takes: connecting, homing, planned motion, settling and waits.

    What an operator takes between two indenters is left out.
    between_frames_mm: the longest way that the tip goes unseen while it presses or drags.
    """

    steps: int
    presses: int
    frames: int
    settled: int
    between_frames_mm: float
    seconds: float
    disk_mb: float

    @classmethod
    def of(
        cls,
        protocol: Protocol,
        image_px: int,
        stage: StageConfig,
        steps: list[Step] | None = None,
        wall_clock: bool = False,
        change_s: float = 0.0,
    ) -> RunEstimate:
        """Frames, time and disk of a whole run, from the steps and the stage's acceleration.

        image_px: pixels of a frame as it is stored. wall_clock: on a rig that does not
        wait. change_s: what finding the face with another indenter takes.
        """
        steps = expand_protocol(protocol) if steps is None else steps
        pace = WALL_CLOCK if wall_clock else LOCKSTEP
        here = stage.frame.to_sensor_mm(stage.homed_mm)
        homing = stage.homing_s if stage.homing_s is not None else homing_s(stage.travel_mm)
        seconds = pace.connect_s + homing
        for step in steps:
            seconds += move_duration_s(
                subtract_vectors(step.target_mm, here),
                step.feed_mm_min,
                stage.max_feed_mm_min,
                stage.acceleration_mm_s2,
            )
            seconds += change_s if step.kind == "change" else 0.0
            seconds += (
                pace.move_s + step.hold_s + (step.settle_s + pace.frames_s if step.frames else 0.0)
            )
            here = step.target_mm
        frames = sum(s.frames for s in steps)
        px = image_px if "image" in protocol.channels else 0
        stream_bytes = FORCE_BYTES_PER_S * seconds if "force" in protocol.channels else 0
        return cls(
            steps=len(steps),
            presses=len({s.press for s in steps if s.kind == "press"}),
            frames=frames,
            settled=sum(s.settled for s in steps),
            between_frames_mm=float(_unseen(steps).value) if "image" in protocol.channels else 0.0,
            seconds=seconds,
            disk_mb=(frames * (px * PNG_BYTES_PER_PX + 2000) + stream_bytes) / 1e6,
        )


def check_limits(
    protocol: Protocol,
    sensor: SensorDimensions,
    stage: StageConfig,
    steps: list[Step] | None = None,
) -> list[Check]:
    """All static checks of a protocol on a sensor and a stage, passed ones included."""
    steps = expand_protocol(protocol) if steps is None else steps
    rows = [*_travel(steps, stage), *_feeds(steps, stage), _depth(steps, protocol, sensor)]
    rows += [_tip_reach(steps), *_opening(steps, sensor), _sideways(steps, protocol)]
    if "image" in protocol.channels:
        rows += [_unseen(steps)]
    return [*rows, _names(steps)]


def _worst(pairs: Iterable[tuple[float, str]]) -> tuple[float, str]:
    return max(pairs, default=(0.0, "-"))


def _travel(steps: list[Step], stage: StageConfig) -> Iterable[Check]:
    frame = stage.frame
    for axis, letter in enumerate("xyz"):
        at_top = stage.homed_mm[axis] == 0
        bottom_mm, top_mm = ends_mm(stage.travel_mm[axis], at_top, stage.pull_off_mm)
        high, at_high = _worst((frame.to_machine_mm(s.target_mm)[axis], s.id) for s in steps)
        low, at_low = _worst((-frame.to_machine_mm(s.target_mm)[axis], s.id) for s in steps)
        for way, far, most_mm, at in (("", high, top_mm, at_high), ("-", low, -bottom_mm, at_low)):
            id, what = f"travel.{'low' if way else 'high'}-{letter}", f"machine {way}{letter} (mm)"
            status = graded(far <= most_mm + EPS_MM)
            yield Check.at_most(id, "travel", what, far, most_mm, at, status)


def _names(steps: list[Step]) -> Check:
    """A record keeps each step under its own name, which has depths and ways to 0.01 mm."""
    twice = [name for name, times in Counter(s.id for s in steps).items() if times > 1]
    where = twice[0] if twice else "-"
    what, status = "stops less than 0.01 mm apart", graded(not twice)
    return Check.at_most("step-names", "step names", what, len(twice), 0, where, status)


def _feeds(steps: list[Step], stage: StageConfig) -> Iterable[Check]:
    slowest = min(stage.max_feed_mm_min)
    feed, at = _worst((s.feed_mm_min, s.id) for s in steps)
    status = graded(feed <= slowest)
    yield Check.at_most("feed", "feed", "feed (mm/min)", feed, slowest, at, status)


def _depth(steps: list[Step], protocol: Protocol, sensor: SensorDimensions) -> Check:
    bound = sensor.skin.thickness_mm - protocol.specimen.depth_margin_mm
    depth, at = _worst((-s.target_mm[2], s.id) for s in steps)
    name, status = "depth against the gel", graded(depth <= bound)
    return Check.at_most("depth.gel", name, "depth (mm)", depth, bound, at, status)


def _tip_reach(steps: list[Step]) -> Check:
    """Tips and shanks must be as long as they are pressed, or the back plate would touch."""
    over = [(-s.target_mm[2] / parse_indenter(s.indenter).reach_mm, s.id) for s in steps]
    share, at = _worst(over)
    name, what = "depth against the tip", "depth / free length of the tip"
    return Check.at_most("depth.tip", name, what, share, 1.0, at, graded(share <= 1.0))


def _opening(steps: list[Step], sensor: SensorDimensions) -> Iterable[Check]:
    for axis, letter in enumerate("xy"):
        bound = sensor.skin.opening_half_mm[axis]
        reach, at = _worst(
            (abs(s.target_mm[axis]) + parse_indenter(s.indenter).footprint_half_mm[axis], s.id)
            for s in steps
            if s.kind in ("press", "shear")
        )
        name, what = "footprint + shear inside the skin", f"reach in {letter} (mm)"
        status = graded(reach <= bound + EPS_MM)
        yield Check.at_most(f"footprint.{letter}", name, what, reach, bound, at, status)


def _sideways(steps: list[Step], protocol: Protocol) -> Check:
    """Sideways travel only at or above the clearance plane, unless it is declared shear."""
    clearance_mm = protocol.motion.clearance_mm
    worst, at = 0.0, "-"
    for before, step in itertools.pairwise(steps):
        sideways = step.target_mm[:2] != before.target_mm[:2]
        low_mm = min(before.target_mm[2], step.target_mm[2])
        if sideways and step.kind != "shear" and clearance_mm - low_mm > worst:
            worst, at = clearance_mm - low_mm, step.id
    what, status = "sideways below clearance by (mm)", graded(worst <= EPS_MM)
    return Check.at_most("clearance-plane", "clearance plane", what, worst, 0.0, at, status)


def _unseen(steps: list[Step]) -> Check:
    """How far the tip goes between two frames: a tracker takes long steps for new faces."""
    way_mm, at = _worst(
        (math.dist(before.target_mm, step.target_mm) / max(step.frames, 1), step.id)
        for before, step in itertools.pairwise(steps)
        if step.kind in ("press", "shear") or (step.kind == "retract" and step.frames)
    )
    bound, what = MAX_BETWEEN_FRAMES_MM, "travel of the tip (mm)"
    status = graded(True, warns=way_mm > bound + EPS_MM)
    return Check.at_most(
        "motion-between-frames", "motion between frames", what, way_mm, bound, at, status
    )
