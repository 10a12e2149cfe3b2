"""Static checks of a protocol, before anything moves.

Each check gives the value, its limit and the worst step, so the margin is visible as well.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from deltact_fab.common import Check, graded
from deltact_fab.sensor import SensorDimensions, parse_indenter

from .motion import LOCKSTEP_PACE, RigPace, StageConfig, homing_s, move_duration_s, subtract_vectors
from .plan import Protocol, Step, expand_protocol
from .presses import Press

PNG_BYTES_PER_PX = 2.2  # measured on rendered frames of a dense pattern: 1.9-2.3
FORCE_BYTES_PER_S = 14_000  # measured on the simulated sensor at 1 kHz, noise 0.01 N
LIMIT_SLACK_MM = 1e-9  # by hand: floating-point rounding of targets
MAX_RECOVERY_SHARE = 0.01  # by hand: of the long-term deformation; the force sensor's noise
MAX_BETWEEN_FRAMES_MM = 0.25  # 7 px, as in `deep-drag`, tracked throughout: docs/evidence/flow.md


def axis_range_mm(travel_mm: float, at_top: bool, pull_off_mm: float) -> tuple[float, float]:
    """Lowest and highest position of an axis; its limit switch is at 0 or at the other end."""
    return (-travel_mm, -pull_off_mm) if at_top else (pull_off_mm - travel_mm, 0.0)


@dataclass(frozen=True)
class RunEstimate:
    """Estimated resources of a run: connecting, homing, motion, settling and waits.

    The operator's time to change indenters is not included.
    between_frames_mm: longest tip travel between two frames in contact.
    """

    steps: int
    presses: int
    frames: int
    settled: int
    between_frames_mm: float
    seconds: float
    disk_mb: float

    @classmethod
    def from_protocol(
        cls,
        protocol: Protocol,
        image_px: int,
        stage: StageConfig,
        steps: list[Step] | None = None,
        pace: RigPace = LOCKSTEP_PACE,
        change_s: float = 0.0,
    ) -> RunEstimate:
        """Estimate frames, time and disk space from the steps and the stage's acceleration.

        image_px: pixels of a stored frame. pace: of the rig. change_s: time to find the face with
        another indenter.
        """
        steps = expand_protocol(protocol) if steps is None else steps
        seconds = cls.planned_ends_s(steps, stage, pace, change_s)[-1]
        frames = sum(s.frames for s in steps)
        filmed = "image" in protocol.channels
        px = image_px if filmed else 0
        stream_bytes = FORCE_BYTES_PER_S * seconds if "force" in protocol.channels else 0
        return cls(
            steps=len(steps),
            presses=len({s.press for s in steps if s.kind == "press"}),
            frames=frames,
            settled=sum(s.settled for s in steps),
            between_frames_mm=float(_frame_spacing(steps).value) if filmed else 0.0,
            seconds=seconds,
            disk_mb=(frames * (px * PNG_BYTES_PER_PX + 2000) + stream_bytes) / 1e6,
        )

    @staticmethod
    def planned_ends_s(
        steps: Sequence[Step],
        stage: StageConfig,
        pace: RigPace = LOCKSTEP_PACE,
        change_s: float = 0.0,
    ) -> list[float]:
        """End times (n + 1,) of homing and of each step, from the start of the run, as planned."""
        position = stage.frame.to_sensor_mm(stage.homed_mm)
        homing = stage.homing_s if stage.homing_s is not None else homing_s(stage.travel_mm)
        seconds = pace.connect_s + homing
        ends_s = [seconds]
        for step in steps:
            delta_mm, limits = subtract_vectors(step.target_mm, position), stage.max_feed_mm_min
            seconds += move_duration_s(delta_mm, step.feed_mm_min, limits, stage.acceleration_mm_s2)
            seconds += change_s if step.kind == "change" else 0.0
            frames_s = step.settle_s + pace.frames_s if step.frames else 0.0
            seconds += pace.move_s + step.hold_s + frames_s
            position = step.target_mm
            ends_s.append(seconds)
        return ends_s


def check_limits(
    protocol: Protocol,
    sensor: SensorDimensions,
    stage: StageConfig,
    steps: list[Step] | None = None,
) -> list[Check]:
    """Run all static checks of a protocol on a sensor and a stage; passed ones included."""
    steps = expand_protocol(protocol) if steps is None else steps
    rows = [*_travel(steps, stage), *_feeds(steps, stage), _depth(steps, protocol, sensor)]
    rows += [_tip_reach(steps), *_opening(steps, sensor), _sideways(steps, protocol)]
    if "image" in protocol.channels:
        rows += [_frame_spacing(steps)]
    if protocol.specimen.prony:
        rows += [_recovery(steps, protocol, sensor, stage)]
    return [*rows, _names(steps)]


def _worst(pairs: Iterable[tuple[float, str]]) -> tuple[float, str]:
    return max(pairs, default=(0.0, "-"))


def _travel(steps: list[Step], stage: StageConfig) -> Iterable[Check]:
    frame = stage.frame
    for axis, letter in enumerate("xyz"):
        at_top = stage.homed_mm[axis] == 0
        bottom_mm, top_mm = axis_range_mm(stage.travel_mm[axis], at_top, stage.pull_off_mm)
        high, at_high = _worst((frame.to_machine_mm(s.target_mm)[axis], s.id) for s in steps)
        low, at_low = _worst((-frame.to_machine_mm(s.target_mm)[axis], s.id) for s in steps)
        ends = ("high", "", high, top_mm, at_high), ("low", "-", low, -bottom_mm, at_low)
        for end, sign, value, limit, step_id in ends:
            id, subject = f"travel.{end}-{letter}", f"machine {sign}{letter} (mm)"
            status = graded(value <= limit + LIMIT_SLACK_MM)
            yield Check.at_most(id, "travel", subject, value, limit, step_id, status)


def _names(steps: list[Step]) -> Check:
    """Check that step names, which have depths and drags to 0.01 mm, are unique."""
    twice = [name for name, times in Counter(s.id for s in steps).items() if times > 1]
    step_id = twice[0] if twice else "-"
    subject, status = "stops less than 0.01 mm apart", graded(not twice)
    return Check.at_most("step-names", "step names", subject, len(twice), 0, step_id, status)


def _feeds(steps: list[Step], stage: StageConfig) -> Iterable[Check]:
    slowest = min(stage.max_feed_mm_min)
    feed, step_id = _worst((s.feed_mm_min, s.id) for s in steps)
    status = graded(feed <= slowest)
    yield Check.at_most("feed", "feed", "feed (mm/min)", feed, slowest, step_id, status)


def _depth(steps: list[Step], protocol: Protocol, sensor: SensorDimensions) -> Check:
    bound = sensor.skin.thickness_mm - protocol.specimen.depth_margin_mm
    depth, step_id = _worst((-s.target_mm[2], s.id) for s in steps)
    name, status = "depth in the gel", graded(depth <= bound)
    return Check.at_most("depth.gel", name, "depth (mm)", depth, bound, step_id, status)


def _tip_reach(steps: list[Step]) -> Check:
    """Check that tip and shank are longer than the depth; else the back plate touches."""
    over = [(-s.target_mm[2] / parse_indenter(s.indenter).reach_mm, s.id) for s in steps]
    share, step_id = _worst(over)
    name, subject = "free length of the tip", "depth / free length of the tip"
    return Check.at_most("depth.tip", name, subject, share, 1.0, step_id, graded(share <= 1.0))


def _opening(steps: list[Step], sensor: SensorDimensions) -> Iterable[Check]:
    for axis, letter in enumerate("xy"):
        bound = sensor.skin.opening_half_mm[axis]
        reach, step_id = _worst(
            (abs(s.target_mm[axis]) + parse_indenter(s.indenter).footprint_half_mm[axis], s.id)
            for s in steps
            if s.kind in ("press", "shear")
        )
        name, subject = "contact on the skin", f"reach in {letter} (mm)"
        status = graded(reach <= bound + LIMIT_SLACK_MM)
        if status == "fail":
            subject += f"; {_passing_places(steps, axis, step_id, bound)}"
        yield Check.at_most(f"footprint.{letter}", name, subject, reach, bound, step_id, status)


def _passing_places(steps: list[Step], axis: int, step_id: str, bound_mm: float) -> str:
    """Positions on which the indenter of a failed step passes, drags included."""
    failed = next(step for step in steps if step.id == step_id)
    indenter = parse_indenter(failed.indenter)
    way_mm = [s.target_mm[axis] for s in steps if s.press == failed.press]
    drag_mm = max(abs(place - way_mm[0]) for place in way_mm)
    place_mm = bound_mm - indenter.footprint_half_mm[axis] - drag_mm
    if place_mm < 0:
        return f"no place on this face for {indenter.name}; use a smaller one"
    return f"places within +-{math.floor(place_mm * 100) / 100:g} mm for {indenter.name}"


def _sideways(steps: list[Step], protocol: Protocol) -> Check:
    """Check that sideways travel stays above the clearance plane, except for shear."""
    clearance_mm = protocol.motion.clearance_mm
    worst, step_id = 0.0, "-"
    for previous, step in itertools.pairwise(steps):
        sideways = step.target_mm[:2] != previous.target_mm[:2]
        low_mm = min(previous.target_mm[2], step.target_mm[2])
        if sideways and step.kind != "shear" and clearance_mm - low_mm > worst:
            worst, step_id = clearance_mm - low_mm, step.id
    subject, status = "sideways motion below the plane by (mm)", graded(worst <= LIMIT_SLACK_MM)
    return Check.at_most("clearance-plane", "clearance plane", subject, worst, 0.0, step_id, status)


def _recovery(
    steps: list[Step], protocol: Protocol, sensor: SensorDimensions, stage: StageConfig
) -> Check:
    """Check that the gel has recovered from the presses near a place before the next one there.

    Near: the contacts are less than a gel's thickness apart. What is left decays with the
    specimen's series, as after a long press.
    """
    prony, ends_s = protocol.specimen.prony, RunEstimate.planned_ends_s(steps, stage)
    total = 1 + math.fsum(g for g, _ in prony)

    def creep_share(rest_s: float) -> float:
        return math.fsum(g / total * math.exp(-rest_s / tau_s) for g, tau_s in prony)

    radius_mm = {s.indenter: max(parse_indenter(s.indenter).footprint_half_mm) for s in steps}
    presses = {p.name: p for p in protocol.list_presses()}
    released: list[tuple[float, Press]] = []
    worst = 0.0, "-", 0.0
    for start_s, end_s, step in zip(ends_s, ends_s[1:], steps, strict=False):
        if step.kind == "approach":
            press = presses[step.press]
            for since_s, previous in reversed(released):
                rest_s = start_s - since_s
                if creep_share(rest_s) <= max(MAX_RECOVERY_SHARE, worst[0]):
                    break
                reach_mm = sum(radius_mm[p.indenter] for p in (press, previous))
                if math.dist(press.at_mm, previous.at_mm) < reach_mm + sensor.skin.thickness_mm:
                    worst = creep_share(rest_s), press.name, rest_s
                    break
        elif step.kind == "retract":
            released.append((end_s, presses[step.press]))
    share, name, rest_s = worst
    needed_s = max(tau_s * math.log(max(len(prony) * g / total / MAX_RECOVERY_SHARE, 1))
                   for g, tau_s in prony)  # fmt: skip
    subject = "remaining creep of the previous press nearby, as a share"
    if share:
        more_s = math.ceil(needed_s - rest_s)
        subject += f" (after {rest_s:.0f} s of rest; {more_s} s more as capture.settle_s.rest)"
    status = graded(True, warns=share > MAX_RECOVERY_SHARE)
    return Check.at_most("recovery", "recovery", subject, share, MAX_RECOVERY_SHARE, name, status)


def _frame_spacing(steps: list[Step]) -> Check:
    """Check the tip travel between two frames: trackers lose the face in long steps."""
    spacing_mm, step_id = _worst(
        (math.dist(previous.target_mm, step.target_mm) / max(step.frames, 1), step.id)
        for previous, step in itertools.pairwise(steps)
        if step.kind in ("press", "shear") or (step.kind == "retract" and step.frames)
    )
    bound, subject = MAX_BETWEEN_FRAMES_MM, "travel of the tip (mm)"
    status = graded(True, warns=spacing_mm > bound + LIMIT_SLACK_MM)
    id, name = "motion-between-frames", "motion between frames"
    return Check.at_most(id, name, subject, spacing_mm, bound, step_id, status)
