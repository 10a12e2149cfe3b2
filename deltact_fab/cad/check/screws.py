"""Screws: the length by which they grip."""

from __future__ import annotations

from collections.abc import Iterator

from ...errors import RunFailed
from ..assembly import PartPlace, places
from ..features import Round, near
from ..parts.camera import BOARD_KEYS
from .built import BuiltDesign
from .row import Row

# A thread cut into resin strips before the screw breaks below twice its diameter.
ENGAGEMENT_D = 2.0
# The board hangs on two screws without load: one diameter holds it.
CAMERA_D = 1.0


def engagement(built: BuiltDesign) -> Iterator[Row]:
    """The length by which each kind of screw grips its holder, in diameters."""
    for screw, holder, times, key, rests_on in (
        ("screw", "skin-frame", ENGAGEMENT_D, "screw.engagement_mm", ()),
        ("camera-screw", "camera-holder", CAMERA_D, "holder.screw_length_mm", BOARD_KEYS),
    ):
        screws = places(built.design, [part for part in built.parts if part.name == screw])
        if not screws:
            continue
        # The shank is the thinnest face that is no hole.
        outer = [c for c in built.cylinders(screw) if not c.hole]
        shank = min(outer, key=lambda c: c.radius_mm)
        least_mm = min(_grip_mm(built, shank, place, holder) for place in screws)
        thread_mm = 2 * shank.radius_mm
        yield Row(
            "engagement",
            f"{screw}, {holder}",
            f"{least_mm:.2f} mm ({least_mm / thread_mm:.1f} d)",
            f">= {times:g} d = {times * thread_mm:.2f} mm ({key}: more)",
            least_mm >= times * thread_mm - 1e-6,
            rests_on,
        )


def _grip_mm(built: BuiltDesign, shank: Round, place: PartPlace, holder: str) -> float:
    """How far a screw stands in its pilot. Raises RunFailed where it has none."""
    x, y, z = place.shift_mm
    holes = [c for c in built.cylinders(holder) if c.hole]
    pilots = near(holes, x, y, built.design.post_mm / 4)
    if not pilots:
        raise RunFailed(f"{holder} has no hole at ({x:.2f}, {y:.2f})")
    pilot = min(pilots, key=lambda hole: hole.radius_mm)
    low = max(shank.low_mm[2] + z, pilot.low_mm[2])
    return max(min(shank.high_mm[2] + z, pilot.high_mm[2]) - low, 0.0)
