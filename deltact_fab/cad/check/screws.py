"""Screws: the holes of all parts on one axis, the length that grips, the room beyond the tip."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...aliases import Point2
from ...errors import RunFailed
from ..features import Round, near
from ..parts.camera import BOARD_KEYS
from .built import BuiltDesign
from .pairs import pieces
from .row import Row, at

# The parts are drawn on one axis: what the printer misses is for the clearance (0.1) to take up.
AXIS_MM = 0.01
# A thread cut into resin strips before the screw breaks below twice its diameter.
ENGAGEMENT_D = 2.0
# The board hangs on two screws without load: one diameter holds it.
CAMERA_ENGAGEMENT_D = 1.0
# A printed blind hole comes out up to half a millimetre short, and the chips lie on its floor.
TIP_MM = 0.5
SEAT_MM = 0.01
PEGS = "peg axes coaxial"


@dataclass(frozen=True)
class ScrewGrip:
    """One screw in its pilot. tip_mm: room between the tip and the pilot's floor."""

    at_mm: Point2
    shank_mm: float
    pilot_mm: float
    engagement_mm: float
    tip_mm: float


def axes(built: BuiltDesign) -> Iterator[Row]:
    """Distance between the axes of holes and shanks that one screw or peg goes through."""
    design = built.design
    four, two, pegs = (
        design.screw_centres_mm,
        design.camera_screw_centres_mm,
        design.peg_centres_mm,
    )
    yield _coaxial(built, "screw axes coaxial", ("cover", "shell", "skin-frame"), (), four)
    # Reliefs for the heads, where they meet the ring at all.
    camera = _coaxial(
        built, "camera screw axes coaxial", ("camera", "camera-holder"), ("light-holder",), two
    )
    yield replace(camera, rests_on=BOARD_KEYS)
    yield _coaxial(built, PEGS, ("cover", "camera-holder"), (), pegs)
    yield _coaxial(
        built, "screw axes coaxial", ("testing-shell", "transparent-base"), ("cover",), four
    )


def _coaxial(
    built: BuiltDesign,
    name: str,
    parts: Sequence[str],
    extra: Sequence[str],
    seeds: Sequence[Point2],
) -> Row:
    reach_mm = built.design.screw.row.thread_mm
    worst, where = 0.0, ""
    missing = []
    for x, y in seeds:
        ends: list[tuple[float, float]] = []
        owner: list[str] = []
        for part in (*parts, *extra):
            found = near(built.cylinders(part), x, y, reach_mm)
            if found and name == PEGS and part == "cover":
                # A lip's axis lies further out than its peg's; it begins above the shaft.
                root_mm = min(c.low_mm[2] for c in found)
                found = [c for c in found if c.low_mm[2] < root_mm + SEAT_MM]
            if not found and part in parts:
                missing.append(f"{part} has none at ({x:.2f}, {y:.2f})")
            for cylinder in found:
                ends += [cylinder.low_mm[:2], cylinder.high_mm[:2]]
                owner += [part, part]
        if len(ends) < 2:
            continue
        points = np.array(ends)
        offset = float(np.linalg.norm(points[:, None] - points[None], axis=2).max())
        if offset > worst:
            middle = np.median(points, axis=0)
            odd = owner[int(np.argmax(np.linalg.norm(points - middle, axis=1)))]
            worst, where = offset, f", {odd} at ({x:.2f}, {y:.2f})"
    if worst <= AXIS_MM:
        where = f" over {len(seeds)} axes"
    found_text = "; ".join(missing[:4]) if missing else f"{worst:.3f} mm{where}"
    passed = not missing and worst <= AXIS_MM
    return Row(name, ", ".join(parts), found_text, f"<= {AXIS_MM:g} mm", passed)


