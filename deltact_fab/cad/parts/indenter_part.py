"""An indenter as a part, and what its drawing says; it is drawn with its tips up."""

from __future__ import annotations

import math
from collections.abc import Iterator

from ...aliases import Point2
from ...shapes import EllipsoidTip, Indenter, PrismTip, RidgeTip, SphereTip
from ...shapes.turned import TurnedTip
from ..design import IndenterBody, IndenterDimensions
from ..drafting.dimensioning import Axis, Centres, Circle, Detail, Item, Leader, Linear, shown
from ..drafting.items import Callouts, x_of, y_of, z_of
from ..part import PRINT, RESIN, WHITE, Part
from ..print_orientation import PrintPose
from .indenter import build, corner_mm, expect, plate_half_mm, round_plate_mm

SMALL_MM = 1.0  # what is smaller is drawn again in a detail


def part(indenter: Indenter, body: IndenterBody, quantity: int = 1) -> Part:
    """One indenter as a part; a list of indenters (cad/indenters.toml) says which there are."""
    return Part(
        f"indenter-{indenter.slug}",
        RESIN,
        PRINT,
        build,
        expect,
        quantity,
        "indenters",
        colour=WHITE,
        callouts=callouts,
        lies=PrintPose("+z", "stem's end", supports="under the plate only"),
        look_for="no mark on the tip; the stem enters the tool holder, flat at +x, by hand",
        indenter=IndenterDimensions(indenter, body),
    )


def callouts(dims: IndenterDimensions) -> Callouts:
    """Stem, plate, and what its kind of tips is made from."""
    indenter, plate = dims.indenter, dims.body.plate_mm
    box = expect(dims).box_mm
    half_x, half_y = plate_half_mm(dims)
    reach, total = dims.plate_z_mm, box[1][2]
    stem = indenter.stem_diameter_mm / 2
    tip_x = max(tip.lowest_mm[0] for tip in indenter.tips)
    round_plate = round_plate_mm(dims) > 0
    items: list[Item | Detail] = [
        Linear("front", (-tip_x, 0, 0), (-stem, 0, total), "left", auxiliary=True),
        Linear("front", (tip_x, 0, 0), (half_x, 0, reach), "right"),
        z_of("front", reach, reach + plate, "right", half_x),
        z_of("front", reach + plate, total, "right", stem),
        x_of("front", -stem, stem, "bottom", 0, total, before="Ø"),
        Leader(
            "front",
            (indenter.stem_flat_at_mm, 0, total - 2),
            0,
            f"flat {shown(indenter.stem_flat_at_mm)} from the axis, at +x",
        ),
        Axis("front", (0, 0, 0), (0, 0, total)),
        Axis("left", (0, 0, 0), (0, 0, total)),
        Centres("top", ((0, 0, 0),), max(half_x, half_y) if round_plate else stem),
    ]
    if round_plate:
        items.append(x_of("top", -half_x, half_x, "bottom", before="Ø"))
    else:
        r = corner_mm(dims)
        inset = r * (1 - math.sqrt(0.5))
        items += [
            x_of("top", -half_x, half_x, "bottom", half_y),
            y_of("top", -half_y, half_y, "left", -half_x),
            Leader("top", (half_x - inset, inset - half_y, 0), 0, _corners(dims)),
        ]
    items += _tips(dims)
    level = "Tips level with one another" if len(indenter.tips) > 1 else "Tip square to the stem"
    notes = (f"{level}. Contact faces smooth, without support marks.",)
    details = sorted((i for i in items if isinstance(i, Detail)), key=lambda d: d.letter)
    seen = tuple(item for item in items if not isinstance(item, Detail))
    convex = any(isinstance(t, PrismTip) and not _is_notched(t) for t in indenter.tips)
    silent = {"tip.notch_mm": "a convex prism has no notches"} if convex else {}
    return Callouts(seen, notes, flipped=True, details=tuple(details), silent=silent)


def _corners(dims: IndenterDimensions) -> str:
    """The plate's corners: as round as the tips, or as what is left of a narrow plate."""
    r = corner_mm(dims)
    alike = SphereTip | RidgeTip | PrismTip
    if any(isinstance(t, alike) and math.isclose(r, t.corner_mm) for t in dims.indenter.tips):
        return "4× round as the tips, plate"
    return f"4× R{shown(r)}, plate"


