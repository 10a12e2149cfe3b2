"""An indenter: the tips of shapes.Indenter on their shanks, a back plate, a stem for the holder.

    4dots                      sphere:10

        | |  stem                  | |
      +-----+                    +-----+
      |plate|  plate_mm          |     |
      ++-+-++                    ++---++
       | | |   shanks             |   |
       u u u   tips    z = 0       \\_/

The lowest point is at z = 0, on the axis x = y = 0 of the stem; the body lies above. The tips'
underside is `Indenter.height_mm`; elsewhere the plate is lowest, at `Indenter.reach_mm`. Drawings
show it with its tips up.
"""

from __future__ import annotations

import math
from dataclasses import fields
from itertools import pairwise
from typing import Any

from deltact_fab.sensor import (
    EllipsoidTip,
    Indenter,
    PlainTip,
    PosedTip,
    PrismTip,
    RidgeTip,
    SphereTip,
    TurnedTip,
)

from ..design import IndenterBody, IndenterDimensions
from ..drafting.dimensioning import Callouts, Leader, Span, fmt, z_of
from ..kernel import Extent, Shape, around, require
from ..part import RESIN_MATERIAL, WHITE_RGBA, Part, PrintPose

_OPEN_WIRE_MM = 1e-6  # by hand: above rounding; larger leaves a wire open


def closed(plan: Any) -> Any:
    """Join a workplane's pending edges to one pending wire, closed by a line if it is open.

    Replaces `Workplane.close()`: given all edges at once, the kernel chooses by memory address
    which of two coincident ends it keeps, and these differ in the last bits. Files would then
    differ from run to run.
    """
    cq = require()
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeWire

    edges = plan.ctx.popPendingEdges()
    start, end = edges[0].startPoint(), edges[-1].endPoint()
    if (end - start).Length > _OPEN_WIRE_MM:
        edges.append(cq.Edge.makeLine(end, start))
    joined = BRepBuilderAPI_MakeWire()
    for edge in edges:
        joined.Add(edge.wrapped)
    plan.ctx.firstPoint = None
    return plan.newObject([cq.Wire(joined.Wire())]).toPending()


def plate_half_mm(dims: IndenterDimensions) -> tuple[float, float]:
    """Half sides (x, y) of the back plate: it covers the tips' footprint and the stem."""
    stem_mm = dims.indenter.stem_diameter_mm / 2
    x_mm, y_mm = dims.indenter.footprint_half_mm
    return max(x_mm, stem_mm), max(y_mm, stem_mm)


def round_plate_mm(dims: IndenterDimensions) -> float:
    """Radius of the plate of a single round tip on the axis; 0 for a rectangular plate."""
    first, *rest = dims.indenter.tips
    round_ = isinstance(first, SphereTip | TurnedTip) and first.x_mm == first.y_mm == 0
    return plate_half_mm(dims)[0] if round_ and not rest else 0.0


def box(dims: IndenterDimensions) -> Extent:
    """Bounding box, from the lowest point to the end of the stem; the plate is the widest."""
    top = dims.indenter.reach_mm + dims.body.plate_mm + dims.indenter.stem_length_mm
    return around(*plate_half_mm(dims), 0.0, top)


def build(dims: IndenterDimensions) -> Shape:
    """The indenter as one solid in its own frame, z from 0 to the end of the stem."""
    cq = require()
    indenter = dims.indenter
    plate_z, plate_mm = dims.indenter.reach_mm, dims.body.plate_mm
    x, y = plate_half_mm(dims)
    base = cq.Workplane().workplane(offset=plate_z)
    if radius := round_plate_mm(dims):
        plate = base.circle(radius).extrude(plate_mm)
    else:
        plate = base.rect(2 * x, 2 * y).extrude(plate_mm).edges("|Z").fillet(corner_mm(dims))
    stem = (
        cq.Workplane()
        .workplane(offset=plate_z + plate_mm)
        .circle(indenter.stem_diameter_mm / 2)
        .extrude(indenter.stem_length_mm)
    )
    r = indenter.stem_diameter_mm
    flat_cut = cq.Workplane(origin=(indenter.stem_flat_at_mm + r, 0, plate_z + plate_mm))
    stem = stem.cut(flat_cut.rect(2 * r, 2 * r).extrude(indenter.stem_length_mm))
    body = plate.union(stem)
    for tip in indenter.tips:
        if isinstance(tip, PosedTip):
            tip_solid = _posed(cq, tip, plate_z)
        else:
            tip_solid = _tip(cq, tip, plate_z).translate((tip.x_mm, tip.y_mm, 0))
        body = body.union(tip_solid)
    return body.val()


