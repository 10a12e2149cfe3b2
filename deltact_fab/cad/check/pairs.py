"""The volume that two pieces share, each pair kept by itself.

A pair is intersected again only when a part, or how the two stand to each other, has changed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import combinations, product

from ..assembly import PartPlace, common_mm3, meet
from ..solid_gate import Box, shifted
from .built import BuiltDesign

Pair = tuple[str, str, float]


def box_of(built: BuiltDesign, place: PartPlace) -> Box:
    """The box of a piece where it stands."""
    return shifted(built.box(place.part.name), place.shift_mm)


def shared(
    built: BuiltDesign, some: Sequence[PartPlace], others: Sequence[PartPlace] | None = None
) -> Iterator[Pair]:
    """Names of two parts and the volume in mm3 that their pieces share, where boxes meet.

    Pairs within `some`, or of one of `some` and one of `others`. Raises RunFailed as `common_mm3`
    does.
    """
    boxes = {place: box_of(built, place) for place in (*some, *(others or ()))}
    for a, b in combinations(some, 2) if others is None else product(some, others):
        if meet(boxes[a], boxes[b]):
            names = a.part.name, b.part.name
            apart = [round(q - p, 9) for p, q in zip(a.shift_mm, b.shift_mm, strict=True)]
            what = f"common volume {apart}"
            first, second = sorted(names)
            yield first, second, built.fact(what, names, partial(_common_mm3, built, a, b))


def _common_mm3(built: BuiltDesign, *pair: PartPlace) -> float:
    one, other = (place.put(built.solid(place.part.name)) for place in pair)
    return common_mm3(one, other)
