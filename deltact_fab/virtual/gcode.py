"""A line of G-code as GRBL 1.1h reads it: words by modal group, refused with its error codes."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from ..aliases import Vector

NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)")


class GcodeError(Exception):
    """A line that answers error:N."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


@dataclass
class Modal:
    """What a G-code line leaves behind for the next one (cleared by a reset)."""

    motion: int = 0
    plane: int = 17
    inches: bool = False
    relative: bool = False
    system: int = 54
    spindle: int = 5
    coolant: int = 9
    feed_mm_min: float = 0.0
    spindle_rpm: float = 0.0
    tool: int = 0
    g92_mm: Vector = (0.0, 0.0, 0.0)


@dataclass
class GcodeLine:
    """A parsed line: commands per modal group, values per letter."""

    groups: dict[str, float] = field(default_factory=dict)
    values: dict[str, float] = field(default_factory=dict)


_GROUPS: dict[str, dict[str, tuple[float, ...]]] = {
    "G": {
        "action": (4, 10, 53, 92, 92.1),
        "motion": (0, 1, 80),
        "plane": (17, 18, 19),
        "distance": (90, 91),
        "arc": (91.1,),
        "rate": (94,),
        "units": (20, 21),
        "cutter": (40,),
        "length": (49,),
        "system": (54, 55, 56, 57, 58, 59),
        "control": (61,),
    },
    "M": {"flow": (0, 1, 2, 30), "spindle": (3, 4, 5), "coolant": (8, 9)},
}
_GROUP_OF = {(c, v): g for c, groups in _GROUPS.items() for g, vs in groups.items() for v in vs}


def parse(line: str) -> GcodeLine:
    """Split a line into words; raises Refused with the firmware's codes."""
    words = GcodeLine()
    at = 0
    axis_command = False
    while at < len(line):
        letter = line[at]
        if not ("A" <= letter <= "Z"):
            raise GcodeError(1)
        number = NUMBER.match(line, at + 1)
        if number is None:
            raise GcodeError(2)
        at, value = number.end(), float(number[0])
        if letter in "GM":
            value = round(value, 2)
            group = _GROUP_OF.get((letter, value))
            if group is None:
                whole = int(value) not in (90, 91, 92) and (letter, int(value)) in _GROUP_OF
                raise GcodeError(23 if whole else 20)
            if letter == "G" and value in (0, 1, 10, 92):
                if axis_command:
                    raise GcodeError(24)
                axis_command = True
            if group in words.groups:
                raise GcodeError(21)
            words.groups[group] = value
            continue
        if letter not in "FIJKLNPRSTXYZ":
            raise GcodeError(20)
        if letter in words.values:
            raise GcodeError(25)
        if letter in "FNPTS" and value < 0:
            raise GcodeError(4)
        if letter == "T" and value > 255:
            raise GcodeError(38)
        words.values[letter] = value
    if words.values.get("N", 0) > 10_000_000:
        raise GcodeError(27)
    return words
