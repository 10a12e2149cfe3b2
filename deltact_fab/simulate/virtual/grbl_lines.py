"""Jogs and `$` settings as GRBL 1.1h reads them, refused with its error codes, and prints them;
banners of GRBL and of other firmware.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from deltact_fab.common import Point

GCODE_WORD = re.compile(r"([A-Z])([+-]?(?:\d+\.?\d*|\.\d+)?)")
DISTANCE_MODES, IGNORED_MODES = {"90", "91"}, {"21", "53"}
# Banner and lines of `$I`, by name; of the sources of each project.
FIRMWARE_TEXTS: dict[str, tuple[str, ...]] = {
    "GRBL": ("Grbl 1.1h ['$' for help]", "[VER:1.1h.20190830:]", "[OPT:V,15,128]"),
    "grblHAL": (
        "GrblHAL 1.1f ['$' or '$HELP' for help]",
        "[VER:1.1f.20260818:]", "[OPT:VNM,35,1024,3,0]", "[FIRMWARE:grblHAL]",
    ),
    "FluidNC": (
        "Grbl 4.0 [FluidNC v4.0.1 (wifi) '$' for help]",
        "[VER:4.0 FluidNC v4.0.1:]", "[OPT:PHS]", "[MSG:Machine: Default]",
    ),
    "GRBL 0.9": ("Grbl 0.9j ['$' for help]", "[0.9j.20160303:]"),
    "uCNC": ("uCNC 1.10.0 ['$' for help]", "[VER: uCNC 1.10.0 - Generic board]", "[OPT:C3,T1,25]"),
    "Grbl_ESP32": ("Grbl 1.3a ['$' for help]", "[VER:1.3a.20211103:]", "[OPT:PHBW]"),
}  # fmt: skip


class GrblError(Exception):
    """A line that answers error:N."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


def parse_jog(line: str, at_mm: Point) -> tuple[Point, float]:
    """Target (machine mm) and feed (mm/min) of what follows `$J=`, from where the last one ended.

    There are no work offsets. Raises GrblError.
    """
    words = GCODE_WORD.findall(line)
    if "".join(letter + value for letter, value in words) != line:
        raise GrblError(1)
    if any(not value for _, value in words):
        raise GrblError(2)
    modes = [value for letter, value in words if letter == "G"]
    if len(DISTANCE_MODES.intersection(modes)) > 1:
        raise GrblError(21)
    if set(modes) - DISTANCE_MODES - IGNORED_MODES:
        raise GrblError(16)
    values = {letter: float(value) for letter, value in words if letter != "G"}
    if len(values) + len(modes) < len(words):
        raise GrblError(25)
    if unknown := set(values) - set("FNXYZ"):
        raise GrblError(36 if unknown <= set("IJKLPRST") else 20)
    if (feed_mm_min := values.get("F", 0.0)) <= 0:
        raise GrblError(4 if feed_mm_min else 22)
    x, y, z = at_mm
    if "91" not in modes or "53" in modes:
        x, y, z = (p if axis not in values else 0.0 for axis, p in zip("XYZ", at_mm, strict=True))
    dx, dy, dz = (values.get(axis, 0.0) for axis in "XYZ")
    return (x + dx, y + dy, z + dz), feed_mm_min


def coordinates(mm: Sequence[float]) -> str:
    """Numbers as reported, with 3 decimals."""
    return ",".join(f"{p + 0.0:.3f}" for p in mm)


# ---- settings -----------------------------------------------------------------------------------

# GRBL 1.1h defaults; limits by hand, of a usual bench.
DEFAULTS_GRBL: dict[int, float] = {
    0: 10, 1: 25, 2: 0, 3: 0, 4: 0, 5: 0, 6: 0,
    10: 3, 11: 0.01, 12: 0.002, 13: 0,
    20: 1, 21: 1, 22: 1, 23: 0, 24: 100, 25: 600, 26: 250, 27: 1,
    30: 1000, 31: 0, 32: 0,
    100: 800, 101: 800, 102: 800, 110: 1500, 111: 1500, 112: 1200,
    120: 50, 121: 50, 122: 50, 130: 120, 131: 120, 132: 60,
}  # fmt: skip
# Passes of grblHAL's homing: the axes of each, 1 for X, 2 for Y, 4 for Z, added up.
HOMING_PASS_MASKS: dict[int, float] = {44: 4, 45: 3, 46: 0}
_INTEGER_SETTINGS = {*range(7), 10, 13, *range(20, 24), 26, 32, *HOMING_PASS_MASKS}


def grbl_settings(
    travel_mm: Point, max_feed_mm_min: Point, acceleration_mm_s2: Point
) -> dict[int, float]:
    """The `$` settings of a stage with these limits; the rest are a bench's usual ones."""
    limits = {110: max_feed_mm_min, 120: acceleration_mm_s2, 130: travel_mm}
    axes = {n + axis: v for n, per_axis in limits.items() for axis, v in enumerate(per_axis)}
    return {**DEFAULTS_GRBL, **axes}


def set_value(settings: dict[int, float], assignment: str) -> None:
    """`N=value`. Raises GrblError, nothing changed."""
    match = re.fullmatch(r"(\d+)=(-?\d+\.?\d*)", assignment)
    if match is None or (n := int(match[1])) not in settings:
        raise GrblError(3)
    value = float(match[2])
    if value < 0:
        raise GrblError(4)
    if n == 20 and value and not settings[22]:
        raise GrblError(10)
    settings[n] = float(int(value)) if n in _INTEGER_SETTINGS else value
    if n == 22 and not value:
        settings[20] = 0


def settings_text(settings: Mapping[int, float]) -> list[str]:
    return [
        f"${n}={value:.0f}" if n in _INTEGER_SETTINGS or n in (30, 31) else f"${n}={value:.3f}"
        for n, value in settings.items()
    ]
