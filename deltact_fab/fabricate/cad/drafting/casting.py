"""Scenes of each step of printing, casting, film and coats, from the solids.

Where its inside matters, the mold is reduced to one cavity, cut through the middle. Aids outside
the design (tape, blade, masks) have typical sizes. Film and coats are drawn thick enough to see.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from ..assembly import PlacedPart
from ..dimensions import Design
from ..kernel import require
from ..part import BLACK_RGBA, CLEAR_RGBA, GREEN_RGBA, STEEL_RGBA, WHITE_RGBA, Part
from ..parts import coupons, mold
from ..registry import find_part

# By hand, for a clear picture: height of a lifted piece, tilt of the mold, drawn film thickness.
LIFTED_MM = 12.0
TIPPED_DEG = -10.0
FILM_MM = 0.4
TAPE_BLUE = (0.25, 0.45, 0.75, 1.0)


class CastingScenes:
    """Scenes for one design; solids: its built parts by name."""

    def __init__(self, design: Design, solids: Mapping[str, Any]):
        self._cq = require()
        self._d = design
        self._solids = solids

    def steps(self) -> Iterator[tuple[str, list[PlacedPart]]]:
        """Yield each joining step of sections A to F with its pieces."""
        d = self._d
        frame, sheet = "skin-frame", "acrylic"
        places = mold.centres_mm(d)
        mold_pieces = self._part("mold")
        seated = self._cast(frame, places[-1]) if len(places) > 1 else []
        yield "A.4", [*mold_pieces, *seated, *self._lifted(self._cast(frame, places[0]))]

        wells = coupons.centres_mm(d)
        base, deep, radius = d.coupon.base_mm, d.coupon.depth_mm, d.coupon.diameter_mm / 2
        block = self._part("coupon-mold")
        film = [self._disc(x, y, radius - 0.1, base, FILM_MM) for x, y in wells[1:]]
        yield "B.1", [*block, *self._bodies("lacquer", CLEAR_RGBA, film)]
        discs = [self._disc(x, y, radius - 0.1, base, deep) for x, y in wells]
        full = self._bodies("silicone", CLEAR_RGBA, discs)
        yield "B.2", [*block, *full]
        yield "B.3", [*block, *self._lifted(full)]

        x, y = d.acrylic_half_mm
        blank = self._box(2 * x + 10, 2 * y + 10, d.z_joint_mm, d.optics.acrylic_mm)
        hole = self._box(2 * x + 0.3, 2 * y + 0.3, d.z_joint_mm - 1, d.optics.acrylic_mm + 2)
        rest = self._bodies("sheet", CLEAR_RGBA, [blank.cut(hole)])
        yield "C.1", [*rest, *self._lifted(self._part(sheet))]
        yield "C.2", [*self._cast(frame), *self._lifted(self._cast(sheet))]
        tape = [self._box(4, 4, d.z_joint_mm - 0.3, 0.3, *centre) for centre in d.screw_centres_mm]
        first = [self._into_mold(piece, places[0]) for piece in tape]
        frames = [piece for place in places for piece in self._cast(frame, place)]
        yield "D.3", [*mold_pieces, *frames, *self._bodies("tape", TAPE_BLUE, first)]
        cavity, seat = self._cavity(), self._cast(frame)
        section = self._halved([*cavity, *seat])
        tipped = self._map(section, lambda solid: self._turned(solid, TIPPED_DEG))
        half_full = self._poured(d.mold.base_mm + d.skin.protrusion_mm + 1.0, TIPPED_DEG)
        yield "D.6", [*tipped, *half_full]
        filled = self._poured(d.mold.base_mm + d.skin.thickness_mm)
        yield "D.7", [*section, *filled]
        hinge = (0, -y, d.mold.base_mm + d.skin.thickness_mm)
        lid = self._map(self._cast(sheet), lambda solid: self._turned(solid, 20, hinge))
        yield "D.8", [*cavity, *seat, *filled, *lid]
        yield "D.9", [*section, *filled, *self._halved(self._cast(sheet))]
        cast = [piece for name in ("skin", frame, sheet) for piece in self._cast(name)]
        notch = d.mold.base_mm + d.skin.protrusion_mm
        side = d.frame_outer_mm[1] / 2
        blade = self._box(d.mold.pry_width_mm - 2, 30, notch, 0.6, 0, -side - 15)
        yield "D.10", [*cavity, *self._lifted(cast), *self._bodies("blade", STEEL_RGBA, [blade])]

        face_parts = [piece for name in ("skin", frame, sheet) for piece in self._part(name)]
        fx, fy = d.frame_outer_mm
        front = -d.skin.protrusion_mm
        flat = self._box(*d.skin.film_mm(), 0.0, FILM_MM)
        window = self._box(d.skin.width_mm, d.skin.length_mm, front - 1, 3.0)
        ring = self._box(fx, fy, front, 0.3).cut(window)
        masked = [*face_parts, *self._bodies("tape", TAPE_BLUE, [ring])]
        yield "E.4", masked
        yield "E.5", [*masked, *self._lifted(self._bodies("film", GREEN_RGBA, [flat]))]
        skirt = min(d.skin.protrusion_mm - 0.5, d.skin.edge_fillet_mm + 2.0)
        yield "E.6", [*masked, *self._bodies("film", GREEN_RGBA, [self._coat(0.0, FILM_MM, skirt)])]
        printed = self._bodies(
            "film", GREEN_RGBA, [self._coat(0.0, FILM_MM, d.skin.edge_fillet_mm)]
        )
        yield "E.7", [*masked, *printed]

        half = [*self._halved(face_parts), *self._halved(printed)]
        depth = d.skin.protrusion_mm - 0.01
        white = self._bodies("white coat", WHITE_RGBA, [self._coat(FILM_MM, 2 * FILM_MM, depth)])
        black = self._bodies(
            "black coat", BLACK_RGBA, [self._coat(2 * FILM_MM, 3 * FILM_MM, depth)]
        )
        yield "F.3", [*face_parts, *white]
        yield "F.4", [*half, *self._halved(white)]
        yield "F.5", [*half, *self._halved(white), *self._halved(black)]
        yield "F.6", [*face_parts, *black]

    # Pieces.

    def _bodies(self, name: str, colour: tuple[float, float, float, float], solids: Sequence[Any],
            ) -> list[PlacedPart]:  # fmt: skip
        part = Part(name, str, str, "", "", group="tools", colour=colour)  # type: ignore[arg-type]
        bodies = [body for solid in solids for body in solid.Solids()]
        return [PlacedPart(part, i, body, (0.0, 0.0, 0.0)) for i, body in enumerate(bodies)]

    def _part(self, name: str) -> list[PlacedPart]:
        return [PlacedPart(find_part(name), 0, self._solids[name], (0.0, 0.0, 0.0))]

    def _map(self, pieces: Sequence[PlacedPart], change: Callable[[Any], Any]) -> list[PlacedPart]:
        """Change the solid of each piece; a change may split it into several."""
        return [
            replace(p, index=p.index + i, solid=body)
            for p in pieces
            for i, body in enumerate(change(p.solid).Solids())
        ]

    def _lifted(self, pieces: Sequence[PlacedPart]) -> list[PlacedPart]:
        return self._map(pieces, lambda solid: solid.translate((0, 0, LIFTED_MM)))

    def _halved(self, pieces: Sequence[PlacedPart]) -> list[PlacedPart]:
        """Keep the half of each piece at x > 0."""
        half_space = self._box(200, 400, -200, 400, 100, 0)
        return self._map(pieces, lambda solid: solid.intersect(half_space))

    def _turned(
        self, solid: Any, angle_deg: float, pivot: tuple[float, float, float] = (0, 0, 0)
    ) -> Any:
        """Rotate about a line along x through a point."""
        return solid.rotate(pivot, (pivot[0] + 1, pivot[1], pivot[2]), angle_deg)

    def _cast(self, name: str, place: tuple[float, float] = (0, 0)) -> list[PlacedPart]:
        """Place a part of the sensor in the mold, touched face down."""
        return self._map(self._part(name), lambda solid: self._into_mold(solid, place))

    def _into_mold(self, solid: Any, place: tuple[float, float]) -> Any:
        return self._turned(solid, 180).translate((*place, self._d.mold.base_mm))

    def _cavity(self) -> list[PlacedPart]:
        """One cavity of the mold, about the axis."""
        x, y = mold.centres_mm(self._d)[0]
        a, b = (side + 2 * self._d.mold.web_mm for side in self._d.frame_outer_mm)
        around = self._box(a, b, -1.0, 100.0)
        return self._map(
            self._part("mold"), lambda solid: solid.translate((-x, -y, 0)).intersect(around)
        )

    def _poured(self, level_mm: float, tipped_deg: float = 0.0) -> list[PlacedPart]:
        """Silicone in the cavity up to a height above the mold's underside, surface level."""
        skin = self._turned(self._into_mold(self._solids["skin"], (0, 0)), tipped_deg)
        low = skin.intersect(self._box(400, 400, -100.0, level_mm + 100.0))
        return self._halved(self._bodies("silicone", CLEAR_RGBA, [low]))

    # Simple bodies.

    def _box(
        self, x: float, y: float, low: float, high: float, at_x: float = 0.0, at_y: float = 0.0
    ) -> Any:
        return self._cq.Solid.makeBox(x, y, high, (at_x - x / 2, at_y - y / 2, low))

    def _disc(self, x: float, y: float, radius: float, low: float, high: float) -> Any:
        return self._cq.Solid.makeCylinder(radius, high, (x, y, low))

    def _cap(self, off_mm: float, depth_mm: float) -> Any:
        """Protruding part of the skin, offset by off_mm, down to depth_mm below the face."""
        skin = self._d.skin
        x, y = skin.width_mm + 2 * off_mm, skin.length_mm + 2 * off_mm
        block = self._box(x, y, -depth_mm - 9, depth_mm + 9 + off_mm)
        top = self._cq.Workplane(block).faces(">Z").edges().fillet(skin.edge_fillet_mm + off_mm)
        return top.val().intersect(self._box(400, 400, -depth_mm, 200))

    def _coat(self, inner_mm: float, outer_mm: float, depth_mm: float) -> Any:
        """Layer over the face and its sides between two offsets from the skin."""
        return self._cap(outer_mm, depth_mm).cut(self._cap(inner_mm, depth_mm + 1))