def _posed(cq: Any, posed: PosedTip, top_mm: float) -> Any:
    """Return the rotated tip with a long shank, cut off at the back plate."""
    reach = 4 * (top_mm + max(posed.half_mm))
    body = _tip(cq, posed.tip, reach)
    for angle, axis in (
        (posed.tilt_x_deg, (1, 0, 0)), (posed.tilt_y_deg, (0, 1, 0)), (posed.turn_deg, (0, 0, 1)),
    ):  # fmt: skip
        body = body.rotate((0, 0, 0), axis, angle) if angle else body
    body = body.translate(tuple(posed.origin_mm.tolist()))
    block = cq.Workplane(origin=(0, 0, top_mm - reach)).rect(reach, reach).extrude(reach)
    return body.intersect(block)


def _tip(cq: Any, tip: PlainTip, top_mm: float) -> Any:
    """Return a workplane with one tip and its shank up to top_mm, about its own axis."""
    match tip:
        case SphereTip():
            return _ball(cq, tip.radius_mm, top_mm)
        case RidgeTip():
            return _ridge(cq, tip, top_mm)
        case EllipsoidTip():
            return _ellipsoid(cq, tip, top_mm)
        case PrismTip():
            return _prism(cq, tip, top_mm)
        case TurnedTip():
            return _turned(cq, tip, top_mm)


def _ball(cq: Any, r: float, top_mm: float) -> Any:
    """Half a ball of radius r and a cylinder above its equator."""
    half = (
        cq.Workplane("XZ")
        .moveTo(0, 0)
        .threePointArc((r * math.sin(math.pi / 4), r - r * math.cos(math.pi / 4)), (r, r))
        .lineTo(r, top_mm)
        .lineTo(0, top_mm)
    )
    return closed(half).revolve(360, (0, 0, 0), (0, 1, 0))


def _ridge(cq: Any, tip: RidgeTip, top_mm: float) -> Any:
    """Return the profile extruded, with half of it revolved about its middle at both ends."""
    n, z, w = tip.nose_half_mm, tip.nose_height_mm, tip.half_width_mm
    half_angle = math.radians(90 - tip.flank_deg) / 2
    r = tip.radius_mm
    nose = (r * math.sin(half_angle), r - r * math.cos(half_angle))
    profile = (
        cq.Workplane("XZ", origin=(0, tip.length_mm / 2, 0))
        .moveTo(-w, top_mm)
        .lineTo(-w, tip.equator_mm)
        .lineTo(-n, z)
        .threePointArc((0, 0), (n, z))
        .lineTo(w, tip.equator_mm)
        .lineTo(w, top_mm)
    )
    ridge = closed(profile).extrude(tip.length_mm)
    for sign in (-1, 1):
        half = (
            cq.Workplane("XZ")
            .moveTo(0, 0)
            .threePointArc(nose, (n, z))
            .lineTo(w, tip.equator_mm)
            .lineTo(w, top_mm)
            .lineTo(0, top_mm)
        )
        end = closed(half).revolve(180, (0, 0, 0), (0, sign, 0))
        ridge = ridge.union(end.translate((0, sign * tip.length_mm / 2, 0)))
    return ridge


def _ellipsoid(cq: Any, tip: EllipsoidTip, top_mm: float) -> Any:
    """Return half an ellipse revolved by 180° about its long axis, and an elliptic shank."""
    a, b = tip.a_mm, tip.b_mm
    plan = cq.Workplane().moveTo(a, 0).ellipseArc(a, b, 0, 180)
    half = closed(plan).revolve(180, (0, 0, 0), (-1, 0, 0))
    shank = cq.Workplane(origin=(0, 0, b)).ellipse(a, b).extrude(top_mm - b)
    return shank.union(half.translate((0, 0, b)))


def _prism(cq: Any, tip: PrismTip, top_mm: float) -> Any:
    """Return the extruded outline with a rounded edge of its face."""
    start, segments = tip.outline()
    plan = cq.Workplane().moveTo(*start)
    for kind, points in segments:
        plan = plan.lineTo(*points[0]) if kind == "line" else plan.threePointArc(*points)
    return closed(plan).extrude(top_mm).faces("<Z").edges().fillet(tip.edge_mm)


