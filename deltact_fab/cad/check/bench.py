"""The bench's parts against each other: coaxial holes, and the whole stack put together."""

from __future__ import annotations

import math
from collections.abc import Iterator

from ..assembly import IN_PLACE_OF, ON_STAGE, ON_TABLE, mouth_mm
from ..dimensions import Design
from ..part import Part, Shift
from ..parts.indenter import plate_half_mm
from ..parts.nano17_adapter import SIZE
from .built import BuiltDesign
from .pairs import PlacedSolid, pieces, shared
from .row import Row
from .space import TOUCH_MM3

NAME = "bench holes coaxial"
AXIS_MM = 1e-4
CLEAR, REACH = "bench clear", "bench reach"
GAP_MM = 1.0  # least, from what hangs from the stage to what stands on the table


def rows(built: BuiltDesign) -> Iterator[Row]:
    """A row a pair, from the solids: each hole of the first has one of the second on its axis."""
    tool, plate, table = built.design.tool, built.design.adapter, built.design.table
    pin = tool.pin_mm + tool.pin_fit_mm
    yield _pair(built, ("tool-holder", tool.screw_hole_mm), ("nano17-adapter", plate.pilot_mm), 4)
    yield _pair(built, ("tool-holder", pin), ("nano17-adapter", tool.pin_mm), 1)
    tapped = built.design.stage_plate.thread_hole_mm
    yield _pair(built, ("testing-shell", table.hole_mm), ("stage-plate", tapped), 4)


def stack(built: BuiltDesign) -> Iterator[Row]:
    """Stage plate and sensor, indenter, tool holder, adapter, force sensor, pressed together.

    The tip is as deep as the press that the design is made for (`plate.depth_mm`), where it shares
    room with the skin alone. What hangs may stand over any place of the face: it has to keep above
    everything that stands.
    """
    depth_mm = built.design.plate.depth_mm
    tips = [part for part in built.parts if part.indenter is not None]
    if not tips:
        yield Row(CLEAR, "bench", "no indenter is listed", "one indenter at least", False)
        return
    # All stems are alike: the widest back plate has the least room.
    widest = max(tips, key=lambda part: max(plate_half_mm(part.source(built.design))))
    named = {part.name: part for part in built.parts}
    under = pieces([named[name] for name in ON_TABLE], built)
    sensor = pieces(
        [p for p in built.parts if p.group == "sensor" and p.name != IN_PLACE_OF], built
    )
    held = [widest, *(named[name] for name in ON_STAGE)]
    hanging = [PlacedSolid(part, 0, _hung(built.design, part, widest)) for part in held]
    standing = [*under, *sensor]
    shares = [
        *shared(built, under), *shared(built, under, sensor),
        *shared(built, hanging), *shared(built, hanging, standing),
    ]  # fmt: skip
    pressed = {widest.name, "skin"}
    clashes = sorted(
        ((mm3, f"{one} in {other}: {mm3:.3f} mm3") for one, other, mm3 in shares
         if mm3 > TOUCH_MM3 and {one, other} != pressed), reverse=True
    )  # fmt: skip
    low = min(piece.box(built)[0][2] for piece in standing)
    top = max(piece.box(built)[1][2] for piece in standing)
    high = max(piece.box(built)[1][2] for piece in hanging)
    found = f"none of {len(standing)} pieces on the table and {len(hanging)} on the stage"
    yield Row(
        CLEAR,
        f"bench, {widest.name}",
        "; ".join(text for _, text in clashes[:4]) or found,
        f"<= {TOUCH_MM3:g} mm3 a pair, {depth_mm:g} mm deep (plate.depth_mm)",
        not clashes,
        SIZE,
    )
    free = {part.name: part.source(built.design).plate_z_mm for part in tips}
    gap, short = min((mm - depth_mm - top, name) for name, mm in free.items())
    yield Row(
        REACH,
        f"bench, {len(tips)} indenters",
        f"back plates {gap:.1f} mm or more above the face ({short}) at {depth_mm:g} mm; "
        f"{high - low:.1f} mm from the table to the force sensor's back",
        f">= {GAP_MM:g} mm anywhere on the face (plate.depth_mm)",
        gap >= GAP_MM,
        SIZE,
    )


def _hung(design: Design, part: Part, indenter: Part) -> Shift:
    """Where a piece hangs: the tip plate.depth_mm in the gel, the holder's mouth on its plate."""
    depth_mm = design.plate.depth_mm
    if part is indenter:
        return 0.0, 0.0, -depth_mm
    x, y, z = part.places(design)[0]
    return x, y, z + mouth_mm(indenter) - depth_mm


def _centres(built: BuiltDesign, name: str, diameter_mm: float) -> list[tuple[float, float]]:
    """Axes of a part's holes of one diameter, each once."""
    found: list[tuple[float, float]] = []
    for c in built.cylinders(name):
        at = (c.low_mm[0], c.low_mm[1])
        fits = c.hole and abs(2 * c.radius_mm - diameter_mm) < 1e-6
        if fits and all(math.dist(at, other) > AXIS_MM for other in found):
            found.append(at)
    return found


def _pair(
    built: BuiltDesign, first: tuple[str, float], second: tuple[str, float], count: int
) -> Row:
    one, other = _centres(built, *first), _centres(built, *second)
    parts = f"{first[0]}, {second[0]}"
    limit = f"{count} holes within {AXIS_MM:g} mm"
    if len(one) < count or len(other) < count:
        found = f"{len(one)} of {first[1]:g} mm and {len(other)} of {second[1]:g} mm"
        return Row(NAME, parts, found, limit, False)
    # Other holes may have the same diameter: the nearest count.
    off = sorted(min(math.dist(a, b) for b in other) for a in one)[count - 1]
    return Row(NAME, parts, f"{count} holes, {off:.1e} mm off", limit, off <= AXIS_MM)