def engagement(built: BuiltDesign) -> Iterator[Row]:
    """The length that grips, the room beyond the tip, and that the heads bear."""
    four = grips(built, "screw", "skin-frame")
    yield _grip_row("screw, skin-frame", four, ENGAGEMENT_D)
    least = min(four, key=lambda grip: grip.tip_mm)
    yield Row(
        "tip clearance",
        "screw, skin-frame",
        f"{round(least.tip_mm, 2) + 0.0:.2f} mm",
        f">= {TIP_MM:g} mm",
        least.tip_mm >= TIP_MM - 1e-6,
    )
    yield _heads(built)
    two = grips(built, "camera-screw", "camera-holder")
    row = _grip_row("camera-screw, camera-holder", two, CAMERA_ENGAGEMENT_D)
    yield replace(row, rests_on=BOARD_KEYS)


def _grip_row(part: str, found: list[ScrewGrip], times: float) -> Row:
    least = min(found, key=lambda grip: grip.engagement_mm / grip.shank_mm)
    limit_mm = times * least.shank_mm
    return Row(
        "engagement",
        part,
        f"{least.engagement_mm:.2f} mm ({least.engagement_mm / least.shank_mm:.1f} d)",
        f">= {times:g} d = {limit_mm:.2f} mm",
        least.engagement_mm >= limit_mm - 1e-6,
    )


def _heads(built: BuiltDesign) -> Row:
    """Gap between a head's underside and the cover's floor of its bore; below zero it digs in."""
    gaps = []
    for shank in _shanks(built, "screw"):
        x, y = shank.low_mm[:2]
        holes = near(_holes(built.cylinders("cover")), x, y, built.design.post_mm / 4)
        if not holes:
            raise RunFailed(f"cover has no hole at ({x:.2f}, {y:.2f})")
        through = min(holes, key=lambda hole: hole.radius_mm)
        gaps.append((through.low_mm[2] - shank.low_mm[2], shank))
    worst, shank = max(gaps, key=lambda gap: abs(gap[0]))
    passed = abs(worst) <= SEAT_MM
    found = f"{round(worst, 3) + 0.0:.3f} mm off" + ("" if passed else f" at {at(shank.low_mm)}")
    return Row("heads bear", "screw, cover", found, f"within {SEAT_MM:g} mm", passed)


def grips(built: BuiltDesign, screw: str, holder: str) -> list[ScrewGrip]:
    """How each screw of a kind sits in its pilot; along z for the one, against it for the other.

    Raises RunFailed where a screw has no pilot.
    """
    found = []
    for shank in _shanks(built, screw):
        x, y = shank.low_mm[:2]
        pilots = near(_holes(built.cylinders(holder)), x, y, built.design.post_mm / 4)
        if not pilots:
            raise RunFailed(f"{holder} has no hole at ({x:.2f}, {y:.2f})")
        pilot = min(pilots, key=lambda hole: hole.radius_mm)
        low = max(shank.low_mm[2], pilot.low_mm[2])
        high = min(shank.high_mm[2], pilot.high_mm[2])
        found.append(
            ScrewGrip(
                (x, y),
                2 * shank.radius_mm,
                2 * pilot.radius_mm,
                max(high - low, 0.0),
                pilot.high_mm[2] - shank.high_mm[2],
            )
        )
    return found


def _shanks(built: BuiltDesign, screw: str) -> list[Round]:
    """The shank of each placed screw: the thinnest face that is no hole, out to the tip."""
    outer = [c for c in built.cylinders(screw) if not c.hole]
    if not outer:
        raise RunFailed(f"{screw} has no shank along z")
    thinnest = min(outer, key=lambda c: c.radius_mm)
    shanks = []
    for piece in pieces([part for part in built.parts if part.name == screw], built):
        x, y, z = piece.place(built)
        low, high = (
            (end[0] + x, end[1] + y, end[2] + z) for end in (thinnest.low_mm, thinnest.high_mm)
        )
        if screw == "screw":
            # A chamfered tip reaches further than its cylinder.
            high = (*high[:2], max(high[2], piece.box(built)[1][2]))
        shanks.append(replace(thinnest, low_mm=low, high_mm=high))
    return shanks


def _holes(cylinders: list[Round]) -> list[Round]:
    return [c for c in cylinders if c.hole]
