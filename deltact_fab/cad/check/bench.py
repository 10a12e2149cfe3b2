"""The bench's parts against each other: holes that a screw or a pin goes through are coaxial."""

from __future__ import annotations

import math
from collections.abc import Iterator

from ..parts.nano17_adapter import BOLTS, KEYS
from .built import Built
from .row import Row, open_keys

NAME = "bench holes coaxial"
AXIS_MM = 1e-4


def rows(built: Built) -> Iterator[Row]:
    """A row a pair, from the solids: each hole of the first has one of the second on its axis."""
    tool, plate, table = built.design.tool, built.design.adapter, built.design.table
    pin = tool.pin_mm + tool.pin_fit_mm
    yield _pair(built, ("tool-holder", tool.screw_hole_mm), ("nano17-adapter", plate.pilot_mm), 4)
    yield _pair(built, ("tool-holder", pin), ("nano17-adapter", tool.pin_mm), 1)
    tapped = built.design.stage_plate.thread_hole_mm
    yield _pair(built, ("testing-shell", table.hole_mm), ("stage-plate", tapped), 4)
    yield _bolts(built)


def _centres(built: Built, name: str, diameter_mm: float) -> list[tuple[float, float]]:
    """Axes of a part's holes of one diameter, each once."""
    found: list[tuple[float, float]] = []
    for c in built.cylinders(name):
        at = (c.low_mm[0], c.low_mm[1])
        fits = c.hole and abs(2 * c.radius_mm - diameter_mm) < 1e-6
        if fits and all(math.dist(at, other) > AXIS_MM for other in found):
            found.append(at)
    return found


def _pair(built: Built, first: tuple[str, float], second: tuple[str, float], count: int) -> Row:
    one, other = _centres(built, *first), _centres(built, *second)
    parts = f"{first[0]}, {second[0]}"
    limit = f"{count} holes within {AXIS_MM:g} mm"
    if len(one) < count or len(other) < count:
        found = f"{len(one)} of {first[1]:g} mm and {len(other)} of {second[1]:g} mm"
        return Row(NAME, parts, found, limit, False)
    # Other holes may have the same diameter: the nearest count.
    off = sorted(min(math.dist(a, b) for b in other) for a in one)[count - 1]
    return Row(NAME, parts, f"{count} holes, {off:.1e} mm off", limit, off <= AXIS_MM)


def _bolts(built: Built) -> Row:
    """The force sensor's screws on their circle about the tool's axis."""
    plate = built.design.adapter
    found = _centres(built, "nano17-adapter", plate.bolt_hole_mm)
    off = max((abs(math.hypot(*at) - plate.bolt_circle_mm / 2) for at in found), default=math.inf)
    return Row(
        NAME, "nano17-adapter, force sensor", f"{len(found)} holes, {off:.1e} mm off their circle",
        f"{BOLTS} on {plate.bolt_circle_mm:g} mm", len(found) == BOLTS and off <= AXIS_MM,
        open_keys(built.design.unverified(), *KEYS),
    )  # fmt: skip
