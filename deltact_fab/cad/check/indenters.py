"""The indenters: a stem for the stage's tool holder, an underside that is the height field."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

import numpy as np

from ...shapes import Indenter
from ..part import Part
from ..rays import ExactRays
from .built import BuiltDesign
from .row import Row

# Every protocol of the bench assumes one tool holder.
HOLDER_MM = Indenter.stem_diameter_mm
FIELD_MM = 1e-5
POINTS = 40


def rows(built: BuiltDesign) -> Iterator[Row]:
    """One row for all stems, one for all height fields, each with the worst of them."""
    parts = [part for part in built.parts if part.indenter is not None]
    stems = {part.name: _stem_mm(built, part) for part in parts}
    off = max(stems, key=lambda name: abs(stems[name] - HOLDER_MM))
    fits = abs(stems[off] - HOLDER_MM) <= 1e-6
    yield Row(
        "indenter stem",
        "indenters",
        f"{len(parts)} of {HOLDER_MM:g} mm" if fits else f"{stems[off]:.3f} mm: {off}",
        f"{HOLDER_MM:g} mm, the stage's tool holder",
        fits,
    )
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


def _stem_mm(built: BuiltDesign, part: Part) -> float:
    """Diameter of the cylinder about the axis that ends at the top; 0 when there is none."""
    top = built.box(part.name)[1][2]
    ends = [
        2 * c.radius_mm
        for c in built.cylinders(part.name)
        if not c.hole and c.offset_mm(0.0, 0.0) < 1e-6 and abs(c.high_mm[2] - top) < 1e-6
    ]
    return max(ends, default=0.0)


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
