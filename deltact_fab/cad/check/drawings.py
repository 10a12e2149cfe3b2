"""Each drawing says every dimension of its part, and none twice; from the numbers alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from functools import partial
from typing import Any

from ..drafting.coverage import Coverage, coverage
from ..part import Part
from .built import BuiltDesign
from .row import Row

NAME = "drawings"
LIMIT = "each dimension once"


def rows(built: BuiltDesign) -> Iterator[Row]:
    """A row for each drawing with a fault, or one for all of them."""
    drawn = [part for part in built.parts if part.callouts is not None]
    found = {
        part.name: Coverage(**built.result(f"{NAME}: {part.name}", partial(_of_part, built, part)))
        for part in drawn
    }
    for name, told in found.items():
        if not told.complete:
            kinds = (
                ("not said", told.unsaid), ("twice", told.twice), ("closes a chain", told.chains)
            )  # fmt: skip
            faults = "; ".join(f"{kind}: {', '.join(names)}" for kind, names in kinds if names)
            yield Row(NAME, name, faults, LIMIT, False)
    if all(told.complete for told in found.values()):
        keys = sum(len(told.followed) for told in found.values())
        yield Row(NAME, f"{len(drawn)} parts", f"{keys} keys of the tables followed", LIMIT, True)


def _of_part(built: BuiltDesign, part: Part) -> dict[str, Any]:
    built.source(part)  # an indenter's own numbers, which `coverage` takes from the part
    return asdict(coverage(part, built.design))
