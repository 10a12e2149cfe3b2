"""Every part by itself: one valid closed solid whose drawing is complete, walls, what of it hangs
when it is printed, and indenters whose underside is the field that protocols and gel reckon with.
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
from ..drafting.scheme import scheme
from ..kernel import flaw_of
from ..overhangs import MIN_CONTACT_MM2, PlatformContact, find_contact, lay_on_platform
from ..part import GROUPS, LASER_CUT, MACHINED, PRINT, Part
from ..rays import ExactRays, Wall, Walls
from .built import MESH_MM, BuiltDesign
from .row import format_point

FIELD_MM = 1e-5
POINTS = 40
SLACK_MM = 1e-6
LEAST = {
    PRINT: "resin_printer.least_wall_mm",
    LASER_CUT: "laser.least_bridge_mm",
    MACHINED: "stage_plate.least_wall_mm",
}
"""Where a process says what it can make; what is bought or cast has no such wall."""


def soundness(model: BuiltDesign) -> Iterator[Check]:
    """A row for each group of parts, naming what is wrong with which."""
    for group in GROUPS:
        names = [part.name for part in model.parts if part.group == group]
        wrong, triangles = [], 0
        for name in names:
            try:
                triangles += model.fact("triangles", (name,), partial(_triangles, model, name))
            except RunFailed as error:
                wrong.append(model.failed.get(name, str(error)))
        value = f"{len(names)} of {len(names)}, {triangles} triangles at {MESH_MM:g} mm"
        if wrong:
            value = f"{len(wrong)} of {len(names)} not: " + "; ".join(wrong)
        yield Check(
            f"soundness.{group}", "one valid closed solid", group, value,
            "every part, and its mesh closed", graded(not wrong),
        )  # fmt: skip


def _triangles(model: BuiltDesign, name: str) -> int:
    """Of its mesh. Raises RunFailed saying what is wrong with the part."""
    if flaw := flaw_of(model.solid(name)):
        raise RunFailed(f"{name}: {flaw}")
    return len(model.mesh(name).triangles)


def drawings(model: BuiltDesign) -> Iterator[Check]:
    """A row for each drawing with a fault, or one for all of them."""
    parts = [part for part in model.parts if part.callouts is not None]
    total, complete, limit = 0, True, "each feature placed and sized once"
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
    """Faults of a drawing's plan, and how many lengths and labels it has."""
    assert part.callouts is not None
    plan = scheme(model.features(part.name), part.callouts(part.source(model.design)))
    return list(plan.faults), len(plan.lengths) + len(plan.rounds)


def walls(model: BuiltDesign) -> Iterator[Check]:
    """The thinnest wall or web of each part; of the cover two rows, for its pegs must bend."""
    for part in model.parts:
        if part.process not in LEAST:
            continue
        wall, legs = model.fact("walls", (part.name,), partial(_walls, model, part.name))
        webs, name = [wall, *_webs(model, part.name)], part.name
        yield _row(model.design, part, name, name, webs, part.wall_keys)
        if part.name == "cover":
            # No wall of theirs is as thick as the housing's.
            name, keys = "cover, legs of the pegs", ("cover.leg_mm",)
            yield _row(model.design, part, "cover.legs", name, [legs], keys)


def _walls(model: BuiltDesign, name: str) -> list[Wall | None]:
    """The thinnest wall, and apart from it that of a cover's legs."""
    walls = Walls(model.solid(name), model.mesh(name))
    if name == "cover":
        legs = _on_legs(model.design, walls.points_mm)
        return [walls.thinnest(~legs), walls.thinnest(legs)]
    return [walls.thinnest(), None]