def _tips(dims: IndenterDimensions) -> Iterator[Item | Detail]:
    """What the tips of one kind are made from; they are alike."""
    tips = dims.indenter.tips
    tip = max(tips, key=lambda t: (t.x_mm, t.y_mm))
    count = f"{len(tips)}× " if len(tips) > 1 else ""
    xs = sorted({t.x_mm for t in tips})
    ys = sorted({t.y_mm for t in tips})
    if len(xs) > 1:
        yield x_of("top", xs[0], xs[-1], "top", ys[-1])
    if len(ys) > 1:
        yield y_of("top", ys[0], ys[-1], "right", xs[-1])
    x, y = tip.x_mm, tip.y_mm
    if isinstance(tip, SphereTip):
        r = tip.radius_mm
        if len(tips) > 1:
            yield Centres("top", tuple((t.x_mm, t.y_mm, 0.0) for t in tips), r)
        alike = len(tips) == 1 and math.isclose(r, plate_half_mm(dims)[0])
        shank = "shank and plate alike" if alike else f"shank Ø{shown(2 * r)}"
        yield Leader("front", (x, y, r), r, f"{count}SR, full radius; {shank}")
    elif isinstance(tip, RidgeTip):
        w, n = tip.half_width_mm, tip.length_mm / 2
        yield x_of("front", x - w, x + w, "top", y, tip.equator_mm, after=f" ({len(tips)}×)")
        yield y_of("left", -n, n, "top", x, 0)
        yield z_of("front", 0, tip.equator_mm, "right", x + w, y)
        yield Leader("top", (x, n, 0), w, f"{count}R, full radius at both ends")
        r, nose = tip.radius_mm, (x, y, tip.radius_mm)
        # Half-way from the nose's top to where its flank begins.
        turn = math.radians(90 - tip.flank_deg) / 2
        arc = (x + r * math.sin(turn), y, r * (1 - math.cos(turn)))
        words = f"{count}R{shown(r)}, flanks at {shown(tip.flank_deg)}° to the axis"
        if r < SMALL_MM:
            yield Detail("B", "front", nose, 4 * r)
        yield Leader("B" if r < SMALL_MM else "front", arc, 0, words)
    elif isinstance(tip, EllipsoidTip):
        a, b = tip.a_mm, tip.b_mm
        yield Linear("left", (x, y + b, 0), (x, y + b, b), "right", auxiliary=True)
        words = "half an ellipsoid, round about x"
        if (a, b) == dims.indenter.footprint_half_mm:
            words += "; as long and wide as the plate"
        else:
            words += f", semi-axes {shown(a)} (x), {shown(b)} (y and z)"
        yield Leader("front", (x, y, 0), 0, words)
    elif isinstance(tip, PrismTip):
        yield from _prism(tip, plate_half_mm(dims))
    else:
        yield from _turned(tip, plate_half_mm(dims)[0])


def _is_notched(tip: PrismTip) -> bool:
    """Whether its sides bend inwards between the points."""
    core = tip.outer_mm - tip.corner_mm
    straight = core * math.cos(math.pi / tip.points) + tip.corner_mm
    return tip.inner_mm < straight - 1e-9


def _prism(tip: PrismTip, plate_half_mm: Point2) -> Iterator[Item | Detail]:
    """A polygon's or a star's outline, and the edge of its face."""
    x, y, outer = tip.x_mm, tip.y_mm, tip.outer_mm
    yield Circle("top", (x, y, 0), outer)
    around = "as wide as the plate" if outer == plate_half_mm[0] else f"Ø{shown(2 * outer)}"
    yield Leader("top", (x, y, 0), outer, f"{around}, around {tip.points} corners")
    notched = _is_notched(tip)
    turn = math.pi / tip.points
    notch = (x + tip.inner_mm * math.cos(turn), y - tip.inner_mm * math.sin(turn), 0.0)
    seen = "top"
    if tip.corner_mm < SMALL_MM:
        seen = "C"
        # One circle for a point and, of a star, the notch beside it.
        far = (outer + notch[0] - x) / 2 if notched else outer - tip.corner_mm
        reach = outer - far + 2 * tip.corner_mm
        yield Detail("C", "top", (x + far, (y + notch[1]) / 2 if notched else y, 0), reach)
    yield Leader(seen, (x + outer, y, 0), 0, f"R{shown(tip.corner_mm)} ({tip.points}×)")
    if notched:
        words = f"sides meet on Ø{shown(2 * tip.inner_mm)}, rounded R{shown(tip.notch_mm)}"
        yield Leader(seen, notch, 0, words)
    elif tip.points % 4 == 2 and not math.isclose(tip.inner_mm, plate_half_mm[1]):
        # The flats of a hexagon lie at +-y; a square's lie between the axes.
        yield y_of("top", y - tip.inner_mm, y + tip.inner_mm, "right", x)
    edge = tip.edge_mm * (1 - math.sqrt(0.5))
    at = (x + outer - edge, y, edge)
    if tip.edge_mm < SMALL_MM:
        yield Detail("B", "front", at, 4 * tip.edge_mm)
    words = f"R{shown(tip.edge_mm)} around the face"
    yield Leader("B" if tip.edge_mm < SMALL_MM else "front", at, 0, words)


def _turned(tip: TurnedTip, plate_half_mm: float) -> Iterator[Item | Detail]:
    """A turned profile: diameters and heights of its corners, its radii, its flanks."""
    x, y = tip.x_mm, tip.y_mm
    start, drawn = tip.profile()
    rim = (tip.rim_mm, drawn[-1][1][-1][1])
    corners = [rim]
    letters = iter("BCDEF")
    before = start
    for (kind, points), after in zip(drawn, [*drawn[1:], ("", ())], strict=True):
        end = points[-1]
        if kind == "line" and after[0] == "line":
            corners.append(end)
        if kind == "arc":
            centre = next(p.centre_mm for p in tip.pieces if p.end_mm == end)
            assert centre is not None
            sort = "SR" if centre[0] == 0 else "R"
            at = (x + points[0][0], y, points[0][1])
            radius = math.dist(centre, end)
            view = "front"
            if radius < SMALL_MM:
                view = next(letters)
                yield Detail(view, "front", at, 4 * radius)
            yield Leader(view, at, 0, f"{sort}{shown(radius)}")
        elif before[1] != end[1]:
            slope = math.degrees(math.atan2(end[1] - before[1], end[0] - before[0]))
            at = (x + (before[0] + end[0]) / 2, y, (before[1] + end[1]) / 2)
            yield Leader("front", at, 0, f"{shown(slope)}° to the face")
        before = end
    for d, z in corners:
        if not math.isclose(d, plate_half_mm):
            yield x_of("front", x - d, x + d, "top", y, z, before="Ø")
        if (d, z) != rim:
            yield Linear("left", (x, y, 0), (x, y + d, z), "right")
    if start[0] > 0:
        yield x_of("front", x - start[0], x + start[0], "top", y, start[1], before="Ø")
