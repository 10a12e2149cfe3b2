"""Line pictures by hidden-line removal, lightly tinted: a part, the sensor taken apart, a step.

Every length on paper is in millimetres.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Field

from ..assembly import PlacedPart, assemble_sensor, shift_piece
from ..dimensions import Design
from ..kernel import bounding_box, guarded
from ..part import Part
from ..registry import parts_of_group
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
LEGEND_MM = 5.0  # a row of the legend
CHORD_MM = 0.02
MESH_MM, MESH_RAD = 0.05, 0.2
# Balloons: radius, from one to the next, from the picture to their row.
RADIUS_MM, BETWEEN_MM, ROW_MM = 3.2, 9.0, 11.0
CLEAR_MM = 1.0  # from a leader's end to the lines of another part
START_MM = 0.2  # a leader does not cross the line on which it starts
SAMPLE_MM = 0.1  # of what hides what, on paper; a line is 0.25 wide
SPARE_PX = 2


def stacked(
    design: Design, layers: Sequence[Sequence[str]], solids: Mapping[str, Any]
) -> list[PlacedPart]:
    """One step of the assembly: what is together already, and what comes to it, taken apart.

    layers: names of parts of the sensor, from the face backwards; those of one layer are in their
    places to one another. solids: by part name.
    """
    parts = {part.name: part for part in parts_of_group("sensor", design)}
    placed: list[PlacedPart] = []
    top_mm = -math.inf
    there = [[name for name in names if name in parts] for names in layers]
    for names in reversed([names for names in there if names]):
        layer = assemble_sensor(design, 0.0, [parts[name] for name in names], solids)
        boxes = [bounding_box(piece.solid) for piece in layer]
        shift = (0.0, 0.0, max(0.0, top_mm + STEP_GAP_MM - min(box[0][2] for box in boxes)))
        placed += [shift_piece(piece, shift) for piece in layer]
        top_mm = max(box[1][2] for box in boxes) + shift[2]
    order = list(parts)
    return sorted(placed, key=lambda piece: order.index(piece.part.name))


def picture_svg(
    title: str,
    placed: Sequence[PlacedPart],
    view: View = CORNER,
    room_mm: tuple[float, float] = STEP_MM,
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
    rings = [b.centre + side * (RADIUS_MM + 0.3) for b in balloons for side in (-1, 1)]
    reach = np.array([low * scale, high * scale, *rings])
    low, high = reach.min(axis=0), reach.max(axis=0)
    width, height = (high - low + 2 * MARGIN_MM).tolist()
    page = DrawingPage((max(width, numbered * STEP_MM[0]), height), title)

    def paper(points: Field, scale: float = 1.0) -> Field:
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


def mesh(solid: Any) -> Field:
    """Corners of the solid's triangles, (n, 3, 3); of a copy, for a mesh stays with a shape."""
    vertices, triangles = solid.copy().tessellate(MESH_MM, MESH_RAD)
    return np.array([v.toTuple() for v in vertices])[np.array(triangles)]


def _tint(part: Part) -> str:
    """The part's colour, light enough that black lines stand out on it."""
    mixed = [1 - (1 - c) * 0.35 * (0.5 + part.colour[3] / 2) for c in part.colour[:3]]
    return "#" + "".join(f"{round(255 * c):02x}" for c in mixed)


def _labels(placed: Sequence[PlacedPart]) -> dict[str, str]:
    """The paper's number of each part, letters for what it does not number."""
    letters = iter("ABCDEFGHIJKLMNOPQRSTUVWXYZ")
    others = [p.part for p in placed if p.part.group != "sensor"]
    parts = {part.name: part for part in [*parts_of_group("sensor"), *others]}
    return {name: str(p.number) if p.number else next(letters) for name, p in parts.items()}


def _draw_balloon(page: DrawingPage, centre: Field, anchor: Field, label: str) -> None:
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
        y = top + (i % rows) * LEGEND_MM + SMALL_MM
        pieces = f", {part.quantity}×" if part.quantity > 1 else ""
        page.text((x + 4, y), label, SMALL_MM, "end")
        page.text((x + 6, y), part.name + pieces)
    page.size_mm = (page.size_mm[0], top + rows * LEGEND_MM + MARGIN_MM)


@dataclass(frozen=True)
class Balloon:
    """A numbered circle and its leader's end on the part; paper mm, y upwards."""

    part: Part
    centre: Field
    anchor: Field


