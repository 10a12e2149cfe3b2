"""Tables of standard hardware by name."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal

from deltact_fab.common import InputError, Point2

CapThread = Literal["M1.6", "M2", "M2.5", "M3"]
CheeseThread = Literal["none", "M1.6", "M2", "M2.5", "M3"]
Thread = Literal["M2", "M2.5", "M3", "M4", "M5", "M6"]
CableSide = Literal["-y", "-x", "+x"]
CABLE_SIDES: tuple[CableSide, ...] = ("-y", "-x", "+x")


@dataclass(frozen=True)
class CapScrew:
    """A hexagon socket head cap screw (ISO 4762) and the holes that go with it.

    thread_mm: nominal diameter. head_mm, head_height_mm: largest head (knurled). socket_mm: key
    width. clearance_mm: through hole (ISO 273 coarse: printed patterns do not agree to the play of
    the medium row). pilot_mm: hole in which the screw cuts its own thread in resin. bore_mm: hole
    for the head. stock_mm: lengths that are sold.
    """

    thread_mm: float
    head_mm: float
    head_height_mm: float
    socket_mm: float
    clearance_mm: float
    pilot_mm: float
    bore_mm: float
    stock_mm: tuple[float, ...]


CAP_SCREWS: dict[CapThread, CapScrew] = {
    "M1.6": CapScrew(1.6, 3.14, 1.6, 1.5, 2.0, 1.35, 3.55, (2.5, 3, 4, 5, 6, 8, 10, 12, 16)),
    "M2": CapScrew(2.0, 3.98, 2.0, 1.5, 2.6, 1.65, 4.4, (3, 4, 5, 6, 8, 10, 12, 16, 20)),
    "M2.5": CapScrew(2.5, 4.68, 2.5, 2.0, 3.1, 2.1, 5.1, (4, 5, 6, 8, 10, 12, 16, 20, 25)),
    "M3": CapScrew(3.0, 5.68, 3.0, 2.5, 3.6, 2.55, 6.1, (5, 6, 8, 10, 12, 16, 20, 25, 30)),
}


@dataclass(frozen=True)
class CheeseScrew:
    """A slotted cheese head screw (ISO 1207): the lowest head with a full thread below it.

    slot_mm: nominal width of the slot. slot_depth_mm: its least depth.
    """

    thread_mm: float
    head_mm: float
    head_height_mm: float
    pilot_mm: float
    slot_mm: float
    slot_depth_mm: float


CHEESE_STOCK_MM = (2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)  # by hand: lengths on sale (ISO 1207)
SHEET_STOCK_MM = (1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0)
"""By hand: thicknesses of cast PMMA on sale."""
CHEESE_SCREWS: dict[CheeseThread, CheeseScrew] = {
    "none": CheeseScrew(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    "M1.6": CheeseScrew(1.6, 3.0, 1.1, 1.35, 0.4, 0.45),
    "M2": CheeseScrew(2.0, 3.8, 1.4, 1.65, 0.5, 0.6),
    "M2.5": CheeseScrew(2.5, 4.5, 1.8, 2.1, 0.6, 0.7),
    "M3": CheeseScrew(3.0, 5.5, 2.0, 2.55, 0.8, 0.85),
}


@dataclass(frozen=True)
class MetricThread:
    """A metric thread for mounting the sensor, with its holes and washer.

    thread_mm: nominal diameter. clearance_mm: through hole (ISO 273, medium). pitch_mm: coarse (ISO
    261). washer_mm, washer_height_mm: plain washer (ISO 7089), a little more than a head or a nut
    across its corners.
    """

    thread_mm: float
    clearance_mm: float
    pitch_mm: float
    washer_mm: float
    washer_height_mm: float


METRIC_THREADS: dict[Thread, MetricThread] = {
    "M2": MetricThread(2.0, 2.4, 0.4, 5.0, 0.3),
    "M2.5": MetricThread(2.5, 2.9, 0.45, 6.0, 0.5),
    "M3": MetricThread(3.0, 3.4, 0.5, 7.0, 0.5),
    "M4": MetricThread(4.0, 4.5, 0.7, 9.0, 0.8),
    "M5": MetricThread(5.0, 5.5, 0.8, 10.0, 1.0),
    "M6": MetricThread(6.0, 6.6, 1.0, 12.0, 1.6),
}
M16_PITCH_MM = 0.35  # ISO 261, coarse


def thread_text(thread: str) -> str:
    """Designation of a coarse thread (ISO 261), such as `M4 × 0.7`."""
    pitch_mm = M16_PITCH_MM if thread == "M1.6" else METRIC_THREADS[thread].pitch_mm  # type: ignore[index]
    return f"{thread} × {pitch_mm:g}"


FLANGE_SCREWS_MM = (6.0, 8.0, 10.0, 12.0, 16.0, 20.0, 25.0, 30.0, 35.0, 40.0)
"""Lengths of M2 to M6 on sale (ISO 4762)."""
# By hand, ISO 9409-1: pitch circle, screws and locating pin by designation.
ROBOT_FLANGES: dict[str, tuple[float, int, Thread, float]] = {"50-4-M6": (50.0, 4, "M6", 6.0)}
HOLES_HINT = "expected 30x30 M3, circle 50 6xM4 or ISO 9409-1-50-4-M6, with M2 to M6"
_NUMBER_PATTERN = r"(\d+(?:\.\d+)?)"


@dataclass(frozen=True)
class HolePattern:
    """Clearance holes of a mounting flange, about its middle.

    pin_mm: diameter of the hole for a locating pin on the pitch circle in +x, 0: none.
    """

    thread: Thread
    centres_mm: tuple[Point2, ...]
    pin_mm: float = 0.0

    @property
    def half_mm(self) -> Point2:
        """Largest distance of a hole or the pin from the middle, in x and y."""
        centres = [*self.centres_mm, *([self.pin_at_mm] if self.pin_mm else [])]
        x, y = (max(abs(centre[i]) for centre in centres) for i in (0, 1))
        return x, y

    @property
    def pin_at_mm(self) -> Point2:
        """Centre of the pin."""
        return math.hypot(*self.centres_mm[0]), 0.0


def parse_holes(text: str, source: str = "mount.holes") -> HolePattern:
    """Parse `30x30 M3`, `circle 50 6xM4` or `ISO 9409-1-50-4-M6`. Raises InputError.

    A circle's holes lie half a step beside the x axis, where ISO 9409-1 has its pin.
    """
    words, pin_mm = " ".join(text.split()), 0.0
    if words.upper().startswith("ISO 9409-1-"):
        name = words.upper().removeprefix("ISO 9409-1-")
        if name in ROBOT_FLANGES:
            diameter_mm, count, thread, pin_mm = ROBOT_FLANGES[name]
            words = f"circle {diameter_mm:g} {count}x{thread}"
    if match := re.fullmatch(rf"{_NUMBER_PATTERN}x{_NUMBER_PATTERN} (M\S+)", words):
        x, y = (float(side) / 2 for side in match.groups()[:2])
        centres = tuple((sx * x, sy * y) for sy in (-1, 1) for sx in (-1, 1))
    elif match := re.fullmatch(rf"circle {_NUMBER_PATTERN} (\d+)x(M\S+)", words):
        radius, count = float(match[1]) / 2, int(match[2])
        turns = ((k + 0.5) * 2 * math.pi / count for k in range(count))
        centres = tuple((radius * math.cos(t), radius * math.sin(t)) for t in turns)
    for thread in METRIC_THREADS:
        if match and match[3] == thread and 2 <= len(centres) <= 12:
            return HolePattern(thread, centres, pin_mm)
    raise InputError(f"{source} {text!r}: {HOLES_HINT}")


def screw_tolerance_mm(length_mm: float) -> float:
    """Tolerance of a screw's length, +- (ISO 4759-1: js15)."""
    steps = ((3, 0.20), (6, 0.24), (10, 0.29), (18, 0.35), (30, 0.42), (50, 0.50))
    return next((tolerance for upto, tolerance in steps if length_mm <= upto), 0.60)


# Resistor values of IEC 60063, the 5 % series.
E24_STEPS = (
    10, 11, 12, 13, 15, 16, 18, 20, 22, 24, 27, 30, 33, 36, 39, 43, 47, 51, 56, 62, 68, 75, 82, 91,
    100,
)  # fmt: skip


def next_e24(ohm: float) -> float:
    """Return the smallest E24 resistor of at least that many ohms; 0 if ohm <= 0."""
    if ohm <= 0:
        return 0.0
    power = math.floor(math.log10(ohm)) - 1
    # A quotient of whole numbers prints as 9.1, a product with 0.1 as 9.100000000000001.
    sold = [step * 10**power if power >= 0 else step / 10**-power for step in E24_STEPS]
    return float(next((r for r in sold if r >= ohm * (1 - 1e-9)), sold[-1]))
