"""The `$` settings of a GRBL controller against what a rig file says of the stage, before motion.

Each rule is a row, those that hold included. A row that fails says what to type.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from ...aliases import Vector
from .grbl_messages import OPTIONS

AXES = "XYZ"
WHOLE = (3, 10, 13, 20, 21, 22, 23, 27, 32)
BY_AXIS = {100: "steps/mm", 110: "mm/min", 120: "mm/s2", 130: "mm of travel"}
HALF_DIGIT = 0.0005  # settings are listed with three decimals
ALWAYS_ON = 255  # of $1
SET_ORIGIN, LOCK_AT_START = 8, 4  # of $22, in grblHAL


@dataclass(frozen=True)
class Needs:
    """What a rig file says of its stage; None: nothing."""

    travel_mm: Vector | None = None
    max_feed_mm_min: Vector | None = None
    acceleration_mm_s2: Vector | None = None
    direction_mask: int = 0
    homing_direction_mask: int = 0
    pull_off_mm: float | None = None


@dataclass(frozen=True)
class SettingRow:
    """One rule: `text` says what was found, and where it does not hold what to do."""

    setting: str
    verdict: str  # pass, WARN or FAIL
    text: str

    def line(self) -> str:
        """One line for a person."""
        return f"{self.verdict}  {self.text}"


def judge(settings: Mapping[int, float], info: list[str], needs: Needs) -> list[SettingRow]:
    """Every rule. settings: `$` numbers to values. info: the answer to `$I`."""
    wanted = (*WHOLE, *(first + axis for first in BY_AXIS for axis in range(3)))
    missing = [f"${n}" for n in wanted if n not in settings]
    if missing:
        return [SettingRow(missing[0], "FAIL", f"the answer to $$ lacks {', '.join(missing)}")]
    options = next((found[1] for line in info if (found := OPTIONS.match(line))), "")
    return [
        *_switches(settings, needs),
        _origin(settings, options),
        _lock(settings, options, any("grblHAL" in line for line in info)),
        _pull_off(settings, needs),
        *_numbers(settings, needs),
        _held(settings),
    ]


def refusal(rows: list[SettingRow]) -> str:
    """The first rule that fails, and how many others do; "" if none does."""
    failed = [row.text for row in rows if row.verdict == "FAIL"]
    more = f" (and {len(failed) - 1} more: see `rig check`)" if len(failed) > 1 else ""
    return failed[0] + more if failed else ""


def _switches(s: Mapping[int, float], needs: Needs) -> Iterator[SettingRow]:
    again = "and connect again"
    for n, bit, wrong, right, remedy in (
        (10, 1, "status reports give the work position", "machine position", "$10=1 or $10=3"),
        (13, 0, "status reports are in inches", "millimetres", "$13=0"),
        (20, 1, "soft limits are off", "soft limits on", "$20=1"),
        (21, 1, "hard limits are off: a switch that is hit stops nothing", "hard limits on",
         "$21=1"),
        (22, 1, "homing is off", "homing on", "$22=1"),
    ):  # fmt: skip
        if int(s[n]) & 1 == bit:
            yield SettingRow(f"${n}", "pass", f"${n}={s[n]:g} ({right})")
        else:
            yield SettingRow(f"${n}", "FAIL", f"${n}={s[n]:g} ({wrong}); set {remedy} {again}")
    for n, mask, what, key in (
        (3, needs.direction_mask, "axes turned round", "direction_mask"),
        (23, needs.homing_direction_mask, "axes that home at their negative end",
         "homing_direction_mask"),
    ):  # fmt: skip
        found = int(s[n])
        if found & 7 == mask:
            yield SettingRow(f"${n}", "pass", f"${n}={found} ({what}: {_axes(mask)})")
        else:
            yield SettingRow(
                f"${n}",
                "FAIL",
                f"${n}={found} ({what}: {_axes(found)}), and the rig file says {mask} "
                f"({_axes(mask)}): motion would be elsewhere; set ${n}={mask} {again}, or "
                f"[stage] {key} = {found & 7} if the stage is built so",
            )
    if s[32] == 0:
        yield SettingRow("$32", "pass", "$32=0 (no laser mode)")
    else:
        yield SettingRow("$32", "FAIL", f"$32={s[32]:g} (laser or lathe mode); set $32=0 {again}")


def _origin(s: Mapping[int, float], options: str) -> SettingRow:
    """Homing must leave the switches at 0, not the place where the carriage then stands."""
    if "Z" in options:
        return SettingRow(
            "$I",
            "FAIL",
            f"[OPT:{options}...] (built with HOMING_FORCE_SET_ORIGIN: homing sets 0 where it ends, "
            "which shifts the travel); flash a firmware without that option",
        )
    if int(s[22]) & SET_ORIGIN:
        return SettingRow(
            "$22",
            "FAIL",
            f"$22={s[22]:g} (homing sets 0 where it ends, which shifts the travel); set "
            f"$22={int(s[22]) & ~SET_ORIGIN} and connect again",
        )
    return SettingRow("$I", "pass", f"[OPT:{options}] (homing leaves 0 at the switches)")


def _lock(s: Mapping[int, float], options: str, hal: bool) -> SettingRow:
    """A board that is locked until it was homed: Idle says then that its count is one."""
    if hal:
        if int(s[22]) & LOCK_AT_START:
            return SettingRow("$22", "pass", f"$22={s[22]:g} (locked until it was homed)")
        right = int(s[22]) | LOCK_AT_START
        return SettingRow(
            "$22", "FAIL", f"$22={s[22]:g} (not locked at its start: it would move on a count that "
            f"nobody homed); set $22={right} and connect again",
        )  # fmt: skip
    if "L" in options:
        return SettingRow(
            "$I", "FAIL", f"[OPT:{options}...] (built without HOMING_INIT_LOCK: it would move on a "
            "count that nobody homed); flash a firmware with it",
        )  # fmt: skip
    return SettingRow("$I", "pass", f"[OPT:{options}] (locked until it was homed)")


def _pull_off(s: Mapping[int, float], needs: Needs) -> SettingRow:
    """A switch trips at the end of the travel: homing must leave the carriage off it."""
    found, told = s[27], needs.pull_off_mm
    if not found > 0:
        return SettingRow("$27", "FAIL", f"$27={found:g} mm; not > 0: homing ends on its switch")
    if told is not None and found > told + HALF_DIGIT:
        return SettingRow(
            "$27", "FAIL", f"$27={found:g} mm, and [stage] pull_off_mm is {told:g}: homing ends "
            f"outside of the travel; set $27={told:g}, or pull_off_mm = {found:g}",
        )  # fmt: skip
    return SettingRow("$27", "pass", f"$27={found:g} mm off the switches after homing")


def _numbers(s: Mapping[int, float], needs: Needs) -> Iterator[SettingRow]:
    for first, unit, need, key in (
        (100, "steps/mm", None, ""),
        (110, "mm/min", needs.max_feed_mm_min, "max_feed_mm_min"),
        (120, "mm/s2", needs.acceleration_mm_s2, "acceleration_mm_s2"),
        (130, "mm of travel", needs.travel_mm, "travel_mm"),
    ):
        for axis, letter in enumerate(AXES):
            n, found = first + axis, s[first + axis]
            least = need[axis] if need is not None else 0.0
            has = f"{letter} has {found:g} {unit} (${n})"
            if not found > 0:
                yield SettingRow(f"${n}", "FAIL", f"${n}={found:g} {unit}; not > 0")
            elif found < least - HALF_DIGIT:
                yield SettingRow(
                    f"${n}",
                    "FAIL",
                    f"{has}; {least:g} needed: set ${n}={least:g} if the stage can do it, or less "
                    f"in [stage] {key}",
                )
            else:
                more = f"; the rig file's {least:g} holds" if 0 < least < found else ""
                yield SettingRow(f"${n}", "pass", has + more)


def _held(s: Mapping[int, float]) -> SettingRow:
    """With the motors off at rest a gel that is pressed pushes the axes back."""
    delay = s.get(1, ALWAYS_ON)
    if delay == ALWAYS_ON:
        return SettingRow("$1", "pass", "$1=255 (motors hold at rest)")
    return SettingRow(
        "$1",
        "WARN",
        f"$1={delay:g} (motors are off {delay:g} ms after each move: a gel under load may push "
        "the axes back); set $1=255 unless the screws hold by themselves",
    )


def _axes(mask: int) -> str:
    return ", ".join(letter for axis, letter in enumerate(AXES) if mask >> axis & 1) or "none"
