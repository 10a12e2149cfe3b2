"""Each drawing places and sizes every feature of its part's solid, and says nothing twice."""

from __future__ import annotations

from collections.abc import Iterator

from ..drafting.scheme import scheme
from .built import BuiltDesign
from .row import Row

NAME = "drawings"
LIMIT = "each feature placed and sized once"


def rows(built: BuiltDesign) -> Iterator[Row]:
    """A row for each drawing with a fault, or one for all of them."""
    drawn = [part for part in built.parts if part.callouts is not None]
    told, complete = 0, True
    for part in drawn:
        assert part.callouts is not None
        said = part.callouts(built.source(part))
        plan = scheme(built.features(part.name), said)
        told += len(plan.lengths) + len(plan.rounds)
        if plan.faults:
            complete = False
            yield Row(NAME, part.name, "; ".join(plan.faults), LIMIT, False)
    if complete:
        yield Row(NAME, f"{len(drawn)} parts", f"{told} lengths and labels", LIMIT, True)
