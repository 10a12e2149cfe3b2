"""Checks of single parts: one valid closed solid with a complete drawing, wall thickness, overhangs
in printing, and the indenters' height fields that protocols and gel models use.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict
from functools import partial
from itertools import combinations
from operator import attrgetter, itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Check, RunFailed, graded

from ..dimensions import Design
from ..kernel import flaw_of
from ..overhangs import MIN_CONTACT_MM2, PlatformContact, find_contact, lay_on_platform
from ..part import LASER_CUT, MACHINED_PROCESS, PART_GROUPS, PRINT_PROCESS, Part
from ..rays import ExactRays, Wall, Walls
from ..suction import MAX_CUP_MM2, find_cups
from .built import CHECK_MESH_MM, BuiltDesign
from .row import format_point

HEIGHT_FIELD_MM = 1e-5  # by hand: above the kernel's rounding; larger hides a wrong surface
FIELD_POINTS = 40  # by hand, per indenter: fewer miss a small tip
WALL_SLACK_MM = 1e-6  # by hand, rounding of coordinates; larger lets thin walls pass
LEAST_WALL_KEYS = {
    PRINT_PROCESS: "resin_printer.least_wall_mm",
    LASER_CUT: "laser.least_bridge_mm",
    MACHINED_PROCESS: "stage_plate.least_wall_mm",
}
"""Key of the thinnest wall a process can make; bought and cast parts have none."""


def soundness(model: BuiltDesign) -> Iterator[Check]:
    """Check solids and meshes, one row per group of parts with the faults by part."""
    for group in PART_GROUPS:
        names = [part.name for part in model.parts if part.group == group]
        if not names:
            continue
        wrong, triangles = [], 0
        for name in names:
            try:
                triangles += model.fact("triangles", (name,), partial(_triangles, model, name))
            except RunFailed as error:
                wrong.append(model.failures.get(name, str(error)))
        value = f"{len(names)}/{len(names)}, {triangles} triangles at {CHECK_MESH_MM:g} mm"
        if wrong:
            value = f"{len(wrong)}/{len(names)} invalid: " + "; ".join(wrong)
        yield Check(
            f"soundness.{group}", "one valid closed solid", group, value,
            "every part, with closed mesh", graded(not wrong),
        )  # fmt: skip


def _triangles(model: BuiltDesign, name: str) -> int:
    """Number of triangles of a part's mesh. Raises RunFailed naming a fault of the part."""
    if flaw := flaw_of(model.solid(name)):
        raise RunFailed(f"{name}: {flaw}")
    return len(model.mesh(name).triangles)


def drawings(model: BuiltDesign) -> Iterator[Check]:
    """Check the drawings: one row per drawing with faults, or one for all."""
    parts = [part for part in model.parts if part.callouts is not None]
    total, complete, limit = 0, True, "each feature located and sized once"
    for part in parts:
        faults, count = model.fact("drawings", (part.name,), partial(_planned, model, part))
        total += count
        if faults:
            complete = False
            id, text = f"drawings.{part.name}", "; ".join(faults)
            yield Check(id, "drawings", part.name, text, limit, "fail")
    if complete:
        text = f"{total} lengths and labels"
        yield Check("drawings", "drawings", f"{len(parts)} parts", text, limit)


def _planned(model: BuiltDesign, part: Part) -> tuple[list[str], int]:
    """Return faults of a drawing's plan, and its number of lengths and labels."""
    from ..drafting.scheme import scheme

    assert part.callouts is not None
    plan = scheme(model.features(part.name), part.callouts(part.source(model.design)))
    return list(plan.faults), len(plan.lengths) + len(plan.rounds)


def walls(model: BuiltDesign) -> Iterator[Check]:
    """Check the thinnest wall or web of each part; the cover's flexible pegs have their own row."""
    for part in model.parts:
        if part.process not in LEAST_WALL_KEYS:
            continue
        wall, legs = model.fact("walls", (part.name,), partial(_walls, model, part.name))
        webs, name = [wall, *_webs(model, part.name)], part.name
        yield _row(model.design, part, name, name, webs, part.wall_keys)
        if part.name == "cover":
            # The legs are thinner than the housing's walls.
            name, keys = "cover, legs of the pegs", ("cover.leg_mm",)
            yield _row(model.design, part, "cover.legs", name, [legs], keys)


def _walls(model: BuiltDesign, name: str) -> list[Wall | None]:
    """Return the thinnest wall, and separately that of a cover's legs."""
    walls = Walls(model.solid(name), model.mesh(name))
    if name == "cover":
        legs = _on_legs(model.design, walls.points_mm)
        return [walls.thinnest(~legs), walls.thinnest(legs)]
    return [walls.thinnest(), None]


def _row(
    design: Design, part: Part, id: str, name: str, walls: list[Wall | None], keys: tuple[str, ...]
) -> Check:
    """Compare with the larger of the thinnest designed wall (keys) and the process's limit."""

    def value(key: str) -> float:
        return float(attrgetter(key)(design))

    bounds = (LEAST_WALL_KEYS[part.process], *sorted(keys, key=value)[:1])
    limits = sorted(bounds, key=value, reverse=True)
    least_mm = value(limits[0])
    limit = f">= {least_mm:.3g} mm ({', '.join(limits)})"
    thinnest = min(filter(None, walls), key=itemgetter(0), default=None)
    id = f"wall-thickness.{id}"
    if thinnest is None:
        return Check(id, "wall thickness", name, "no wall found", limit, "fail")
    text = f"{thinnest[0]:.3f} mm at {format_point(thinnest[1])}"
    passed = thinnest[0] >= least_mm - WALL_SLACK_MM
    return Check(id, "wall thickness", name, text, limit, graded(passed))


