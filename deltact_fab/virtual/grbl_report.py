"""What GRBL 1.1h says of itself: positions, modes and parameters as it prints them."""

from __future__ import annotations

from collections.abc import Mapping

from ..aliases import Vector
from ..units import MM_PER_INCH
from .gcode import Modal


def coordinates(mm: Vector, inches: bool) -> str:
    """Three numbers as reported: 3 decimals of a millimetre, or 4 of an inch."""
    if inches:
        return ",".join(f"{p / MM_PER_INCH + 0.0:.4f}" for p in mm)
    return ",".join(f"{p + 0.0:.3f}" for p in mm)


def modal(m: Modal) -> str:
    """The answer to `$G`."""
    return (
        f"[GC:G{m.motion} G{m.system} G{m.plane} G{20 if m.inches else 21} "
        f"G{91 if m.relative else 90} G94 M{m.spindle} M{m.coolant} T{m.tool} "
        f"F{m.feed_mm_min:.0f} S{m.spindle_rpm:.0f}]"
    )


def parameters(systems: Mapping[int, Vector], g92_mm: Vector, inches: bool) -> list[str]:
    """The answer to `$#`. systems: work offsets by G number, mm."""
    zero = coordinates((0.0, 0.0, 0.0), inches)
    return [
        *(f"[G{system}:{coordinates(offset, inches)}]" for system, offset in systems.items()),
        f"[G28:{zero}]",
        f"[G30:{zero}]",
        f"[G92:{coordinates(g92_mm, inches)}]",
        f"[TLO:{zero.split(',', 1)[0]}]",
        f"[PRB:{zero}:0]",
    ]


def rates(speed_mm_min: float, m: Modal, inches: bool) -> str:
    """Feed and spindle of a status report."""
    rate = f"{speed_mm_min / MM_PER_INCH:.1f}" if inches else f"{speed_mm_min:.0f}"
    spindle = 0.0 if m.spindle == 5 else m.spindle_rpm
    return f"FS:{rate},{spindle:.0f}"


def accessories(m: Modal) -> str:
    """What is switched on, as it follows the overrides of a status report."""
    on = {3: "S", 4: "C"}.get(m.spindle, "") + ("F" if m.coolant == 8 else "")
    return f"|A:{on}" if on else ""
