"""Each drawing places and sizes every feature of its part's solid, and says nothing twice."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from ..drafting.scheme import scheme
from ..part import Part
from .built import BuiltDesign
from .row import Row

NAME = "drawings"
LIMIT = "each feature placed and sized once"


def rows(built: BuiltDesign) -> Iterator[Row]:
    """A row for each drawing with a fault, or one for all of them."""
    drawn = [part for part in built.parts if part.callouts is not None]
    told, complete = 0, True
    for part in drawn:
        faults, count = built.fact(NAME, (part.name,), partial(_planned, built, part))
        told += count
        if faults:
            complete = False
            yield Row(NAME, part.name, "; ".join(faults), LIMIT, False)
    if complete:
        yield Row(NAME, f"{len(drawn)} parts", f"{told} lengths and labels", LIMIT, True)


def _planned(built: BuiltDesign, part: Part) -> tuple[list[str], int]:
    """Faults of a drawing's plan, and how many lengths and labels it has."""
    assert part.callouts is not None
    plan = scheme(built.features(part.name), part.callouts(part.source(built.design)))
    return list(plan.faults), len(plan.lengths) + len(plan.rounds)
