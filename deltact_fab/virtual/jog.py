"""A jog as GRBL 1.1h reads it, refused with its error codes, and places as it prints them."""

from __future__ import annotations

import re

from ..aliases import Vector
from ..units import MM_PER_INCH

WORD = re.compile(r"([A-Z])([+-]?(?:\d+\.?\d*|\.\d+)?)")
UNITS, DISTANCE, MACHINE = ({"20", "21"}, {"90", "91"}, {"53"})


class GrblError(Exception):
    """A line that answers error:N."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


def jog_of(line: str, at_mm: Vector) -> tuple[Vector, float]:
    """Target (machine mm) and feed (mm/min) of what follows `$J=`, from where the last one ended.

    There are no work offsets. Raises GrblError.
    """
    words = WORD.findall(line)
    if "".join(letter + value for letter, value in words) != line:
        raise GrblError(1)
    if any(not value for _, value in words):
        raise GrblError(2)
    modes = [value for letter, value in words if letter == "G"]
    if any(len(group.intersection(modes)) > 1 for group in (UNITS, DISTANCE)):
        raise GrblError(21)
    if set(modes) - UNITS - DISTANCE - MACHINE:
        raise GrblError(16)
    values = {letter: float(value) for letter, value in words if letter != "G"}
    if len(values) + len(modes) < len(words):
        raise GrblError(25)
    if unknown := set(values) - set("FNXYZ"):
        raise GrblError(36 if unknown <= set("IJKLPRST") else 20)
    if values.get("F", 0.0) < 0:
        raise GrblError(4)
    scale = MM_PER_INCH if "20" in modes else 1.0
    feed_mm_min = values.get("F", 0.0) * scale
    if not feed_mm_min:
        raise GrblError(22)
    x, y, z = at_mm
    if "91" not in modes or "53" in modes:
        x, y, z = (at if axis not in values else 0.0 for axis, at in zip("XYZ", at_mm, strict=True))
    dx, dy, dz = (values.get(axis, 0.0) * scale for axis in "XYZ")
    return (x + dx, y + dy, z + dz), feed_mm_min


def coordinates(mm: Vector, inches: bool) -> str:
    """Three numbers as reported: 3 decimals of a millimetre, or 4 of an inch."""
    if inches:
        return ",".join(f"{p / MM_PER_INCH + 0.0:.4f}" for p in mm)
    return ",".join(f"{p + 0.0:.3f}" for p in mm)
