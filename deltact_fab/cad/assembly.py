"""The sensor and the test bench put together: every piece in its place, and what pieces share.

Importing this does not import the CAD kernel.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..errors import RunFailed
from .build import build_part
from .dimensions import Design
from .kernel import guarded, require
from .part import Part, Shift
from .registry import of_design, of_group
from .solid_gate import VOLUME_TOLERANCE, Box

# Boxes that meet by less share a face at most; what they could share stays below 0.001 mm3.
TOUCH_MM = 1e-6
# The test bench, from the table up; the sensor stands on it by the testing shell.
ON_TABLE = ("stage-plate", "testing-shell")
IN_PLACE_OF = "shell"
ON_STAGE = ("tool-holder", "nano17-adapter", "nano17")


@dataclass(frozen=True)
class PlacedPart:
    """One piece in its place.

    index: counts the pieces of the part from 0. solid: a cadquery Solid, moved already.
    shift_mm: by how much it was moved from where its builder made it, exploding included.
    """

    part: Part
    index: int
    solid: Any
    shift_mm: Shift


def assemble(
    design: Design,
    explode: float = 0.0,
    parts: Sequence[Part] | None = None,
    solids: Mapping[str, Any] | None = None,
) -> list[PlacedPart]:
    """Every piece of the parts, those of the sensor unless given, in their places and order.

    explode: 0 as assembled, 1 as in the exploded view (times the part's explode_mm along z).
    solids: ready solids by part name, not moved yet, to use instead of building; they are not
    gated. Raises what build_part raises for the others.
    """
    cq = require()
    ready = dict(solids or {})
    placed = []
    for part in of_group("sensor", design) if parts is None else parts:
        if part.name not in ready:
            ready[part.name] = build_part(part, design)[0]
        for index, (x, y, z) in enumerate(part.places(design)):
            shift = (x, y, z + explode * part.explode_mm)
            placed.append(
                PlacedPart(part, index, ready[part.name].moved(cq.Location(shift)), shift)
            )
    return placed


def lifted(piece: PlacedPart, shift_mm: Shift) -> PlacedPart:
    """The piece moved further."""
    from cadquery import Location

    x, y, z = (a + b for a, b in zip(piece.shift_mm, shift_mm, strict=True))
    return replace(piece, solid=piece.solid.moved(Location(shift_mm)), shift_mm=(x, y, z))


def mouth_mm(indenter: Part) -> float:
    """z of the tool holder's mouth above the tip: the back plate bears on it.

    Raises ValueError for what is no indenter.
    """
    if indenter.indenter is None:
        raise ValueError(f"{indenter.name}: no indenter")
    return indenter.indenter.plate_z_mm + indenter.indenter.body.plate_mm


def bench(
    design: Design, indenter: Part, solids: Mapping[str, Any] | None = None
) -> list[PlacedPart]:
    """The test bench: stage plate and sensor, and what hangs over it, its tip on the face.

    indenter: in the tool holder, over the middle of the face. solids: as for `assemble`. Raises
    what build_part raises.
    """
    every = {part.name: part for part in of_design(design)}
    sensor = [part for part in of_group("sensor", design) if part.name != IN_PLACE_OF]
    standing = [*(every[name] for name in ON_TABLE), *sensor, indenter]
    hanging = assemble(design, 0.0, [every[name] for name in ON_STAGE], solids)
    up = (0.0, 0.0, mouth_mm(indenter))
    return [*assemble(design, 0.0, standing, solids), *(lifted(piece, up) for piece in hanging)]


def meet(a: Box, b: Box) -> bool:
    """Whether two boxes share more than a face."""
    return all(
        max(a[0][axis], b[0][axis]) + TOUCH_MM < min(a[1][axis], b[1][axis]) for axis in range(3)
    )


def common_mm3(a: PlacedPart, b: PlacedPart) -> float:
    """The volume of a and b, held against what b leaves of a."""
    from cadquery import Shape
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Common, BRepAlgoAPI_Cut

    pair = f"{a.part.name} {a.index + 1} and {b.part.name} {b.index + 1}"
    # A boolean that fails returns an empty shape without an exception: that would read as 0.
    with guarded(pair):
        both = float(
            Shape.cast(BRepAlgoAPI_Common(a.solid.wrapped, b.solid.wrapped).Shape()).Volume()
        )
        left = float(Shape.cast(BRepAlgoAPI_Cut(a.solid.wrapped, b.solid.wrapped).Shape()).Volume())
        whole = float(a.solid.Volume())
    if not abs(both + left - whole) <= VOLUME_TOLERANCE * whole:
        raise RunFailed(
            f"{pair}: the CAD kernel cannot say what they share: "
            f"{both:.6f} of {whole:.6f} mm3 in common, {left:.6f} left"
        )
    return both
