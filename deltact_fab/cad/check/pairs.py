"""Pieces in their places: their boxes, and the volume that two of them share, each kept by itself.

A pair is intersected again only when one of its parts, or where it stands, has changed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations, product

from ..assembly import PlacedPart, common_mm3, meet
from ..part import Part, Shift
from ..solid_gate import Box
from .built import BuiltDesign

Pair = tuple[str, str, float]


@dataclass(frozen=True)
class PlacedSolid:
    """One piece of a part. place: by how much it is moved, read from the design each time."""

    part: Part
    index: int
    place: Callable[[BuiltDesign], Shift]

    @property
    def label(self) -> str:
        """Unique among the pieces."""
        return f"{self.part.name} {self.index + 1}"

    def box(self, built: BuiltDesign) -> Box:
        """Its box where it stands."""
        name = self.part.name
        low, high = built.result(f"box: {name}", partial(built.box, name))
        x, y, z = self.place(built)
        return (low[0] + x, low[1] + y, low[2] + z), (high[0] + x, high[1] + y, high[2] + z)


def pieces(parts: Sequence[Part], built: BuiltDesign) -> list[PlacedSolid]:
    """Every piece of the parts where `Part.places` puts it."""
    return [
        PlacedSolid(part, index, partial(_own_place, part, index))
        for part in parts
        for index in range(len(part.places(built.design)))
    ]


def shared(
    built: BuiltDesign,
    label: str,
    some: Sequence[PlacedSolid],
    others: Sequence[PlacedSolid] | None = None,
) -> Iterator[Pair]:
    """Names of two parts and the volume in mm3 that their pieces share, where boxes meet.

    Pairs within `some`, or of one of `some` and one of `others`. label: tells apart assemblies in
    which the same pieces stand elsewhere. Raises RunFailed as `common_mm3` does.
    """
    boxes = {piece.label: piece.box(built) for piece in (*some, *(others or ()))}
    for a, b in combinations(some, 2) if others is None else product(some, others):
        if meet(boxes[a.label], boxes[b.label]):
            first, second = sorted((a.part.name, b.part.name))
            name = f"{label}: {a.label}, {b.label}"
            yield first, second, built.result(name, partial(_common_mm3, built, a, b))


def _own_place(part: Part, index: int, built: BuiltDesign) -> Shift:
    return part.places(built.design)[index]


def _common_mm3(built: BuiltDesign, a: PlacedSolid, b: PlacedSolid) -> float:
    """Everything it depends on is read here, so that it is noted."""
    from cadquery import Location

    one, other = (
        PlacedPart(piece.part, piece.index, built.solid(piece.part.name).moved(Location(at)), at)
        for piece in (a, b)
        for at in (piece.place(built),)
    )
    return common_mm3(one, other)