def _row(
    design: Design,
    part: Part,
    id: str,
    name: str,
    walls: list[Wall | None],
    wall_keys: tuple[str, ...],
) -> Check:
    """Against the larger of what is meant, the least of its keys, and what the process makes."""

    def value(key: str) -> float:
        return float(attrgetter(key)(design))

    keys = sorted((LEAST[part.process], *sorted(wall_keys, key=value)[:1]), key=value, reverse=True)
    least_mm = value(keys[0])
    limit = f">= {least_mm:.3g} mm ({', '.join(keys)})"
    thinnest = min(filter(None, walls), key=itemgetter(0), default=None)
    id = f"wall-thickness.{id}"
    if thinnest is None:
        return Check(id, "wall thickness", name, "no wall found", limit, "fail")
    text, status = (
        f"{thinnest[0]:.3f} mm at {format_point(thinnest[1])}",
        graded(thinnest[0] >= least_mm - SLACK_MM),
    )
    return Check(id, "wall thickness", name, text, limit, status)


def _webs(model: BuiltDesign, name: str) -> Iterator[Wall]:
    """The webs between two holes along z, below zero where one cuts into the other.

    Rays see no wall there. Holes about one axis are steps of one hole, and what opens into a bore
    about the part's own axis is a notch.
    """
    holes = [c for c in model.cylinders(name) if c.hole and c.offset_mm(0.0, 0.0) > SLACK_MM]
    for a, b in combinations(holes, 2):
        low, high = max(a.low_mm[2], b.low_mm[2]), min(a.high_mm[2], b.high_mm[2])
        distance = math.dist(a.low_mm[:2], b.low_mm[:2])
        # The ends of a slot are one hole too.
        if high - low > SLACK_MM and distance > max(a.radius_mm, b.radius_mm):
            (x, y, _), (u, v, _) = a.low_mm, b.low_mm
            yield distance - a.radius_mm - b.radius_mm, ((x + u) / 2, (y + v) / 2, low)


def _on_legs(design: Design, points_mm: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which points (n, 3) lie on a peg above the cover's floor."""
    reach = design.cover.hole_mm / 2 + design.cover.lip_mm + 0.01
    distances = [
        np.hypot(points_mm[:, 0] - x, points_mm[:, 1] - y) for x, y in design.peg_centres_mm
    ]
    return (np.min(distances, axis=0) < reach) & (points_mm[:, 2] > design.z_floor_mm + 1e-6)


def platform_contact(model: BuiltDesign) -> Iterator[Check]:
    """What each part that stands straight has on the platform, and the ceilings of every part.

    One that nothing supports may span what the printer bridges.
    """
    for part in model.parts:
        if not part.printed:
            continue
        name, lies = part.name, part.lies
        contact = model.fact("bed contact", (name,), partial(_contact_values, model, part))
        on = PlatformContact(**contact)
        if not lies.tilt_deg:
            limit = f">= {MIN_CONTACT_MM2:g} mm2"
            value, status = f"{on.contact_mm2:.1f} mm2", graded(on.contact_mm2 >= MIN_CONTACT_MM2)
            yield Check(f"bed-contact.{name}", "bed contact", name, value, limit, status)
        if on.ceilings_mm2:
            span_mm = model.design.resin_printer.ceiling_span_mm
            limit = f"<= {span_mm:g} mm across (resin_printer.ceiling_span_mm), or on supports"
            status = graded(bool(lies.supports) or on.span_mm <= span_mm)
            value = on.ceilings_text(lies.supports)
            yield Check(f"ceilings.{name}", "ceilings", name, value, limit, status)


def _contact_values(model: BuiltDesign, part: Part) -> dict[str, Any]:
    return asdict(find_contact(lay_on_platform(model.mesh(part.name), part.lies)))


def height_fields(model: BuiltDesign) -> Iterator[Check]:
    """One row for all of them, with the worst."""
    parts = [part for part in model.parts if part.indenter is not None]
    misses = {
        part.name: model.fact("height field", (part.name,), partial(_miss_mm, model, part))
        for part in parts
    }
    worst = max(misses, key=lambda name: misses[name])
    miss = misses[worst]
    value = f"{miss:.1e} mm at most, {len(parts)} x {POINTS} points"
    passed = miss <= FIELD_MM
    text, limit = value if passed else f"{miss:.3g} mm off: {worst}", f"<= {FIELD_MM:g} mm"
    name = "indenter height field"
    yield Check("height-fields", name, "indenters", text, limit, graded(passed))


def _miss_mm(model: BuiltDesign, part: Part) -> float:
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
