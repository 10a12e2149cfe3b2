"""Checks of a GRBL controller's firmware and `$` settings against the rig file, before any motion.

Each violation gives a row with the present value and the command to type. Moves are checked against
the settings before anything is sent (`Limits`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from functools import reduce
from operator import or_

from deltact_fab.common import Check, Point

from ...protocols.limits import axis_range_mm
from ...protocols.motion import StageConfig, subtract_vectors
from .exchange import OPTIONS_PATTERN

AXIS_LETTERS = "XYZ"
# Numbers and bits of GRBL 1.1 and grblHAL.
SINGLE_SETTINGS = (3, 10, 13, *range(20, 28), 32)
AXIS_UNITS = {100: "steps/mm", 110: "mm/min", 120: "mm/s2", 130: "mm of travel"}
HALF_DIGIT = 0.0005  # settings are listed with three decimals
ALWAYS_ON = 255  # of $1
SET_ORIGIN, LOCK_AT_START = 8, 4  # of $22, in grblHAL
HOMING_PASSES = range(44, 50)  # $ numbers of grblHAL: masks of the axes homed in each pass
VERSION_PATTERN = re.compile(r"\[VER:1\.1[a-z]\.\d+:")  # GRBL's and grblHAL's answer to `$I`
# Least steps/s of the axis that steps most, by the firmware's timer, 8 ticks a step (stepper.c).
SLOWEST_HZ = 16e6 / 8 / 0xFFFF  # GRBL: 16 bits at 16 MHz
SLOWEST_HAL_HZ = 120e6 / 8 / 0xFFFFF  # grblHAL: 20 bits at 120 MHz, LPC1769; 1 to 10 on others
REQUIRED_BITS = (  # setting, required lowest bit, meaning of the other, remedy
    (10, 1, "status reports give the work position", "$10=1 or $10=3"),
    (13, 0, "status reports are in inches", "$13=0"),
    (20, 1, "soft limits are off", "$20=1"),
    (21, 1, "hard limits are off: switches do not stop the motion", "$21=1"),
    (22, 1, "homing is off", "$22=1"),
)
RECONNECT_HINT = "and connect again"
# By hand: more reports a stuck homing later, or lets targets pass the end of the travel.
HOMING_MARGIN_S = 10.0
POSITION_ROUNDING_MM = 0.002  # of steps, and of reports with three decimals


Violation = tuple[str, str]
"""Id of a violated rule, and message."""


def check_settings(
    settings: Mapping[int, float], info: list[str], stage: StageConfig | None
) -> list[Check]:
    """Return rows with FAIL or WARN. settings: `$` numbers to values. info: the answer to `$I`.

    stage: table of the rig file; None: not available.
    """
    required = (*SINGLE_SETTINGS, *(first + axis for first in AXIS_UNITS for axis in range(3)))
    missing = [f"${n}" for n in required if n not in settings]
    if missing:
        return [_failed("settings", f"the answer to $$ lacks {', '.join(missing)}")]
    options = next((match[1] for line in info if (match := OPTIONS_PATTERN.match(line))), "")
    hal = any("grblHAL" in line for line in info)
    violations = (
        *_switches(settings, stage), *_homing(settings, options, hal),
        *_pull_off(settings, stage), *_numbers(settings, stage),
    )  # fmt: skip
    return [_failed(id, text) for id, text in violations] + _motor_checks(settings)


def check_firmware(banner: str, info: list[str]) -> list[Check]:
    """Return a row with FAIL unless banner, if any, and answer to `$I` are of GRBL 1.1 or grblHAL.

    A firmware that answers as another one does passes.
    """
    version = next((line for line in info if line.startswith("[VER")), "")
    if VERSION_PATTERN.match(version) and re.match(r"Grbl(HAL)? 1\.1|$", banner, re.IGNORECASE):
        return []
    name = " ".join(filter(None, (banner, version)))[:100] or "(no [VER:] in the answer to $I)"
    return [_failed("firmware", f"firmware {name} is not supported: flash GRBL 1.1 or grblHAL")]


def first_failure(rows: list[Check]) -> str:
    """Return the first failure and the number of others; "" without any."""
    failed = [str(row.value) for row in rows if row.failed]
    suffix = f" (and {len(failed) - 1} more: see `rig check`)" if len(failed) > 1 else ""
    return failed[0] + suffix if failed else ""


def _failed(id: str, text: str) -> Check:
    return Check(f"stage.{id}", "stage", value=text, status="fail")


def _switches(s: Mapping[int, float], stage: StageConfig | None) -> Iterator[Violation]:
    for n, bit, wrong, remedy in REQUIRED_BITS:
        if int(s[n]) & 1 != bit:
            yield f"setting-{n}", f"${n}={s[n]:g} ({wrong}); set {remedy} {RECONNECT_HINT}"
    for n, meaning, key in (
        (3, "reversed axes", "direction_mask"),
        (23, "axes homing at the negative end", "homing_direction_mask"),
    ):
        actual, mask = int(s[n]), getattr(stage, key, 0)
        if actual & 7 != mask:
            text = (
                f"${n}={actual} ({meaning}: {_axes(actual)}), and the rig file says {mask} "
                f"({_axes(mask)}): wrong direction of motion; set ${n}={mask} {RECONNECT_HINT}, or "
                f"[stage] {key} = {actual & 7} if the stage is built so"
            )
            yield f"setting-{n}", text
    if s[32] != 0:
        yield "setting-32", f"$32={s[32]:g} (laser or lathe mode); set $32=0 {RECONNECT_HINT}"


def _homing(s: Mapping[int, float], options: str, hal: bool) -> Iterator[Violation]:
    """Check that homing sets 0 at the switches, not where the carriage then stands.

    A board must also be locked until it was homed, so that Idle proves a valid position.
    """
    homing = int(s[22])
    if "Z" in options:
        text = (
            f"[OPT:{options}...] (built with HOMING_FORCE_SET_ORIGIN: homing sets 0 where it ends, "
            "which shifts the travel); flash a firmware without that option"
        )
        yield "origin", text
    elif homing & SET_ORIGIN:
        text = (
            f"$22={homing} (homing sets 0 where it ends, which shifts the travel); set "
            f"$22={homing & ~SET_ORIGIN} {RECONNECT_HINT}"
        )
        yield "origin", text
    passes = {n: int(s[n]) for n in HOMING_PASSES if n in s}
    if passes and (missing := 7 & ~reduce(or_, passes.values())):
        text = ", ".join(f"${n}={mask}" for n, mask in passes.items())
        text = f"{text} ({_axes(missing)} in no homing pass); set $44=4 and $45=3 {RECONNECT_HINT}"
        yield "setting-44", text
    if hal and not homing & LOCK_AT_START:
        text = (
            f"$22={homing} (not locked at start: it would move without homing); "
            f"set $22={homing | LOCK_AT_START} {RECONNECT_HINT}"
        )
        yield "lock", text
    elif not hal and "L" in options:
        text = (
            f"[OPT:{options}...] (built without HOMING_INIT_LOCK: it would move without "
            "homing); flash a firmware with it"
        )
        yield "lock", text


def _pull_off(s: Mapping[int, float], stage: StageConfig | None) -> Iterator[Violation]:
    """Check that homing leaves the carriage off the switch at the end of the travel."""
    actual, configured = s[27], None if stage is None else stage.pull_off_mm
    if not actual > 0:
        yield "setting-27", f"$27={actual:g} mm; not > 0: homing ends on its switch"
    elif configured is not None and actual > configured + HALF_DIGIT:
        text = (
            f"$27={actual:g} mm, and [stage] pull_off_mm is {configured:g}: homing ends outside of "
            f"the travel; set $27={configured:g}, or pull_off_mm = {actual:g}"
        )
        yield "setting-27", text


def _numbers(s: Mapping[int, float], stage: StageConfig | None) -> Iterator[Violation]:
    minimum_keys = {110: "max_feed_mm_min", 120: "acceleration_mm_s2", 130: "travel_mm"}
    for first, unit in AXIS_UNITS.items():
        key = minimum_keys.get(first, "")
        minima: Point = getattr(stage, key, (0.0, 0.0, 0.0))
        for n, letter, minimum in zip(range(first, first + 3), AXIS_LETTERS, minima, strict=True):
            actual = s[n]
            if not actual > 0:
                yield f"setting-{n}", f"${n}={actual:g} {unit}; not > 0"
            elif actual < minimum - HALF_DIGIT:
                text = (
                    f"{letter} has {actual:g} {unit} (${n}); {minimum:g} needed: set "
                    f"${n}={minimum:g} if the stage can do it, or less in [stage] {key}"
                )
                yield f"setting-{n}", text


def _motor_checks(s: Mapping[int, float]) -> list[Check]:
    """Warn of motors that are off at rest: a pressed gel pushes the axes back."""
    if (delay := s.get(1, ALWAYS_ON)) == ALWAYS_ON:
        return []
    text = (
        f"$1={delay:g} (motors are off {delay:g} ms after each move: a gel under load may push "
        "the axes back); set $1=255 unless the screws are self-locking"
    )
    return [Check("stage.setting-1", "stage", value=text, status="warn")]


def _axes(mask: int) -> str:
    return ", ".join(name for k, name in enumerate(AXIS_LETTERS) if mask >> k & 1) or "none"


def as_commanded(machine_mm: Point) -> Point:
    """Round a position to the four decimals of a command."""
    x, y, z = (round(p, 4) + 0.0 for p in machine_mm)
    return (x, y, z)


class Limits:
    """Limits of one controller, or of the rig file where they are lower.

    settings: `$` numbers to values. A refusal is a one-line reason, "" without one.
    """

    def __init__(self, settings: Mapping[int, float], travel_mm: Point | None = None) -> None:
        self.settings = dict(settings)
        self._travel_mm = travel_mm

    def axes(self, first: int) -> Point:
        """Return a setting of three axes by the number of the first."""
        s = self.settings
        return (s[first], s[first + 1], s[first + 2])

    @property
    def travel_mm(self) -> Point:
        """Travel of each axis, down from 0."""
        x, y, z = map(min, self.axes(130), self._travel_mm or self.axes(130))
        return (x, y, z)

    def ends_mm(self, axis: int) -> tuple[float, float]:
        """Lowest and highest position of an axis, $27 off its switch."""
        at_top = not int(self.settings.get(23, 0)) >> axis & 1
        return axis_range_mm(self.travel_mm[axis], at_top, self.settings.get(27, 0.0))

    @property
    def homed_mm(self) -> Point:
        """Position after homing: each axis $27 off its own switch."""
        pull, low = self.settings.get(27, 0.0), int(self.settings.get(23, 0))
        x, y, z = (pull - t if low >> k & 1 else -pull for k, t in enumerate(self.axes(130)))
        return (x, y, z)

    def homing_refusal(self, machine_mm: Point) -> str:
        """Refuse a position after homing at which an axis is not where its homing ends."""
        for axis in self._differing_axes(machine_mm, self.homed_mm):
            return (
                f"{AXIS_LETTERS[axis]} was not homed: it stands at {machine_mm[axis]:.3f}, homing "
                f"leaves it at {self.homed_mm[axis]:.3f}; let the firmware home every axis "
                "(HOMING_CYCLE_0 and _1 of GRBL, $44 to $46 of grblHAL)"
            )
        return ""

    def move_refusal(self, start_mm: Point, target_mm: Point, feed_mm_min: float) -> str:
        """Refuse a straight move, machine mm: its target or its feed."""
        delta_mm = subtract_vectors(target_mm, start_mm)
        return self.target_refusal(start_mm, target_mm) or self.feed_refusal(delta_mm, feed_mm_min)

    def target_refusal(self, start_mm: Point, machine_mm: Point) -> str:
        """Refuse a target that is not finite, or to which an axis moves out of the travel."""
        if not all(math.isfinite(p) for p in machine_mm):
            return f"target {machine_mm} mm (machine) is not finite"
        for axis, (start, p) in enumerate(zip(start_mm, machine_mm, strict=True)):
            low, high = self.ends_mm(axis)
            low_mm, high_mm = min(low, start), max(high, start)
            if not low_mm - POSITION_ROUNDING_MM <= p <= high_mm + POSITION_ROUNDING_MM:
                return (
                    f"target {AXIS_LETTERS[axis]} {p:.3f} mm (machine) is outside of {low:g} .. "
                    f"{high:g}, the travel less {self.settings.get(27, 0.0):g} mm at the switch"
                )
        return ""

    def feed_refusal(self, delta_mm: Point, feed_mm_min: float) -> str:
        """Refuse a feed that GRBL would clip silently: beyond the limit of an axis, too slow."""
        if not (math.isfinite(feed_mm_min) and feed_mm_min >= 0.001):
            return f"feed {feed_mm_min} mm/min; at least 0.001 is needed"
        length = math.hypot(*delta_mm)
        for axis, d, limit in zip(AXIS_LETTERS, delta_mm, self.axes(110), strict=True):
            if abs(d) * feed_mm_min > limit * length * (1 + 1e-9):
                return (
                    f"feed {feed_mm_min:g} mm/min moves {axis} at "
                    f"{feed_mm_min * abs(d) / length:g}; its limit is {limit:g}"
                )
        slowest_hz = SLOWEST_HAL_HZ if HOMING_PASSES[0] in self.settings else SLOWEST_HZ
        steps = max(abs(d) * k for d, k in zip(delta_mm, self.axes(100), strict=True))
        if feed_mm_min * steps < 60 * slowest_hz * length:
            minimum = math.ceil(600 * slowest_hz * length / steps) / 10
            return (
                f"feed {feed_mm_min:g} mm/min is slower than the controller steps: at least "
                f"{minimum:g} here, {slowest_hz:.1f} steps/s ($100 to $102)"
            )
        return ""

    def same_place(self, a_mm: Point, b_mm: Point) -> bool:
        """True within half a step plus the rounding of command and report."""
        return not self._differing_axes(a_mm, b_mm)

    def _differing_axes(self, a_mm: Point, b_mm: Point) -> list[int]:
        rows = zip(a_mm, b_mm, self.axes(100), strict=True)
        return [k for k, (a, b, steps) in enumerate(rows) if not abs(a - b) <= 0.5 / steps + 0.0006]

    def braking_s(self) -> float:
        """Longest duration of a stop."""
        feeds, ramps = ([self.settings.get(n + a, 0.0) for a in range(3)] for n in (110, 120))
        return max(feeds) / 60 / min(ramps) if min(ramps) > 0 else 0.0

    def homing_s(self) -> float:
        """Longest homing cycle: 1.5 travels and back for Z, then for X and Y together."""
        s = self.settings
        seek, feed, pull = (max(s.get(n, 0.0), 1e-3) for n in (25, 24, 27))
        travel = 1.5 * (s[132] + max(s[130], s[131]))
        pause_s = 8 * s.get(26, 0.0) / 1000
        slow = 2 * 5 * pull / feed + 4 * pull / seek
        ramps = 16 * seek / 60 / min(self.axes(120))
        return 60 * (travel / seek + slow) + pause_s + ramps + HOMING_MARGIN_S