def _turned(cq: Any, tip: TurnedTip, top_mm: float) -> Any:
    """Return the revolved profile and shank; a profile with a hole gives a tube."""
    start, segments = tip.profile()
    half = cq.Workplane("XZ").moveTo(*start)
    for kind, points in segments:
        half = half.lineTo(*points[0]) if kind == "line" else half.threePointArc(*points)
    half = half.lineTo(tip.rim_mm, top_mm).lineTo(start[0], top_mm)
    return closed(half).revolve(360, (0, 0, 0), (0, 1, 0))


def corner_mm(dims: IndenterDimensions) -> float:
    """Corner radius of a rectangular plate, small enough to cover every tip."""
    smallest = min(t.corner_mm for t in dims.indenter.tips)
    return min(smallest, 0.9 * min(plate_half_mm(dims)))


def part(indenter: Indenter, body: IndenterBody, quantity: int = 1) -> Part:
    """Return one indenter as a part; cad/indenters.toml lists them."""
    return Part(
        f"indenter-{indenter.slug}",
        build,
        box,
        material=RESIN_MATERIAL,
        quantity=quantity,
        group="indenters",
        colour=WHITE_RGBA,
        callouts=callouts,
        pose=PrintPose("+z", "stem's end", supports="under the plate only"),
        look_for="no mark on the tip; the stem enters the tool holder, flat at +x, by hand",
        indenter=IndenterDimensions(indenter, body),
    )


def callouts(dims: IndenterDimensions) -> Callouts:
    """Drawing content: plate, stem and tips."""
    indenter, back = dims.indenter, dims.indenter.reach_mm + dims.body.plate_mm
    lengths = [z_of(back, back + indenter.stem_length_mm, fitted=False)]
    labels: list[Leader] = []
    tip = max(indenter.tips, key=lambda t: (t.x_mm, t.y_mm))
    if isinstance(tip, RidgeTip):
        # Half-way from the nose's top to where its flank begins.
        turn, r = math.radians(90 - tip.flank_deg) / 2, tip.radius_mm
        tangent_point = (tip.x_mm + r * math.sin(turn), tip.y_mm, r * (1 - math.cos(turn)))
        words = f"flanks at {fmt(tip.flank_deg)}° to the axis"
        labels.append(Leader("front", tangent_point, 0, words))
    elif isinstance(tip, EllipsoidTip):
        words = f"half an ellipsoid, semi-axes {fmt(tip.a_mm)} (x), {fmt(tip.b_mm)} (y and z)"
        labels.append(Leader("front", (tip.x_mm, tip.y_mm, 0), 0, words))
    elif isinstance(tip, TurnedTip):
        for radius_mm in _profile_radii_mm(tip):
            lengths.append(Span(0, -radius_mm, radius_mm, fitted=False, prefix="Ø"))
    level = "Tips level with one another" if len(indenter.tips) > 1 else "Tip square to the stem"
    posed = [_posed_words(t) for t in indenter.tips if isinstance(t, PosedTip)]
    if any(isinstance(t, PosedTip) and t.tilted for t in indenter.tips):
        level = "Lowest points of all tips level"
    notes = (*posed, f"{level}. Contact faces smooth, without support marks.")
    return Callouts(tuple(lengths), notes=notes, labels=tuple(labels), flipped=True)


def _posed_words(posed: PosedTip) -> str:
    """Describe a tip that no view shows square on: its dimensions and rotations."""
    kind = type(posed.tip).__name__.removesuffix("Tip").lower()
    sizes = ", ".join(
        f"{f.name.removesuffix('_mm').replace('_', ' ')} {fmt(value)}"
        for f in fields(posed.tip)
        if f.name not in ("x_mm", "y_mm")
        and isinstance(value := getattr(posed.tip, f.name), int | float)
    )
    turns = ", ".join(
        f"{words} {fmt(angle)}°"
        for words, angle in (
            ("tilted about x", posed.tilt_x_deg),
            ("about y", posed.tilt_y_deg),
            ("turned about z", posed.turn_deg),
        )
        if angle
    )
    return f"{kind}: {sizes}; {turns}, in this order.".capitalize()


def _profile_radii_mm(tip: TurnedTip) -> list[float]:
    """Radii at which two straight segments of a revolved profile meet."""
    _, segments = tip.profile()
    return [
        points[-1][0]
        for (kind, points), following in pairwise(segments)
        if kind == "line" and following[0] == "line"
    ]
