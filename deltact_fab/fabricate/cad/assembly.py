"""The sensor and the test bench put together: every piece in its place, and what pieces share.

Importing this does not import the CAD kernel.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from deltact_fab.common import RunFailed

from .build import build_part
from .dimensions import Design
from .kernel import VOLUME_TOLERANCE, Extent, guarded
from .part import Part, Shift
from .registry import design_parts, parts_of_group

# By hand: boxes that overlap by less share a face at most, below 0.001 mm3; larger hides clashes.
TOUCH_MM = 1e-6
# The test bench, from the table up; the sensor stands on it by the testing shell.
ON_TABLE = ("stage-plate", "testing-shell")
IN_PLACE_OF = "shell"
ON_STAGE = ("tool-holder", "nano17-adapter", "nano17")


@dataclass(frozen=True)
class PlacedPart:
    """One piece of a part at its position in the assembly.

    index: counts the pieces of the part from 0. solid: a cadquery Solid, already moved; None for a
    position without a solid. shift_mm: translation from the builder's frame, with the exploded
    view's shift.
    """

    part: Part
    index: int
    solid: Any
    shift_mm: Shift

    def moved_up(self, by_mm: float) -> PlacedPart:
        """Return the piece shifted up by by_mm."""
        x, y, z = self.shift_mm
        return replace(self, shift_mm=(x, y, z + by_mm))

    def with_solid(self, solid: Any) -> PlacedPart:
        """Return the piece with its solid (in the builder's frame) moved to its position."""
        from cadquery import Location

        return replace(self, solid=solid.moved(Location(self.shift_mm)))


def places(design: Design, parts: Sequence[Part]) -> list[PlacedPart]:
    """Return the position of every piece of the parts, without solids."""
    return [
        PlacedPart(part, index, None, shift)
        for part in parts
        for index, shift in enumerate(part.places(design))
    ]


def assemble_sensor(
    design: Design,
    explode: float = 0.0,
    parts: Sequence[Part] | None = None,
    solids: Mapping[str, Any] | None = None,
) -> list[PlacedPart]:
    """Return every piece of the parts (default: the sensor's), positioned and in order.

    explode: 0 as assembled, 1 as in the exploded view (times the part's explode_mm along z).
    solids: ready solids by part name, not moved yet, used instead of building; they are not
    gated. Raises what build_part raises for the others.
    """
    chosen = parts_of_group("sensor", design) if parts is None else parts
    pieces = [place.moved_up(explode * place.part.explode_mm) for place in places(design, chosen)]
    return _add_solids(design, pieces, solids)


def _add_solids(
    design: Design, pieces: Sequence[PlacedPart], solids: Mapping[str, Any] | None
) -> list[PlacedPart]:
    ready = dict(solids or {})
    for place in pieces:
        if place.part.name not in ready:
            ready[place.part.name] = build_part(place.part, design)[0]
    return [place.with_solid(ready[place.part.name]) for place in pieces]


def shift_piece(piece: PlacedPart, shift_mm: Shift) -> PlacedPart:
    """Return the piece moved by shift_mm."""
    from cadquery import Location

    x, y, z = (a + b for a, b in zip(piece.shift_mm, shift_mm, strict=True))
    return replace(piece, solid=piece.solid.moved(Location(shift_mm)), shift_mm=(x, y, z))


def bench_places(
    design: Design, indenter: Part, depth_mm: float = 0.0
) -> tuple[list[PlacedPart], list[PlacedPart]]:
    """Return the pieces on the bench's table and those on the stage, the tip depth_mm deep.

    The tool holder's mouth bears on the indenter's back plate, over the middle of the face.
    Raises ValueError if the part is not an indenter.
    """
    if indenter.indenter is None:
        raise ValueError(f"{indenter.name} is not an indenter")
    by_name = {part.name: part for part in design_parts(design)}
    sensor = [part for part in parts_of_group("sensor", design) if part.name != IN_PLACE_OF]
    standing = places(design, [*(by_name[name] for name in ON_TABLE), *sensor])
    mouth_mm = indenter.indenter.indenter.reach_mm + indenter.indenter.body.plate_mm
    tools = places(design, [by_name[name] for name in ON_STAGE])
    over = [place.moved_up(mouth_mm) for place in tools]
    return standing, [place.moved_up(-depth_mm) for place in (*places(design, [indenter]), *over)]


def assemble_bench(
    design: Design, indenter: Part, solids: Mapping[str, Any] | None = None
) -> list[PlacedPart]:
    """Return the test bench: stage plate, sensor and tools over it, the tip on the face.

    solids: as for `assemble_sensor`. Raises what `bench_places` and build_part raise.
    """
    standing, hanging = bench_places(design, indenter)
    return _add_solids(design, [*standing, *hanging], solids)


def boxes_overlap(a: Extent, b: Extent) -> bool:
    """True if two boxes share more than a face."""
    return all(
        max(a[0][axis], b[0][axis]) + TOUCH_MM < min(a[1][axis], b[1][axis]) for axis in range(3)
    )


def common_mm3(a: PlacedPart, b: PlacedPart) -> float:
    """Return the volume common to a and b, verified by the rest of a outside b."""
    from cadquery import Shape
    from OCP.BOPAlgo import BOPAlgo_PaveFiller
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Common, BRepAlgoAPI_Cut
    from OCP.TopTools import TopTools_ListOfShape

    pair = f"{a.part.name} {a.index + 1} and {b.part.name} {b.index + 1}"
    # A boolean that fails returns an empty shape without an exception: that would read as 0.
    with guarded(pair):
        # Both results from one intersection, which takes most of the time.
        pieces, crossing = TopTools_ListOfShape(), BOPAlgo_PaveFiller()
        for shape in (a.solid.wrapped, b.solid.wrapped):
            pieces.Append(shape)
        crossing.SetArguments(pieces)
        crossing.Perform()
        common, rest = (
            float(Shape.cast(boolean(*pieces, crossing).Shape()).Volume())
            for boolean in (BRepAlgoAPI_Common, BRepAlgoAPI_Cut)
        )
        total = float(a.solid.Volume())
    if not abs(common + rest - total) <= VOLUME_TOLERANCE * total:
        raise RunFailed(
            f"{pair}: the CAD kernel cannot compute the common volume: "
            f"{common:.6f} of {total:.6f} mm3 in common, {rest:.6f} left"
        )
    return common
