"""Line pictures by hidden-line removal, lightly tinted: one part, the sensor taken apart, a step.

Every length on paper is in millimetres.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...aliases import Points
from ..assembly import PlacedPart, assemble, bench, lifted
from ..build import build_part
from ..dimensions import Design
from ..kernel import guarded
from ..part import Part
from ..registry import of_group
from ..solid_gate import bounding_box
from .balloons import RADIUS_MM, arranged
from .hidden_lines import regions
from .page import BLACK, LARGE_MM, SMALL_MM, DrawingPage, text_width_mm
from .projection import View, project

CORNER = View((1, 1, -0.9), (0, 0, 1))
TIPS_UP = View((1, -1, 0.9), (0, 0, -1))
# The sensor lies on its side: the axis runs across the page, the touched face looks at the reader.
APART = View((-0.62, -0.42, -0.66), (0, 1, 0))
# The same from the back and from the side of the cable.
FROM_BACK = View((-0.62, 0.42, 0.66), (0, 1, 0))

PART_MM = (84.0, 64.0)  # room of a part's picture
APART_MM = (180.0, math.inf)
BENCH_MM = (120.0, 110.0)
STEP_MM = (120.0, 64.0)  # room of a step's picture, without balloons and legend
STEP_GAP_MM = 7.0  # between what is together and what comes to it
MARGIN_MM = 3.0
ROW_MM = 5.0  # of the legend
CHORD_MM = 0.02
MESH_MM, MESH_RAD = 0.05, 0.2


def part_svg(part: Part, design: Design, solid: Any = None) -> str:
    """One part seen from a corner; an indenter stands on its stem.

    solid: as built from the design; built here when it is not given. Raises what build_part raises.
    """
    if solid is None:
        solid, _ = build_part(part, design)
    view = TIPS_UP if part.indenter is not None else CORNER
    placed = PlacedPart(part, 0, solid, (0.0, 0.0, 0.0))
    return _picture(part.name, [placed], view, PART_MM, numbered=False)


def exploded_svg(design: Design, solids: Mapping[str, Any] | None = None) -> str:
    """The sensor taken apart along its axis, with numbers: the paper's where it has one.

    solids: ready solids by part name, for those that need not be built.
    """
    placed = assemble(design, 1.0, of_group("sensor", design), solids)
    return _picture("exploded view", placed, APART, APART_MM)


def step_svg(
    title: str,
    design: Design,
    layers: Sequence[Sequence[str]],
    solids: Mapping[str, Any] | None = None,
    view: View = APART,
) -> str:
    """One step of the assembly: what is together already, and what comes to it, taken apart.

    layers: names of parts of the sensor, from the face backwards; those of one layer are in their
    places to one another. solids: as for exploded_svg.
    """
    parts = {part.name: part for part in of_group("sensor", design)}
    placed: list[PlacedPart] = []
    top_mm = -math.inf
    there = [[name for name in names if name in parts] for names in layers]
    for names in reversed([names for names in there if names]):
        layer = assemble(design, 0.0, [parts[name] for name in names], solids)
        boxes = [bounding_box(piece.solid) for piece in layer]
        shift = (0.0, 0.0, max(0.0, top_mm + STEP_GAP_MM - min(box[0][2] for box in boxes)))
        placed += [lifted(piece, shift) for piece in layer]
        top_mm = max(box[1][2] for box in boxes) + shift[2]
    order = list(parts)
    placed.sort(key=lambda piece: order.index(piece.part.name))
    return _picture(title, placed, view, STEP_MM)


def scene_svg(title: str, placed: Sequence[PlacedPart]) -> str:
    """Pieces as they are placed, seen from a corner, with balloons and a legend."""
    return _picture(title, placed, CORNER, STEP_MM)


def bench_svg(design: Design, indenter: Part, solids: Mapping[str, Any] | None = None) -> str:
    """The test bench put together, the tip on the face: what `cad check` holds apart.

    solids: as for exploded_svg.
    """
    return _picture("test bench", bench(design, indenter, solids), CORNER, BENCH_MM)


def _picture(
    title: str,
    placed: Sequence[PlacedPart],
    view: View,
    room_mm: tuple[float, float],
    numbered: bool = True,
) -> str:
    """Pieces as large as the room allows, with balloons and a legend of what is seen."""
    with guarded(title):
        found = project([p.solid for p in placed], view, CHORD_MM)
        meshes = [mesh(p.solid) for p in placed]
    seen = np.concatenate([line for lines in found for line in lines.visible])
    low, high = seen.min(axis=0), seen.max(axis=0)
    scale = float(min((np.array(room_mm) - 2 * MARGIN_MM) / (high - low)))
    pieces = [
        (p.part, [line * scale for line in lines.visible])
        for p, lines in zip(placed, found, strict=True)
    ]
    balloons = arranged(pieces, view.flat((0, 0, -1))) if numbered else []
    # In the paper's millimetres, y upwards.
    reach = np.concatenate([np.array([low, high]) * scale, *(b.reach for b in balloons)])
    low, high = reach.min(axis=0), reach.max(axis=0)
    width, height = (high - low + 2 * MARGIN_MM).tolist()
    page = DrawingPage((max(width, numbered * STEP_MM[0]), height), title)

    def paper(points: Points, scale: float = 1.0) -> Points:
        """On the page, y downwards."""
        return MARGIN_MM + (points * scale - (low[0], high[1])) * (1, -1)

    shapes = [[paper(loop, scale) for loop in loops] for loops in regions(meshes, view, scale)]
    for loops in shapes:
        page.path(loops, "contour", closed=True)
    for p, loops in zip(placed, shapes, strict=True):
        page.group = f"piece {p.part.name}"
        page.path(loops, "filled", closed=True, fill=_tint(p.part))
    for p, lines in zip(placed, found, strict=True):
        page.group = f"lines {p.part.name}"
        page.path([paper(line, scale) for line in lines.smooth], "smooth")
        page.path([paper(line, scale) for line in lines.visible], "picture")
    labels = _labels(placed)
    for balloon in balloons:
        page.group = f"balloon {balloon.part.name}"
        _draw_balloon(page, paper(balloon.centre), paper(balloon.anchor), labels[balloon.part.name])
    page.group = "legend"
    if balloons:
        _draw_legend(page, [(labels[b.part.name], b.part) for b in balloons])
    return page.svg()


def mesh(solid: Any) -> Points:
    """Corners of the solid's triangles, (n, 3, 3); of a copy, for a mesh stays with a shape."""
    from cadquery import Solid
    from OCP.BRepBuilderAPI import BRepBuilderAPI_Copy

    copy = Solid(BRepBuilderAPI_Copy(solid.wrapped, True, False).Shape())
    vertices, triangles = copy.tessellate(MESH_MM, MESH_RAD)
    return np.array([v.toTuple() for v in vertices])[np.array(triangles)]


