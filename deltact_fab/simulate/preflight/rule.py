"""Limits of a rig and of the plate behind the gel; time, disk and rates that a run needs.

On a real rig a predicted peak over a declared limit, and a limit that is not declared, are errors
before anything moves; the simulated one cannot break, and warns.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

from deltact_fab.bench import (
    GuardLimits,
    ImageFormat,
    Protocol,
    RigConfig,
    RunEstimate,
    StageConfig,
    Step,
    raw_size_px,
)
from deltact_fab.common import Check, InputError, Point, graded
from deltact_fab.fabricate import Design, plate_bending_room, press_plate

from .peaks import HIGH_TEXT, MODULUS_FACTOR, Peak, worst_press

if TYPE_CHECKING:
    from deltact_fab.sensor import CameraModel


@dataclass(frozen=True)
class ForceLimits:
    """Force limits of a rig file; None: not declared.

    source: the rig file. stage_n: `[stage] max_force_n`. sensor_n, sensor_nmm: `[force] range_n`
    and `range_nmm`. origin_mm: `[force] origin_mm`. has_sensor: a sensor is in the way of the
    force, whether its channel is recorded or not. guard: where it stops the stage; None: nothing
    guards. guard_keys: where its limits of force and of torque stand.
    """

    simulated: bool
    source: str
    stage_n: Point | None
    has_sensor: bool = False
    sensor_n: Point | None = None
    sensor_nmm: Point | None = None
    origin_mm: Point | None = None
    guard: GuardLimits | None = None
    guard_keys: tuple[str, str] = ("", "")

    def undeclared(self) -> list[str]:
        """Keys that a real rig has to declare and this one does not.

        Torque ranges need the origin that torques count from; without one they are not checked.
        """
        keys = [] if self.stage_n else ["[stage] max_force_n"]
        if self.has_sensor and not self.sensor_n:
            keys.append("[force] range_n")
        if self.has_sensor and self.origin_mm and not self.sensor_nmm:
            keys.append("[force] range_nmm")
        return keys


def limits_of(rig: RigConfig, source: str, protocol: Protocol) -> ForceLimits:
    """The limits that a rig file declares; a default that it does not write down is none.

    Raises InputError for a guard whose limit the sensor cannot measure.
    """
    force = rig.force if "force" in rig.model_fields_set else None
    guard, keys = None, ("", "")
    if rig.force is not None and not rig.simulated:
        try:
            guard, keys = GuardLimits.from_config(rig.guard, rig.force), GuardLimits.keys(rig.guard)
        except InputError as error:
            raise InputError(f"{source}: {error}") from error
    declared = force.model_fields_set if force is not None else set()
    return ForceLimits(
        simulated=rig.simulated, source=source, stage_n=rig.stage.max_force_n,
        has_sensor=force is not None or "force" in protocol.channels,
        sensor_n=force.range_n if force and "range_n" in declared else None,
        sensor_nmm=force.range_nmm if force and "range_nmm" in declared else None,
        origin_mm=force.origin_mm if force else None, guard=guard, guard_keys=keys,
    )  # fmt: skip


def force_checks(peaks: Sequence[Peak], limits: ForceLimits) -> list[Check]:
    """A row for each limit with its worst press, and one for the limits that are not declared.

    What can break counts with the gel's modulus twice as high. The guard loses a run and no gel: it
    counts as predicted, and warns of what twice the modulus would trip. On the simulated rig
    everything only warns.
    """
    rows = []
    if missing := limits.undeclared():
        text = "is not declared, so the force on it cannot be checked"
        lines = [f"{limits.source}: {key} {text}" for key in missing]
        row = Check.refusal("force-limits", "force limits", lines)
        rows.append(replace(row, status=graded(limits.simulated, warns=True)))
    for name, limit_loads in (("peak force", _device_loads), ("guard", _guard_loads)):
        for id, label, limit, key, loads in limit_loads(limits, peaks):
            load, press = worst_press(loads, peaks)
            high = MODULUS_FACTOR * load
            fails = (high if name == "peak force" else load) > limit
            if name == "peak force" or (high > limit and not fails):
                load, text = high, f"{label} {HIGH_TEXT}, {key}"
            else:
                text = f"{label} as predicted, {key}"
            status = graded(limits.simulated or not fails, warns=load > limit)
            rows.append(Check.at_most(id, name, text, round(load, 1), limit, press, status))
    return rows


def stop_checks(
    peaks: Sequence[Peak], steps: Sequence[Step], stage: StageConfig, limits: ForceLimits
) -> list[Check]:
    """Return a row of the force after the guard has stopped the fastest descent of each kind.

    After its trip the tip goes on by `stopping_mm`; the force grows as depth^1.5, with twice the
    modulus. An approach meets the face only where it is not expected, and warns.
    """
    bounds = [limit for limit in (limits.sensor_n, limits.stage_n) if limit is not None]
    if limits.guard is None or not bounds:
        return []
    limit_n, rows = min(bound[2] for bound in bounds), []
    trip_n = min(limits.guard.force_n[2], limits.guard.resultant_n)
    high = [MODULUS_FACTOR * peak.normal_n / peak.depth_mm**1.5 for peak in peaks]
    stiffness, press = worst_press(high, peaks)
    for id, kinds in (("press", ("press",)), ("approach", ("change", "travel", "approach"))):
        moves = [(a, b) for a, b in pairwise(steps) if b.kind in kinds]
        feeds = [b.feed_mm_min for a, b in moves if b.target_mm[2] < a.target_mm[2]]
        if not feeds:
            continue
        feed, late_mm = max(feeds), stage.stopping_mm(max(feeds))
        force_n = stage.stop_force_n(trip_n, feed, stiffness)
        fails = stage.stop_force_n(trip_n, feed, stiffness / MODULUS_FACTOR) > limit_n
        status = graded(id == "approach" or not fails, warns=force_n > limit_n)
        label = f"{id} at {feed:.4g} mm/min stopped {late_mm:.2f} mm late, {HIGH_TEXT} (N)"
        name, force_n = "force after a stop", round(force_n, 1)
        rows.append(Check.at_most(f"stop.{id}", name, label, force_n, limit_n, press, status))
    return rows


LoadRows = tuple[str, str, float, str, list[float]]
"""Id and words of a limit, the limit, its key with the unit, and the load of each peak."""


def _device_loads(limits: ForceLimits, peaks: Sequence[Peak]) -> Iterator[LoadRows]:
    """Loads against the ratings of stage and sensor."""
    if limits.stage_n is not None:
        yield from _force_loads("stage", peaks, limits.stage_n, "[stage] max_force_n (N)")
    if limits.sensor_n is not None:
        yield from _force_loads("sensor", peaks, limits.sensor_n, "[force] range_n (N)")
    if limits.sensor_nmm is not None:
        yield from _moments("sensor", peaks, limits.sensor_nmm, "[force] range_nmm (N mm)")


def _guard_loads(limits: ForceLimits, peaks: Sequence[Peak]) -> Iterator[LoadRows]:
    """Loads against the trip levels of the guard."""
    guard = limits.guard
    if guard is None:
        return
    force, torque = limits.guard_keys
    yield from _force_loads("guard", peaks, guard.force_n, f"{force} (N)")
    if math.isfinite(guard.resultant_n):
        loads = [math.hypot(p.normal_n, p.tangential_n) for p in peaks]
        yield "guard.whole", "resultant force", guard.resultant_n, "[guard] resultant_n (N)", loads
    yield from _moments("guard", peaks, guard.torque_nmm, f"{torque} (N mm)")


def _force_loads(part: str, peaks: Sequence[Peak], limit_n: Point, key: str) -> Iterator[LoadRows]:
    yield f"{part}.normal", "normal force", limit_n[2], key, [p.normal_n for p in peaks]
    # A drag along any axis of the protocol may meet either axis of a turned stage.
    loads = [p.tangential_n for p in peaks]
    yield f"{part}.tangential", "tangential force", min(limit_n[:2]), key, loads


def _moments(part: str, peaks: Sequence[Peak], limit_nmm: Point, key: str) -> Iterator[LoadRows]:
    moments = [p.moment_nmm for p in peaks if p.moment_nmm is not None]
    if len(moments) == len(peaks):
        for axis, letter in enumerate("xyz"):
            id, loads = f"{part}.moment-{letter}", [m[axis] for m in moments]
            yield id, f"moment about {letter}", limit_nmm[axis], key, loads


def plate_checks(peaks: Sequence[Peak], design: Design, simulated: bool) -> list[Check]:
    """Stress, room behind the plate and share of the depth, each with its worst press.

    Stress counts with the gel's modulus twice as high, as all that can break does; see
    `fabricate.cad.stiffness`. The plate's deflection is part of the depth that the stage counts and
    the gel does not see; the simulated sensor's plate is rigid and leaves it out.
    Too much stress fails, on the simulated rig it warns; the other two only warn.
    """
    bends = [press_plate(design, peak.normal_n, peak.at_mm) for peak in peaks]
    limit_mpa = design.plate.stress_limit_mpa
    stress_mpa, press = worst_press([MODULUS_FACTOR * f.stress_mpa for f in bends], peaks)
    over = stress_mpa > limit_mpa
    deflects_mm = max(f.deflection_mm for f in bends)
    return [
        Check.at_most(
            "plate-stress", "plate stress", f"{HIGH_TEXT}, plate.stress_limit_mpa (MPa)",
            round(stress_mpa, 2), limit_mpa, press, graded(simulated or not over, warns=over),
        ),
        _warning_row(
            "plate-clear-of-light", "plate clear of the light holder",
            f"{HIGH_TEXT}, least play of light.axial_fit_mm (mm)",
            [MODULUS_FACTOR * f.over_ring_mm for f in bends],
            plate_bending_room(design).range_mm[0], peaks,
        ),
        _warning_row(
            "plate-deflection", "plate deflection",
            f"{deflects_mm:.3f} mm predicted, not included in the simulation; "
            "share of the depth, plate.deflection_share",
            [f.deflection_mm / p.depth_mm for f, p in zip(bends, peaks, strict=True)],
            design.plate.deflection_share, peaks,
        ),
    ]  # fmt: skip


def _warning_row(
    id: str, name: str, label: str, figures: Sequence[float], bound: float, peaks: Sequence[Peak]
) -> Check:
    figure, press = worst_press(figures, peaks)
    status = graded(True, warns=figure > bound)
    return Check.at_most(id, name, label, float(f"{figure:.3g}"), bound, press, status)


USUAL_PX = (1280, 720)  # by hand: for a camera that declares no image size
# The planner of GRBL 1.1 (MINIMUM_FEED_RATE of its config.h) takes anything slower for this, so
# that a press would be faster than its protocol says. A real board's steps per mm are known, and
# judged, when it is connected; the simulated one makes 800, and GRBL's timer no less than 30.5
# steps/s of the axis that steps most: 2.3 mm/min, on a diagonal 4.
MIN_FEED_MM_MIN, SIMULATED_MIN_FEED_MM_MIN = 1.0, 4.0
LONG_H, LONGEST_H = 24.0, 30 * 24.0  # by hand: a warning, a typing error


def resource_checks(
    protocol: Protocol, steps: list[Step], rig: RigConfig, view: CameraModel | None, out: Path
) -> list[Check]:
    """Rows of the least feed, the time, the disk and the camera's rate, see `budget`.

    view: of the images that are tracked. out: of the run, or any folder on its disk; what a run
    that goes on has there already is not needed again.
    """
    px = image_px(view, rig)
    held_hz = ImageFormat.from_meta({"rig": rig.recorded()}).sustained_rate_hz(px)
    camera_hz = getattr(rig.camera, "rate_hz", None)
    estimate = RunEstimate.from_protocol(protocol, px, rig.stage, steps)
    files = out.rglob("*") if (out / "run.json").is_file() else ()
    kept_mb = sum(file.stat().st_size for file in files if file.is_file()) / 1e6
    most_hz = held_hz if camera_hz is None else min(held_hz, camera_hz)
    return budget_checks(protocol, steps, estimate, out, most_hz, not rig.simulated, kept_mb)


def image_px(view: CameraModel | None, rig: RigConfig) -> int:
    """Pixels of a frame as it is stored. view: of the images that are tracked."""
    if view is not None:
        width_px, height_px = raw_size_px(view)
    else:
        declared = getattr(rig.camera, "width_px", None), getattr(rig.camera, "height_px", None)
        width_px, height_px = (a or b for a, b in zip(declared, USUAL_PX, strict=True))
    return width_px * height_px


def budget_checks(
    protocol: Protocol,
    steps: Sequence[Step],
    estimate: RunEstimate,
    out: Path,
    held_hz: float | None,
    wall_clock: bool = True,
    kept_mb: float = 0.0,
) -> list[Check]:
    """Rows of the least feed, the time, the disk and the camera's rate.

    out: of the run, or any folder on its disk. held_hz: frames per second that camera, format and
    disk hold; None without a camera. wall_clock: whether time passes by itself, so that a rate
    that is too high loses frames; on a rig that waits it is a warning. kept_mb: there already, of a
    run that goes on.
    """
    slowest = min(steps, key=lambda step: step.feed_mm_min)
    feed = slowest.feed_mm_min
    minimum = MIN_FEED_MM_MIN if wall_clock else SIMULATED_MIN_FEED_MM_MIN
    hours = estimate.seconds / 3600
    existing = next(p for p in (out.absolute(), *out.absolute().parents) if p.exists())
    free_mb, mb = shutil.disk_usage(existing).free / 1e6, max(0.0, estimate.disk_mb - kept_mb)
    rows = [
        Check("least-feed", "least feed", "feed (mm/min)", feed, minimum,
              graded(feed >= minimum), (slowest.id,), sign=">="),
        Check.at_most("time", "time", "duration of the run (h)", hours, LONGEST_H, "the whole run",
                graded(hours <= LONGEST_H, warns=hours > LONG_H)),
        Check.at_most("disk", "disk", "needed; limit: free space (MB)", mb, free_mb,
                f"the disk of {existing}", graded(mb <= free_mb)),
    ]  # fmt: skip
    rates_hz = protocol.capture.rates_hz()
    if held_hz is not None and rates_hz and "image" in protocol.channels:
        kind = max(rates_hz, key=rates_hz.__getitem__)
        table = f"{kind}." if kind in ("hold", "retract") else ""
        exceeds, label = rates_hz[kind] > held_hz, "frames per second, requested and sustainable"
        status, key = graded(not (exceeds and wall_clock), warns=exceeds), f"capture.{table}rate_hz"
        rows.append(
            Check.at_most("camera-rate", "camera rate", label, rates_hz[kind], held_hz, key, status)
        )
    return rows