def arranged(pieces: Sequence[tuple[Part, Sequence[Field]]], axis: Field) -> list[Balloon]:
    """Two rows of balloons beside the axis; each leader ends on its part and crosses no other.

    pieces: the visible lines of every piece, (n, 2) each in paper mm, y upwards. axis: direction
    of the rows. Of a part's visible points the one is taken from which the way to a row is free
    and shortest; a part that is hidden altogether has no balloon.
    """
    import shapely

    axis = axis / np.hypot(*axis)
    frame = np.stack([axis, [-axis[1], axis[0]]])  # along the axis, across it
    lines = [(part.name, shapely.LineString(p @ frame.T)) for part, own in pieces for p in own]
    drawn = shapely.STRtree([line for _, line in lines])
    _, low, _, high = shapely.total_bounds(drawn.geometries)
    rows: dict[float, list[tuple[float, Field, Part]]] = {high + ROW_MM: [], low - ROW_MM: []}
    for part in {part.name: part for part, _ in pieces}.values():
        own = [line for name, line in lines if name == part.name]
        if not own:
            continue
        others = shapely.union_all([line for name, line in lines if name != part.name])
        points = np.tile(shapely.get_coordinates(own), (2, 1))
        row = np.repeat(list(rows), len(points) // 2)
        away = row - points[:, 1]
        ends = np.repeat(points[:, None], 2, axis=1)
        ends[:, 0, 1] += START_MM * np.sign(away)
        ends[:, 1, 1] = row
        # A leader that ends where two parts seem to touch does not say which is meant.
        crossed = 1 * shapely.dwithin(shapely.points(points), others, CLEAR_MM)
        met, _ = drawn.query(shapely.linestrings(ends), predicate="intersects")
        crossed += np.bincount(met, minlength=len(points))
        k = np.lexsort((np.abs(away).round(3), crossed))[0]
        rows[row[k]].append((float(points[k, 0]), points[k], part))
    balloons = []
    for across, entries in rows.items():
        entries.sort(key=lambda entry: entry[0])
        at = spread([entry[0] for entry in entries], BETWEEN_MM)
        for t, (_, anchor, part) in zip(at, entries, strict=True):
            balloons.append(Balloon(part, np.array([t, across]) @ frame, anchor @ frame))
    return balloons


def spread(wanted: Sequence[float], apart: float) -> list[float]:
    """Places in the order given, `apart` from one another, as near as may be to those wanted."""
    from scipy.optimize import isotonic_regression

    least = apart * np.arange(len(wanted))
    places: list[float] = (isotonic_regression(np.array(wanted) - least).x + least).tolist()
    return places


def regions(triangles: Sequence[Field], view: View, scale: float) -> list[list[Field]]:
    """What is seen of each of several bodies that sit inside one another, as outlines.

    Loops (n, 2) of each body in mm of the model's plane, to be filled by the even-odd rule. Their
    borders are the lines of hidden-line removal to within a step, and lie under those lines.
    triangles: corners (n, 3, 3) of each body's mesh, outwards. scale: paper over model.
    """
    import cv2

    step_mm = SAMPLE_MM / scale
    every = np.concatenate([view.flat(t).reshape(-1, 2) for t in triangles])
    low = every.min(axis=0) - SPARE_PX * step_mm
    columns, rows = np.ceil((every.max(axis=0) - low) / step_mm).astype(int) + SPARE_PX
    near = np.full((rows, columns), -np.inf)
    seen = np.full((rows, columns), -1)
    for body, corners in enumerate(triangles):
        _draw_body(body, (view.flat(corners) - low) / step_mm, view.depth(corners), near, seen)
    found = []
    for body in range(len(triangles)):
        mask = (seen == body).astype(np.uint8)
        outlines, _ = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
        loops = [cv2.approxPolyDP(outline, 0.7, True)[:, 0] for outline in outlines]
        found.append([loop * step_mm + low for loop in loops if len(loop) > 2])
    return found


def _draw_body(
    body: int, flat: Field, depth: Field, near: NDArray[np.float64], seen: NDArray[np.int64]
) -> None:
    """The triangles of one body that face the viewer, where nothing lies nearer; units of steps."""
    u, v = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    first = np.ceil(flat.min(axis=1)).astype(int)
    last = np.floor(flat.max(axis=1)).astype(int)
    for k in np.flatnonzero((area > 1e-9) & (first <= last).all(axis=1)):
        (x0, y0), (x1, y1) = first[k], last[k]
        dx = np.arange(x0, x1 + 1) - flat[k, 0, 0]
        dy = (np.arange(y0, y1 + 1) - flat[k, 0, 1])[:, None]
        s = (dx * v[k, 1] - dy * v[k, 0]) / area[k]
        t = (dy * u[k, 0] - dx * u[k, 1]) / area[k]
        at = depth[k, 0] + s * (depth[k, 1] - depth[k, 0]) + t * (depth[k, 2] - depth[k, 0])
        window = np.s_[y0 : y1 + 1, x0 : x1 + 1]
        over = (s >= 0) & (t >= 0) & (s + t <= 1) & (at > near[window])
        near[window][over] = at[over]
        seen[window][over] = body
