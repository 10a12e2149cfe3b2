"""Wall thickness by rays: each printed part against the thinnest wall it may have."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from ..dimensions import Design
from ..part import Part
from ..rays import Thickness
from .built import BuiltDesign
from .row import Row, at

NAME = "wall thickness"
SLACK_MM = 1e-6


def rows(built: BuiltDesign) -> Iterator[Row]:
    """The thinnest wall of each part with its place."""
    for part in built.parts:
        if part.wall_keys:
            yield from built.rows(f"{NAME}: {part.name}", partial(_of_part, built, part))


def _of_part(built: BuiltDesign, part: Part) -> Iterator[Row]:
    """Of the cover two rows: its pegs must bend."""
    walls = built.walls(part.name)
    limit_mm = min(attrgetter(key)(built.design) for key in part.wall_keys)
    if part.name != "cover":
        yield _row(part.name, walls.thinnest(), limit_mm, part.wall_keys)
        return
    legs = _of_legs(built.design, walls.points_mm)
    yield _row(part.name, walls.thinnest(~legs), limit_mm, part.wall_keys)
    # They must bend: no wall of theirs is as thick as the housing's.
    least_mm = built.design.cover.leg_mm
    yield _row("cover, legs of the pegs", walls.thinnest(legs), least_mm, ("cover.leg_mm",))


def _row(part: str, found: Thickness | None, limit_mm: float, keys: tuple[str, ...]) -> Row:
    limit = f">= {limit_mm:.3g} mm ({', '.join(keys)})"
    if found is None:
        return Row(NAME, part, "no wall found", limit, False)
    passed = found.thickness_mm >= limit_mm - SLACK_MM
    return Row(NAME, part, f"{found.thickness_mm:.3f} mm at {at(found.at_mm)}", limit, passed)


def _of_legs(design: Design, points_mm: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which points (n, 3) lie on a peg above the cover's floor."""
    reach = design.cover.hole_mm / 2 + design.cover.lip_mm + 0.01
    away = [np.hypot(points_mm[:, 0] - x, points_mm[:, 1] - y) for x, y in design.peg_centres_mm]
    return (np.min(away, axis=0) < reach) & (points_mm[:, 2] > design.z_floor_mm + 1e-6)
