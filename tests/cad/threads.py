"""What a screw shares with its pilot on purpose: closed forms."""

from __future__ import annotations

import math

from deltact_fab.cad.design import Design


def thread_overlap_mm3(design: Design) -> dict[tuple[str, str], float]:
    """Volume in mm3 that one screw shares with its pilot on purpose, by the names of `overlaps`.

    The ring between nominal diameter and pilot over the length that grips.
    """
    screw, holder = design.screw.row, design.holder.row
    grip_mm = design.holder.screw_length_mm - design.camera.board_mm
    return {
        ("screw", "skin-frame"): _ring_mm2(screw.thread_mm, screw.pilot_mm)
        * design.screw.engagement_mm,
        ("camera-holder", "camera-screw"): _ring_mm2(holder.thread_mm, holder.pilot_mm) * grip_mm,
    }


def _ring_mm2(outer_mm: float, inner_mm: float) -> float:
    """Area between two circles, by their diameters."""
    return math.pi / 4 * (outer_mm**2 - inner_mm**2)
