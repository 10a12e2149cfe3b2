"""Pieces in their places: their boxes, and the volume that two of them share, each kept by itself.

A pair is intersected again only when a part, or how the two stand to each other, has changed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations, product

from ..assembly import PlacedPart, common_mm3, meet
from ..part import Part, Shift
from ..solid_gate import Box, shifted
from .built import BuiltDesign

Pair = tuple[str, str, float]


@dataclass(frozen=True)
class PlacedSolid:
    """One piece of a part, which is moved by shift_mm; it is built when it is intersected."""

    part: Part
    index: int
    shift_mm: Shift

    def box(self, built: BuiltDesign) -> Box:
        """Its box where it stands."""
        return shifted(built.box(self.part.name), self.shift_mm)


def pieces(parts: Sequence[Part], built: BuiltDesign) -> list[PlacedSolid]:
    """Every piece of the parts where `Part.places` puts it."""
    return [
        PlacedSolid(part, index, shift)
        for part in parts
        for index, shift in enumerate(part.places(built.design))
    ]


def shared(
    built: BuiltDesign, some: Sequence[PlacedSolid], others: Sequence[PlacedSolid] | None = None
) -> Iterator[Pair]:
    """Names of two parts and the volume in mm3 that their pieces share, where boxes meet.

    Pairs within `some`, or of one of `some` and one of `others`. Raises RunFailed as `common_mm3`
    does.
    """
    boxes = {piece: piece.box(built) for piece in (*some, *(others or ()))}
    for a, b in combinations(some, 2) if others is None else product(some, others):
        if meet(boxes[a], boxes[b]):
            names = a.part.name, b.part.name
            apart = [round(q - p, 9) for p, q in zip(a.shift_mm, b.shift_mm, strict=True)]
            what = f"common volume {apart}"
            first, second = sorted(names)
            yield first, second, built.fact(what, names, partial(_common_mm3, built, a, b))


def _common_mm3(built: BuiltDesign, a: PlacedSolid, b: PlacedSolid) -> float:
    from cadquery import Location

    one, other = (
        PlacedPart(p.part, p.index, solid.moved(Location(p.shift_mm)), p.shift_mm)
        for p in (a, b)
        for solid in (built.solid(p.part.name),)
    )
    return common_mm3(one, other)
