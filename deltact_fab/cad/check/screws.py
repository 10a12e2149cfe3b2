"""Screws: the holes of all parts on one axis, and the length that grips."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ...aliases import Point2
from ...errors import RunFailed
from ..features import Round, near
from ..parts.camera import BOARD_KEYS
from .built import BuiltDesign
from .pairs import pieces
from .row import Row

# The parts are drawn on one axis: what the printer misses is for the clearance (0.1) to take up.
AXIS_MM = 0.01
# A thread cut into resin strips before the screw breaks below twice its diameter.
ENGAGEMENT_D = 2.0
# The board hangs on two screws without load: one diameter holds it.
CAMERA_D = 1.0
SEAT_MM = 0.01
PEGS = "peg axes coaxial"


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
    if two:
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
    """The length by which each kind of screw grips its holder, in diameters."""
    for screw, holder, times, key, rests_on in (
        ("screw", "skin-frame", ENGAGEMENT_D, "screw.engagement_mm", ()),
        ("camera-screw", "camera-holder", CAMERA_D, "holder.screw_length_mm", BOARD_KEYS),
    ):
        if screw not in [part.name for part in built.parts]:
            continue
        shanks = _shanks(built, screw)
        least_mm = min(_grip_mm(built, shank, holder) for shank in shanks)
        thread_mm = 2 * shanks[0].radius_mm
        yield Row(
            "engagement",
            f"{screw}, {holder}",
            f"{least_mm:.2f} mm ({least_mm / thread_mm:.1f} d)",
            f">= {times:g} d = {times * thread_mm:.2f} mm ({key}: more)",
            least_mm >= times * thread_mm - 1e-6,
            rests_on,
        )


def _grip_mm(built: BuiltDesign, shank: Round, holder: str) -> float:
    """How far a screw stands in its pilot. Raises RunFailed where it has none."""
    x, y = shank.low_mm[:2]
    holes = [c for c in built.cylinders(holder) if c.hole]
    pilots = near(holes, x, y, built.design.post_mm / 4)
    if not pilots:
        raise RunFailed(f"{holder} has no hole at ({x:.2f}, {y:.2f})")
    pilot = min(pilots, key=lambda hole: hole.radius_mm)
    low, high = max(shank.low_mm[2], pilot.low_mm[2]), min(shank.high_mm[2], pilot.high_mm[2])
    return max(high - low, 0.0)


def _shanks(built: BuiltDesign, screw: str) -> list[Round]:
    """The shank of each placed screw: the thinnest face that is no hole."""
    outer = [c for c in built.cylinders(screw) if not c.hole]
    if not outer:
        raise RunFailed(f"{screw} has no shank along z")
    thinnest = min(outer, key=lambda c: c.radius_mm)
    shanks = []
    for piece in pieces([part for part in built.parts if part.name == screw], built):
        x, y, z = piece.shift_mm
        low, high = (
            (end[0] + x, end[1] + y, end[2] + z) for end in (thinnest.low_mm, thinnest.high_mm)
        )
        shanks.append(replace(thinnest, low_mm=low, high_mm=high))
    return shanks
