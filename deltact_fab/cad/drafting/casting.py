"""What stands on the bench at each step of printing, casting, film and coats, from the solids.

The mold is shown with one cavity where it is looked into, cut through its middle. What is no part
of a design (cup, tape, level, rule, masks) has the size that such things have. Film and coats are
drawn as thick as they can be seen.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ..assembly import PlacedPart
from ..dimensions import Design
from ..kernel import require
from ..part import AMBER, BLACK, CLEAR, GREEN, STEEL, WHITE, Part
from ..parts import coupon_mold, mold
from ..registry import find

BESIDE_MM = 8.0  # between things that lie side by side
OVER_MM = 12.0  # what is lifted, over where it came from
TIPPED_DEG = -10.0
SEEN_MM = 0.4  # thickness at which a film can be seen
BLUE = (0.25, 0.45, 0.75, 1.0)


class Bench:
    """The things of one design; `solids` are its parts as built, by name."""

    def __init__(self, design: Design, solids: Mapping[str, Any]):
        self._cq = require()
        self._d = design
        self._solids = solids

    def steps(self) -> Iterator[tuple[str, list[PlacedPart]]]:
        """Each step of sections A to F that handles something, and what lies there."""
        d = self._d
        coupon, frame, sheet = "coupon-mold", "skin-frame", "acrylic"
        yield "A.1", self._row(coupon, frame)
        yield "A.2", self._row("light-holder", frame, "cover", turned=(frame,))
        yield "A.3", self._row("mold", coupon, frame)
        places = mold.centres_mm(d)
        whole = self._part("mold")
        seated, above = self._cast(frame, places[-1]), self._cast(frame, places[0], OVER_MM)
        yield "A.4", [*whole, *(seated if len(places) > 1 else []), *above]

        wells = coupon_mold.centres_mm(d)
        base, deep, radius = d.coupon.base_mm, d.coupon.depth_mm, d.coupon.diameter_mm / 2
        block = self._part(coupon)
        film = [self._disc(x, y, radius - 0.1, base, SEEN_MM) for x, y in wells[1:]]
        yield "B.1", [*block, *self._of("lacquer", CLEAR, film)]
        full = [self._disc(x, y, radius - 0.1, base, deep) for x, y in wells]
        yield "B.2", [*block, *self._of("silicone", CLEAR, full)]
        up = [piece.translate(self._cq.Vector(0, 0, deep + OVER_MM)) for piece in full]
        yield "B.3", [*block, *self._of("silicone", CLEAR, up)]

        x, y = d.acrylic_half_mm
        blank = self._box(2 * x + 10, 2 * y + 10, d.z_joint_mm, d.optics.acrylic_mm)
        hole = self._box(2 * x + 0.3, 2 * y + 0.3, d.z_joint_mm - 1, d.optics.acrylic_mm + 2)
        yield "C.1", [*self._of("sheet", CLEAR, [blank.cut(hole)]), *self._part(sheet, up=OVER_MM)]
        yield "C.2", [*self._cast(frame, (0, 0)), *self._cast(sheet, (0, 0), OVER_MM)]
        low, high = (self._mask(z) for z in (d.z_joint_mm - SEEN_MM - 3, d.z_ledge_mm + 3))
        yield "C.4", [*self._part(sheet), *self._of("mask", BLUE, [low, high])]

        level = self._box(60.0, 8.0, d.mold_outer_mm[2], 10.0)
        yield "D.1", [*whole, *self._of("spirit level", GREEN, [level])]
        peeled = self._turn(self._mask(d.z_ledge_mm), (1, 0, 0), -25, (0, y, d.z_ledge_mm))
        yield "D.2", [*self._part(sheet), *self._of("mask", BLUE, [low, peeled])]
        at = [(px, py) for px, py in d.screw_centres_mm]
        tape = [self._box(4.0, 4.0, d.z_joint_mm - 0.3, 0.3, px, py) for px, py in at]
        first = [self._into_mold(piece, places[0]) for piece in tape]
        frames = [piece for place in places for piece in self._cast(frame, place)]
        yield "D.3", [*whole, *frames, *self._of("tape", BLUE, first)]
        cup, mixed = self._cup(12.0), self._cup(24.0)
        yield "D.4", [*cup, *self._moved(self._cup(0.0), (60, 0, 0))]
        yield "D.5", [*self._cup(44.0), *self._moved(mixed, (60, 0, 0))]
        deep = d.mold.base_mm + d.skin.protrusion_mm + 1.0
        opened = self._opened()
        yield "D.6", [*self._tipped(opened), *self._poured(deep, tipped=True)]
        filled = self._poured(d.mold.base_mm + d.skin.thickness_mm)
        yield "D.7", [*opened, *filled]
        lid = self._cast(sheet, (0, 0))
        z = d.mold.base_mm + d.skin.thickness_mm
        lid = self._turned_pieces(lid, (1, 0, 0), 20, (0, -y, z))
        one = [*self._cut(self._one()), *self._cast(frame, (0, 0))]
        yield "D.8", [*one, *filled, *lid]
        home = self._halved(self._cast(sheet, (0, 0)))
        yield "D.9", [*opened, *filled, *home]
        cast = [piece for name in ("skin", frame, sheet) for piece in self._cast(name, (0, 0))]
        notch = d.mold.base_mm + d.skin.protrusion_mm
        side = d.frame_outer_mm[1] / 2
        blade = self._box(d.mold.pry_width_mm - 2, 30, notch, 0.6, 0, -side - 15)
        lifted = self._moved(cast, (0, 0, OVER_MM))
        yield "D.10", [*self._cut(self._one()), *lifted, *self._of("blade", STEEL, [blade])]

        own = [piece for name in ("skin", frame, sheet) for piece in self._part(name)]
        wide, long = d.skin.film_mm()
        flat = self._box(wide, long, 0.0, SEEN_MM)
        rule = self._box(34.0, 6.0, SEEN_MM, 0.6)
        yield "E.2", [*self._of("film", BLUE, [flat]), *self._of("rule", STEEL, [rule])]
        beside = (d.frame_outer_mm[0] / 2 + wide / 2 + BESIDE_MM, 0, d.z_joint_mm)
        yield "E.3", [*own, *self._moved(self._of("film", BLUE, [flat]), beside)]
        fx, fy = d.frame_outer_mm
        front = -d.skin.protrusion_mm
        ring = self._box(fx, fy, front, 0.3).cut(
            self._box(d.skin.width_mm, d.skin.length_mm, front - 1, 3.0)
        )
        masked = [*own, *self._of("tape", BLUE, [ring])]
        yield "E.4", masked
        yield "E.5", [*masked, *self._moved(self._of("film", GREEN, [flat]), (0, 0, OVER_MM))]
        skirt = min(d.skin.protrusion_mm - 0.5, d.skin.edge_fillet_mm + 2.0)
        yield "E.6", [*masked, *self._of("film", GREEN, [self._coat(0.0, SEEN_MM, skirt)])]
        printed = self._of("film", GREEN, [self._coat(0.0, SEEN_MM, d.skin.edge_fillet_mm)])
        yield "E.7", [*masked, *printed]

        pan = self._disc(0, 0, max(fx, fy) / 2 + 4, d.z_joint_mm - 4.0, 4.0)
        yield "F.1", [*own, *printed, *self._of("balance", STEEL, [pan])]
        yield "F.2", self._cup(6.0, "white mixture", WHITE)
        half = [*self._halved(own), *self._halved(printed)]
        depth = d.skin.protrusion_mm - 0.01
        white = self._of("white coat", WHITE, [self._coat(SEEN_MM, 2 * SEEN_MM, depth)])
        black = self._of("black coat", BLACK, [self._coat(2 * SEEN_MM, 3 * SEEN_MM, depth)])
        yield "F.3", [*own, *white]
        yield "F.4", [*half, *self._halved(white)]
        yield "F.5", [*half, *self._halved(white), *self._halved(black)]
        yield "F.6", [*own, *black]

    # What lies there.

    def _of(self, name: str, colour: tuple[float, float, float, float], solids: Sequence[Any],
            ) -> list[PlacedPart]:  # fmt: skip
        part = Part(name, "", "", build=str, box=str, group="tools", colour=colour)  # type: ignore[arg-type]
        every = [one for solid in solids for one in solid.Solids()]
        return [PlacedPart(part, i, one, (0.0, 0.0, 0.0)) for i, one in enumerate(every)]

    def _part(self, name: str, up: float = 0.0) -> list[PlacedPart]:
        solid = self._solids[name].translate(self._cq.Vector(0, 0, up))
        return [PlacedPart(find(name), 0, solid, (0.0, 0.0, up))]

    def _cast(self, name: str, at: tuple[float, float], up: float = 0.0) -> list[PlacedPart]:
        """A part of the sensor in the mold, touched face down."""
        solid = self._into_mold(self._solids[name], at).translate(self._cq.Vector(0, 0, up))
        return [PlacedPart(find(name), 0, solid, (0.0, 0.0, 0.0))]

    def _into_mold(self, solid: Any, at: tuple[float, float]) -> Any:
        turned = self._turn(solid, (1, 0, 0), 180, (0, 0, 0))
        return turned.translate(self._cq.Vector(*at, self._d.mold.base_mm))

    def _row(self, *names: str, turned: Sequence[str] = ()) -> list[PlacedPart]:
        """Parts side by side, standing on one plane."""
        placed, x = [], 0.0
        for name in names:
            solid = self._solids[name]
            if name in turned:
                solid = self._turn(solid, (1, 0, 0), 180, (0, 0, 0))
            box = solid.BoundingBox()
            shift = self._cq.Vector(x - box.xmin, -box.ymin, -box.zmin)
            placed.append(PlacedPart(find(name), 0, solid.translate(shift), (0.0, 0.0, 0.0)))
            x += box.xlen + BESIDE_MM
        return placed

    def _turn(
        self, solid: Any, axis: tuple[float, ...], angle: float, at: tuple[float, ...]
    ) -> Any:
        start = self._cq.Vector(*at)
        return solid.rotate(start, start + self._cq.Vector(*axis), angle)

    def _with(self, piece: PlacedPart, solid: Any) -> list[PlacedPart]:
        return [
            PlacedPart(piece.part, piece.index + i, one, piece.shift_mm)
            for i, one in enumerate(solid.Solids())
        ]

    def _moved(self, pieces: Sequence[PlacedPart], by: tuple[float, ...]) -> list[PlacedPart]:
        shift = self._cq.Vector(*by)
        return [one for p in pieces for one in self._with(p, p.solid.translate(shift))]

    def _turned_pieces(
        self, pieces: Sequence[PlacedPart], axis: tuple[float, ...], angle: float,
        at: tuple[float, ...],
    ) -> list[PlacedPart]:  # fmt: skip
        turned = [(p, self._turn(p.solid, axis, angle, at)) for p in pieces]
        return [one for p, solid in turned for one in self._with(p, solid)]

    def _tipped(self, pieces: Sequence[PlacedPart]) -> list[PlacedPart]:
        """One y edge down."""
        return self._turned_pieces(pieces, (1, 0, 0), TIPPED_DEG, (0, 0, 0))

    def _halved(self, pieces: Sequence[PlacedPart]) -> list[PlacedPart]:
        """What lies beyond the plane x = 0."""
        beyond = self._box(200, 400, -200, 400, 100, 0)
        return [one for p in pieces for one in self._with(p, p.solid.intersect(beyond))]

    def _one(self) -> Any:
        """One cavity of the mold, about the axis."""
        d = self._d
        x, y = mold.centres_mm(d)[0]
        a, b = (side + 2 * d.mold.web_mm for side in d.frame_outer_mm)
        solid = self._solids["mold"].translate(self._cq.Vector(-x, -y, 0))
        return solid.intersect(self._box(a, b, -1.0, 100.0))

    def _cut(self, solid: Any) -> list[PlacedPart]:
        return self._with(PlacedPart(find("mold"), 0, solid, (0.0, 0.0, 0.0)), solid)

    def _opened(self) -> list[PlacedPart]:
        """One cavity with its frame, cut through the middle."""
        return self._halved([*self._cut(self._one()), *self._cast("skin-frame", (0, 0))])

    def _poured(self, level_mm: float, tipped: bool = False) -> list[PlacedPart]:
        """Silicone in the cavity up to a height over the mold's underside; level in either case."""
        skin = self._into_mold(self._solids["skin"], (0, 0))
        if tipped:
            skin = self._turn(skin, (1, 0, 0), TIPPED_DEG, (0, 0, 0))
        low = skin.intersect(self._box(400, 400, -100.0, level_mm + 100.0))
        return self._halved(self._of("silicone", CLEAR, [low]))

    # Simple bodies.

    def _box(
        self, x: float, y: float, low: float, high: float, at_x: float = 0.0, at_y: float = 0.0
    ) -> Any:
        return self._cq.Solid.makeBox(x, y, high, self._cq.Vector(at_x - x / 2, at_y - y / 2, low))

    def _disc(self, x: float, y: float, radius: float, low: float, high: float) -> Any:
        return self._cq.Solid.makeCylinder(
            radius, high, self._cq.Vector(x, y, low), self._cq.Vector(0, 0, 1)
        )

    def _mask(self, low_mm: float) -> Any:
        """The film that protects a face of the sheet."""
        x, y = self._d.acrylic_half_mm
        return self._box(2 * x, 2 * y, low_mm, SEEN_MM)

    def _cup(
        self, level_mm: float, name: str = "mixture",
        colour: tuple[float, float, float, float] = CLEAR,
    ) -> list[PlacedPart]:  # fmt: skip
        """A cup of 46 mm, cut open, with what is in it."""
        outer, inner = self._disc(0, 0, 23, 0, 56), self._disc(0, 0, 21.5, 1.5, 60)
        cup = self._halved(self._of("cup", AMBER, [outer.cut(inner)]))
        if not level_mm:
            return cup
        mixture = self._of(name, colour, [self._disc(0, 0, 21.4, 1.6, level_mm)])
        return [*cup, *self._halved(mixture)]

    def _cap(self, off_mm: float, depth_mm: float) -> Any:
        """The skin's proud part, larger by off_mm, down to depth_mm below the face."""
        skin = self._d.skin
        x, y = skin.width_mm + 2 * off_mm, skin.length_mm + 2 * off_mm
        block = self._box(x, y, -depth_mm - 9, depth_mm + 9 + off_mm)
        top = self._cq.Workplane(block).faces(">Z").edges().fillet(skin.edge_fillet_mm + off_mm)
        return top.val().intersect(self._box(400, 400, -depth_mm, 200))

    def _coat(self, inner_mm: float, outer_mm: float, depth_mm: float) -> Any:
        """A layer over the face and its sides between two distances from the skin."""
        return self._cap(outer_mm, depth_mm).cut(self._cap(inner_mm, depth_mm + 1))
