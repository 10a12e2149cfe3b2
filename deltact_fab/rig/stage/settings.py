"""The `$` settings of a GRBL controller against what a rig file says of the stage, before motion.

A row for each rule that does not hold says what was found and what to type.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from ...aliases import Vector
from ..interface import DeviceRow
from .grbl_messages import OPTIONS

AXES = "XYZ"
WHOLE = (3, 10, 13, 20, 21, 22, 23, 27, 32)
BY_AXIS = {100: "steps/mm", 110: "mm/min", 120: "mm/s2", 130: "mm of travel"}
HALF_DIGIT = 0.0005  # settings are listed with three decimals
ALWAYS_ON = 255  # of $1
SET_ORIGIN, LOCK_AT_START = 8, 4  # of $22, in grblHAL
SWITCHES = (  # setting, its lowest bit, what another one means, what to set
    (10, 1, "status reports give the work position", "$10=1 or $10=3"),
    (13, 0, "status reports are in inches", "$13=0"),
    (20, 1, "soft limits are off", "$20=1"),
    (21, 1, "hard limits are off: a switch that is hit stops nothing", "$21=1"),
    (22, 1, "homing is off", "$22=1"),
)
AGAIN = "and connect again"


@dataclass(frozen=True)
class Needs:
    """What a rig file says of its stage; None: nothing."""

    travel_mm: Vector | None = None
    max_feed_mm_min: Vector | None = None
    acceleration_mm_s2: Vector | None = None
    direction_mask: int = 0
    homing_direction_mask: int = 0
    pull_off_mm: float | None = None


def judge(settings: Mapping[int, float], info: list[str], needs: Needs) -> list[DeviceRow]:
    """What is wrong, FAIL or WARN. settings: `$` numbers to values. info: the answer to `$I`."""
    wanted = (*WHOLE, *(first + axis for first in BY_AXIS for axis in range(3)))
    missing = [f"${n}" for n in wanted if n not in settings]
    if missing:
        return [DeviceRow("stage", "FAIL", f"the answer to $$ lacks {', '.join(missing)}")]
    options = next((found[1] for line in info if (found := OPTIONS.match(line))), "")
    hal = any("grblHAL" in line for line in info)
    wrong = (
        *_switches(settings, needs), *_homing(settings, options, hal),
        *_pull_off(settings, needs), *_numbers(settings, needs),
    )  # fmt: skip
    return [DeviceRow("stage", "FAIL", text) for text in wrong] + _held(settings)


def refusal(rows: list[DeviceRow]) -> str:
    """The first rule that fails, and how many others do; "" if none does."""
    failed = [row.text for row in rows if row.verdict == "FAIL"]
    more = f" (and {len(failed) - 1} more: see `rig check`)" if len(failed) > 1 else ""
    return failed[0] + more if failed else ""


def _switches(s: Mapping[int, float], needs: Needs) -> Iterator[str]:
    for n, bit, wrong, remedy in SWITCHES:
        if int(s[n]) & 1 != bit:
            yield f"${n}={s[n]:g} ({wrong}); set {remedy} {AGAIN}"
    for n, mask, what, key in (
        (3, needs.direction_mask, "axes turned round", "direction_mask"),
        (23, needs.homing_direction_mask, "axes that home at their negative end",
         "homing_direction_mask"),
    ):  # fmt: skip
        found = int(s[n])
        if found & 7 != mask:
            yield (
                f"${n}={found} ({what}: {_axes(found)}), and the rig file says {mask} "
                f"({_axes(mask)}): motion would be elsewhere; set ${n}={mask} {AGAIN}, or "
                f"[stage] {key} = {found & 7} if the stage is built so"
            )
    if s[32] != 0:
        yield f"$32={s[32]:g} (laser or lathe mode); set $32=0 {AGAIN}"


def _homing(s: Mapping[int, float], options: str, hal: bool) -> Iterator[str]:
    """Homing must leave the switches at 0, not the place where the carriage then stands.

    And a board must be locked until it was homed: Idle says then that its count is one.
    """
    homing = int(s[22])
    if "Z" in options:
        yield (
            f"[OPT:{options}...] (built with HOMING_FORCE_SET_ORIGIN: homing sets 0 where it ends, "
            "which shifts the travel); flash a firmware without that option"
        )
    elif homing & SET_ORIGIN:
        yield (
            f"$22={homing} (homing sets 0 where it ends, which shifts the travel); set "
            f"$22={homing & ~SET_ORIGIN} {AGAIN}"
        )
    if hal and not homing & LOCK_AT_START:
        yield (
            f"$22={homing} (not locked at its start: it would move on a count that nobody homed); "
            f"set $22={homing | LOCK_AT_START} {AGAIN}"
        )
    elif not hal and "L" in options:
        yield (
            f"[OPT:{options}...] (built without HOMING_INIT_LOCK: it would move on a count that "
            "nobody homed); flash a firmware with it"
        )


def _pull_off(s: Mapping[int, float], needs: Needs) -> Iterator[str]:
    """A switch trips at the end of the travel: homing must leave the carriage off it."""
    found, told = s[27], needs.pull_off_mm
    if not found > 0:
        yield f"$27={found:g} mm; not > 0: homing ends on its switch"
    elif told is not None and found > told + HALF_DIGIT:
        yield (
            f"$27={found:g} mm, and [stage] pull_off_mm is {told:g}: homing ends outside of the "
            f"travel; set $27={told:g}, or pull_off_mm = {found:g}"
        )


def _numbers(s: Mapping[int, float], needs: Needs) -> Iterator[str]:
    needed = {
        110: ("max_feed_mm_min", needs.max_feed_mm_min),
        120: ("acceleration_mm_s2", needs.acceleration_mm_s2),
        130: ("travel_mm", needs.travel_mm),
    }
    for first, unit in BY_AXIS.items():
        key, need = needed.get(first, ("", None))
        for axis, letter in enumerate(AXES):
            n, found = first + axis, s[first + axis]
            least = need[axis] if need is not None else 0.0
            if not found > 0:
                yield f"${n}={found:g} {unit}; not > 0"
            elif found < least - HALF_DIGIT:
                yield (
                    f"{letter} has {found:g} {unit} (${n}); {least:g} needed: set ${n}={least:g} "
                    f"if the stage can do it, or less in [stage] {key}"
                )


def _held(s: Mapping[int, float]) -> list[DeviceRow]:
    """With the motors off at rest a gel that is pressed pushes the axes back."""
    delay = s.get(1, ALWAYS_ON)
    if delay == ALWAYS_ON:
        return []
    text = (
        f"$1={delay:g} (motors are off {delay:g} ms after each move: a gel under load may push "
        "the axes back); set $1=255 unless the screws hold by themselves"
    )
    return [DeviceRow("stage", "WARN", text)]


def _axes(mask: int) -> str:
    return ", ".join(letter for axis, letter in enumerate(AXES) if mask >> axis & 1) or "none"