def _webs(model: BuiltDesign, name: str) -> Iterator[Wall]:
    """Yield the webs between two holes along z, negative where the holes overlap.

    Rays find no wall there. Coaxial holes are steps of one hole, and a hole that opens into a bore
    about the part's own axis is a notch.
    """
    holes = [c for c in model.cylinders(name) if c.hole and c.offset_mm(0.0, 0.0) > WALL_SLACK_MM]
    for a, b in combinations(holes, 2):
        low, high = max(a.low_mm[2], b.low_mm[2]), min(a.high_mm[2], b.high_mm[2])
        distance = math.dist(a.low_mm[:2], b.low_mm[:2])
        # The ends of a slot are one hole too.
        if high - low > WALL_SLACK_MM and distance > max(a.radius_mm, b.radius_mm):
            (x, y, _), (u, v, _) = a.low_mm, b.low_mm
            yield distance - a.radius_mm - b.radius_mm, ((x + u) / 2, (y + v) / 2, low)


def _on_legs(design: Design, points_mm: NDArray[np.float64]) -> NDArray[np.bool_]:
    """True for points (n, 3) on a peg above the cover's floor."""
    reach = design.cover.hole_mm / 2 + design.cover.lip_mm + 0.01
    gaps = [np.hypot(points_mm[:, 0] - x, points_mm[:, 1] - y) for x, y in design.peg_centres_mm]
    return (np.min(gaps, axis=0) < reach) & (points_mm[:, 2] > design.z_floor_mm + 1e-6)


def platform_contact(model: BuiltDesign) -> Iterator[Check]:
    """Check platform contact of parts that print untilted, ceilings and cups of every part.

    An unsupported ceiling may span what the printer can bridge.
    """
    for part in model.parts:
        if not part.printed:
            continue
        name, pose = part.name, part.pose
        contact = model.fact("bed contact", (name,), partial(_contact_values, model, part))
        on = PlatformContact(**contact)
        if not pose.on_supports:
            limit = f">= {MIN_CONTACT_MM2:g} mm2"
            value, status = f"{on.contact_mm2:.1f} mm2", graded(on.contact_mm2 >= MIN_CONTACT_MM2)
            yield Check(f"bed-contact.{name}", "bed contact", name, value, limit, status)
        if on.ceilings_mm2:
            span_mm = model.design.resin_printer.ceiling_span_mm
            limit = f"<= {span_mm:g} mm span (resin_printer.ceiling_span_mm), or on supports"
            status = graded(bool(pose.supports) or on.span_mm <= span_mm)
            value = on.ceilings_text(pose.supports)
            yield Check(f"ceilings.{name}", "ceilings", name, value, limit, status)
        cups = model.fact("cups", (name,), partial(_cups_mm2, model, part))
        value, limit = "no cup", f"<= {MAX_CUP_MM2:g} mm2 a cup"
        if cups:
            value = f"{sum(cups):.0f} mm2 sealed in one layer, largest cup {cups[0]:.0f} mm2"
        status = graded(max(cups, default=0.0) <= MAX_CUP_MM2)
        yield Check(f"suction.{name}", "suction in printing", name, value, limit, status)


def _cups_mm2(model: BuiltDesign, part: Part) -> list[float]:
    return find_cups(lay_on_platform(model.mesh(part.name), part.pose), part.pose.on_supports)


def _contact_values(model: BuiltDesign, part: Part) -> dict[str, Any]:
    return asdict(find_contact(lay_on_platform(model.mesh(part.name), part.pose)))


def height_fields(model: BuiltDesign) -> Iterator[Check]:
    """Check the indenters' height fields: one row with the largest deviation."""
    parts = [part for part in model.parts if part.indenter is not None]
    misses = {
        part.name: model.fact("height field", (part.name,), partial(_miss_mm, model, part))
        for part in parts
    }
    worst = max(misses, key=lambda name: misses[name])
    miss = misses[worst]
    value, limit = f"deviates {miss:.3g} mm: {worst}", f"<= {HEIGHT_FIELD_MM:g} mm"
    passed, name = miss <= HEIGHT_FIELD_MM, "indenter height field"
    if passed:
        value = f"max {miss:.1e} mm, {len(parts)} x {FIELD_POINTS} points"
    yield Check("height-fields", name, "indenters", value, limit, graded(passed))


def _miss_mm(model: BuiltDesign, part: Part) -> float:
    """Return the largest z distance between solid and height field; inf where only one exists.

    Outside the tips the solid must not lie below the free length of the tips.
    """
    assert part.indenter is not None
    indenter = part.indenter.indenter
    half = np.array(indenter.footprint_half_mm)
    k = np.arange(1, FIELD_POINTS + 1)
    # Quasi-random (R2 sequence): even over the footprint, never on its middle lines.
    plan = np.stack([(0.7548776662466927 * k) % 1, (0.5698402909980532 * k) % 1], axis=1)
    xy = (2 * plan - 1) * half
    field = indenter.height_mm(xy[:, 0], xy[:, 1])
    rays = ExactRays(model.solid(part.name))
    up, below = np.array((0.0, 0.0, 1.0)), -10.0
    worst = 0.0
    for (x, y), height in zip(xy.tolist(), field.tolist(), strict=True):
        z_mm = below + rays.first(np.array((x, y, below)), up)[0]
        if math.isfinite(height):
            worst = max(worst, abs(z_mm - height))
        else:
            worst = max(worst, indenter.reach_mm - z_mm)
    return worst