def _tint(part: Part) -> str:
    """The part's colour, light enough that black lines stand out on it."""
    mixed = [1 - (1 - c) * 0.35 * (0.5 + part.colour[3] / 2) for c in part.colour[:3]]
    return "#" + "".join(f"{round(255 * c):02x}" for c in mixed)


def _labels(placed: Sequence[PlacedPart]) -> dict[str, str]:
    """The paper's number of each part, letters for what it does not number."""
    letters = iter("ABCDEFGHIJKLMNOPQRSTUVWXYZ")
    others = [p.part for p in placed if p.part.group != "sensor"]
    parts = {part.name: part for part in [*of_group("sensor"), *others]}
    return {name: str(p.number) if p.number else next(letters) for name, p in parts.items()}


def _draw_balloon(page: DrawingPage, centre: Points, anchor: Points, label: str) -> None:
    away = anchor - centre
    rim = centre + away / np.hypot(*away) * RADIUS_MM
    page.path([np.stack([rim, anchor])], "thin")
    page.circle((anchor[0], anchor[1]), 0.5, "filled", BLACK)
    page.circle((centre[0], centre[1]), RADIUS_MM, "picture", "#ffffff")
    page.text((centre[0], centre[1] + LARGE_MM * 0.42), label, LARGE_MM * 0.85, "middle")


def _draw_legend(page: DrawingPage, seen: Sequence[tuple[str, Part]]) -> None:
    """Numbers and names in columns below the picture, for which the page becomes longer."""
    entries = sorted(seen, key=lambda e: (not e[0].isdigit(), len(e[0]), e[0]))
    width, top = page.size_mm[0] - 2 * MARGIN_MM, page.size_mm[1] + 2
    column = max(text_width_mm(part.name) for _, part in entries) + 18
    columns = max(1, min(len(entries), int(width / column)))
    rows = -(-len(entries) // columns)
    for i, (label, part) in enumerate(entries):
        x = MARGIN_MM + (i // rows) * width / columns
        y = top + (i % rows) * ROW_MM + SMALL_MM
        pieces = f", {part.quantity}×" if part.quantity > 1 else ""
        page.text((x + 4, y), label, SMALL_MM, "end")
        page.text((x + 6, y), part.name + pieces)
    page.size_mm = (page.size_mm[0], top + rows * ROW_MM + MARGIN_MM)
