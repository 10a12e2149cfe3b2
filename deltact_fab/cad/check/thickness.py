"""Walls by rays and webs between holes: each part that is made, against intent and process."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict
from functools import partial
from itertools import combinations
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..dimensions import Design
from ..part import LASER_CUT, MACHINED, PRINT, Part
from ..rays import Thickness, Walls
from .built import BuiltDesign
from .row import Row, at

NAME = "wall thickness"
SLACK_MM = 1e-6
LEAST = {
    PRINT: "resin_printer.least_wall_mm",
    LASER_CUT: "laser.least_bridge_mm",
    MACHINED: "stage_plate.least_wall_mm",
}
"""Where a process says what it can make; what is bought or cast has no such wall."""


def rows(built: BuiltDesign) -> Iterator[Row]:
    """The thinnest wall of each part with its place."""
    for part in built.parts:
        if part.process in LEAST:
            yield from of_part(built, part)


def of_part(built: BuiltDesign, part: Part) -> Iterator[Row]:
    """The thinnest wall or web; of the cover two rows, for its pegs must bend."""
    kept = built.fact("walls", (part.name,), partial(_walls, built, part.name))
    wall, legs = (Thickness(t["thickness_mm"], tuple(t["at_mm"])) if t else None for t in kept)
    yield _row(built.design, part, part.name, (wall, _web(built, part.name)), part.wall_keys)
    if part.name == "cover":
        # No wall of theirs is as thick as the housing's.
        yield _row(built.design, part, "cover, legs of the pegs", (legs,), ("cover.leg_mm",))


def _walls(built: BuiltDesign, name: str) -> list[dict[str, Any] | None]:
    """The thinnest wall, and apart from it that of a cover's legs."""
    walls = Walls(built.solid(name), built.mesh(name))
    legs = _of_legs(built.design, walls.points_mm) if name == "cover" else None
    found = [walls.thinnest(), None]
    if legs is not None:
        found = [walls.thinnest(~legs), walls.thinnest(legs)]
    return [asdict(one) if one else None for one in found]


def _row(
    design: Design,
    part: Part,
    name: str,
    walls: tuple[Thickness | None, ...],
    meant: tuple[str, ...],
) -> Row:
    """Against the larger of what is meant, the least of its keys, and what the process makes."""

    def value(key: str) -> float:
        return float(attrgetter(key)(design))

    keys = sorted((LEAST[part.process], *sorted(meant, key=value)[:1]), key=value, reverse=True)
    least_mm = value(keys[0])
    limit = f">= {least_mm:.3g} mm ({', '.join(keys)})"
    found = min((w for w in walls if w is not None), key=lambda w: w.thickness_mm, default=None)
    if found is None:
        return Row(NAME, name, "no wall found", limit, False)
    passed = found.thickness_mm >= least_mm - SLACK_MM
    return Row(NAME, name, f"{found.thickness_mm:.3f} mm at {at(found.at_mm)}", limit, passed)


def _web(built: BuiltDesign, name: str) -> Thickness | None:
    """The narrowest web between two holes along z, below zero where one cuts into the other.

    Rays see no wall there. Holes about one axis are steps of one hole, and what opens into a bore
    about the part's own axis is a notch.
    """
    webs = []
    holes = [c for c in built.cylinders(name) if c.hole and c.offset_mm(0.0, 0.0) > SLACK_MM]
    for a, b in combinations(holes, 2):
        low, high = max(a.low_mm[2], b.low_mm[2]), min(a.high_mm[2], b.high_mm[2])
        apart = math.dist(a.low_mm[:2], b.low_mm[:2])
        # The ends of a slot are one hole too.
        if high - low > SLACK_MM and apart > max(a.radius_mm, b.radius_mm):
            (x, y, _), (u, v, _) = a.low_mm, b.low_mm
            middle = ((x + u) / 2, (y + v) / 2, low)
            webs.append(Thickness(apart - a.radius_mm - b.radius_mm, middle))
    return min(webs, key=lambda web: web.thickness_mm, default=None)


def _of_legs(design: Design, points_mm: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which points (n, 3) lie on a peg above the cover's floor."""
    reach = design.cover.hole_mm / 2 + design.cover.lip_mm + 0.01
    away = [np.hypot(points_mm[:, 0] - x, points_mm[:, 1] - y) for x, y in design.peg_centres_mm]
    return (np.min(away, axis=0) < reach) & (points_mm[:, 2] > design.z_floor_mm + 1e-6)
