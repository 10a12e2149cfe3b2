"""The indenters: the underside of each is the height field that protocols and gel reckon with."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

import numpy as np

from ..part import Part
from ..rays import ExactRays
from .built import BuiltDesign
from .row import Row

FIELD_MM = 1e-5
POINTS = 40


def rows(built: BuiltDesign) -> Iterator[Row]:
    """One row for all of them, with the worst."""
    parts = [part for part in built.parts if part.indenter is not None]
    misses = {
        part.name: built.fact("height field", (part.name,), partial(_miss_mm, built, part))
        for part in parts
    }
    worst = max(misses, key=lambda name: misses[name])
    miss = misses[worst]
    found = f"{miss:.1e} mm at most, {len(parts)} x {POINTS} points"
    passed = miss <= FIELD_MM
    yield Row(
        "indenter height field",
        "indenters",
        found if passed else f"{miss:.3g} mm off: {worst}",
        f"<= {FIELD_MM:g} mm",
        passed,
    )


def _miss_mm(built: BuiltDesign, part: Part) -> float:
    """Largest distance along z between solid and height field; inf where one of them is not.

    Beside the tips the solid must not lie below the free length of the tips.
    """
    assert part.indenter is not None
    indenter = part.indenter.indenter
    half = np.array(indenter.footprint_half_mm)
    k = np.arange(1, POINTS + 1)
    # Even over the footprint and never on its middle lines, where faces meet.
    plan = np.stack([(0.7548776662466927 * k) % 1, (0.5698402909980532 * k) % 1], axis=1)
    xy = (2 * plan - 1) * half
    field = indenter.height_mm(xy[:, 0], xy[:, 1])
    rays = ExactRays(built.solid(part.name))
    up, below = np.array((0.0, 0.0, 1.0)), -10.0
    worst = 0.0
    for (x, y), height in zip(xy.tolist(), field.tolist(), strict=True):
        found = below + rays.first(np.array((x, y, below)), up)
        if math.isfinite(height):
            worst = max(worst, abs(found - height))
        else:
            worst = max(worst, part.indenter.plate_z_mm - found)
    return worst
