"""Tinted line pictures by hidden-line removal: parts, exploded sensor, steps; paper mm."""

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
from .page import LINE_BLACK, TEXT_MM, TITLE_MM, DrawingPage, text_width_mm
from .projection import View, project

CORNER_VIEW = View((1, 1, -0.9), (0, 0, 1))
TIPS_UP = View((1, -1, 0.9), (0, 0, -1))
# The sensor on its side: axis across the page, touched face towards the reader.
EXPLODED_VIEW = View((-0.62, -0.42, -0.66), (0, 1, 0))
# The same from the back, cable side.
FROM_BACK = View((-0.62, 0.42, 0.66), (0, 1, 0))

# Largest picture without balloons and legend, by hand: fits the guide's page.
PART_ROOM_MM, BENCH_ROOM_MM = (84.0, 64.0), (120.0, 110.0)
EXPLODED_MM, STEP_ROOM_MM = (180.0, math.inf), (120.0, 64.0)
STEP_GAP_MM = 7.0  # between joined parts and the next one, by hand: clearly apart
PICTURE_MARGIN_MM, LEGEND_ROW_MM = 3.0, 5.0  # by hand: twice the text height for a row
# By hand: finer costs time and bytes; a line is 0.25 mm wide.
PICTURE_CHORD_MM, TINT_MESH_MM, TINT_MESH_RAD = 0.02, 0.05, 0.2
TINT_SAMPLE_MM, TINT_SPARE_PX = 0.1, 2
# Balloons, by hand: radius, pitch, rows' distance from the picture; more makes a larger page.
BALLOON_RADIUS_MM, BALLOON_PITCH_MM, ROWS_MM = 3.2, 9.0, 11.0
LEADER_CLEAR_MM = 1.0  # least distance of a leader's end from another part's lines
LEADER_START_MM = 0.2  # a leader may touch the line it starts on


def stack_layers(
    design: Design, layers: Sequence[Sequence[str]], solids: Mapping[str, Any]
) -> list[PlacedPart]:
    """Place the layers of one assembly step apart along the axis.

    layers: part names of each layer, from the face backwards; a layer's parts stay assembled.
    solids: by part name.
    """
    parts = {part.name: part for part in parts_of_group("sensor", design)}
    pieces: list[PlacedPart] = []
    top_mm = -math.inf
    present = [[name for name in names if name in parts] for names in layers]
    for names in reversed([names for names in present if names]):
        layer = assemble_sensor(design, 0.0, [parts[name] for name in names], solids)
        boxes = [bounding_box(piece.solid) for piece in layer]
        shift = (0.0, 0.0, max(0.0, top_mm + STEP_GAP_MM - min(box[0][2] for box in boxes)))
        pieces += [shift_piece(piece, shift) for piece in layer]
        top_mm = max(box[1][2] for box in boxes) + shift[2]
    order = list(parts)
    return sorted(pieces, key=lambda piece: order.index(piece.part.name))


def picture_svg(
    title: str,
    parts: Sequence[PlacedPart],
    view: View = CORNER_VIEW,
    room_mm: tuple[float, float] = STEP_ROOM_MM,
    numbered: bool = True,
) -> str:
    """Draw parts as large as room_mm allows, with balloons and a legend of the visible ones."""
    with guarded(title):
        projections = project([p.solid for p in parts], view, PICTURE_CHORD_MM)
        meshes = [mesh(p.solid) for p in parts]
    visible = np.concatenate([line for lines in projections for line in lines.visible])
    low, high = visible.min(axis=0), visible.max(axis=0)
    scale = float(min((np.array(room_mm) - 2 * PICTURE_MARGIN_MM) / (high - low)))
    pieces = [
        (p.part, [line * scale for line in lines.visible])
        for p, lines in zip(parts, projections, strict=True)
    ]
    balloons = arrange_balloons(pieces, view.flat((0, 0, -1))) if numbered else []
    # Paper mm, y up.
    rings = [b.centre + side * (BALLOON_RADIUS_MM + 0.3) for b in balloons for side in (-1, 1)]
    reach = np.array([low * scale, high * scale, *rings])
    low, high = reach.min(axis=0), reach.max(axis=0)
    width, height = (high - low + 2 * PICTURE_MARGIN_MM).tolist()
    page = DrawingPage((max(width, numbered * STEP_ROOM_MM[0]), height), title)

    def paper(points: Field, scale: float = 1.0) -> Field:
        """Map to the page, y down."""
        return PICTURE_MARGIN_MM + (points * scale - (low[0], high[1])) * (1, -1)

    # Under the parts: an axis shows where they are apart.
    page.path([paper(view.flat(axis), scale) for axis in _screw_axes(parts)], "centre")
    shapes = [[paper(loop, scale) for loop in loops] for loops in regions(meshes, view, scale)]
    for loops in shapes:
        page.path(loops, "contour", closed=True)
    for p, loops in zip(parts, shapes, strict=True):
        page.group = f"piece {p.part.name}"
        page.path(loops, "filled", closed=True, fill=_tint(p.part))
    for p, lines in zip(parts, projections, strict=True):
        page.group = f"lines {p.part.name}"
        page.path([paper(line, scale) for line in lines.smooth], "smooth")
        page.path([paper(line, scale) for line in lines.visible], "picture")
    labels = _labels(parts)
    for balloon in balloons:
        page.group = f"balloon {balloon.part.name}"
        _draw_balloon(page, paper(balloon.centre), paper(balloon.anchor), labels[balloon.part.name])
    page.group = "legend"
    if balloons:
        _draw_legend(page, [(labels[b.part.name], b.part) for b in balloons])
    return page.svg()


def _screw_axes(parts: Sequence[PlacedPart]) -> list[Field]:
    """Axes (2, 3) of the screws, each to the far side of the frame that it goes into."""
    pieces = {name: [p for p in parts if p.part.name == name] for name in ("screw", "skin-frame")}
    ends = [bounding_box(frame.solid)[1][2] for frame in pieces["skin-frame"]]
    starts = [(*p.shift_mm[:2], bounding_box(p.solid)[1][2]) for p in pieces["screw"]]
    return [np.array([(x, y, z), (x, y, end)]) for x, y, z in starts for end in ends]


def mesh(solid: Any) -> Field:
    """Triangles of the solid, (n, 3, 3); of a copy, because OCCT keeps a mesh in its shape."""
    vertices, triangles = solid.copy().tessellate(TINT_MESH_MM, TINT_MESH_RAD)
    return np.array([v.toTuple() for v in vertices])[np.array(triangles)]


def _tint(part: Part) -> str:
    """Lighten the part's colour so that black lines stand out."""
    mixed = [1 - (1 - c) * 0.35 * (0.5 + part.colour[3] / 2) for c in part.colour[:3]]
    return "#" + "".join(f"{round(255 * c):02x}" for c in mixed)


def _labels(pieces: Sequence[PlacedPart]) -> dict[str, str]:
    """Balloon text of each part: the paper's number, else a letter."""
    letters = iter("ABCDEFGHIJKLMNOPQRSTUVWXYZ")
    unnumbered = [p.part for p in pieces if p.part.group != "sensor"]
    parts = {part.name: part for part in [*parts_of_group("sensor"), *unnumbered]}
    return {name: str(p.number) if p.number else next(letters) for name, p in parts.items()}


def _draw_balloon(page: DrawingPage, centre: Field, anchor: Field, label: str) -> None:
    to_anchor = anchor - centre
    rim = centre + to_anchor / np.hypot(*to_anchor) * BALLOON_RADIUS_MM
    page.path([np.stack([rim, anchor])], "thin")
    page.circle((anchor[0], anchor[1]), 0.5, "filled", LINE_BLACK)
    page.circle((centre[0], centre[1]), BALLOON_RADIUS_MM, "picture", "#ffffff")
    page.text((centre[0], centre[1] + TITLE_MM * 0.42), label, TITLE_MM * 0.85, "middle")


def _draw_legend(page: DrawingPage, labelled: Sequence[tuple[str, Part]]) -> None:
    """Add numbers and names in columns below the picture; the page grows."""
    entries = sorted(labelled, key=lambda e: (not e[0].isdigit(), len(e[0]), e[0]))
    width, top = page.size_mm[0] - 2 * PICTURE_MARGIN_MM, page.size_mm[1] + 2
    column = max(text_width_mm(part.name) for _, part in entries) + 18
    columns = max(1, min(len(entries), int(width / column)))
    rows = -(-len(entries) // columns)
    for i, (label, part) in enumerate(entries):
        x = PICTURE_MARGIN_MM + (i // rows) * width / columns
        y = top + (i % rows) * LEGEND_ROW_MM + TEXT_MM
        pieces = f", {part.quantity}×" if part.quantity > 1 else ""
        page.text((x + 4, y), label, TEXT_MM, "end")
        page.text((x + 6, y), part.name + pieces)
    page.size_mm = (page.size_mm[0], top + rows * LEGEND_ROW_MM + PICTURE_MARGIN_MM)


@dataclass(frozen=True)
class Balloon:
    """Balloon centre and the end of its leader on the part, paper mm, y up."""

    part: Part
    centre: Field
    anchor: Field


def arrange_balloons(pieces: Sequence[tuple[Part, Sequence[Field]]], axis: Field) -> list[Balloon]:
    """Arrange balloons in two rows beside the axis; leaders cross no other part if possible.

    A leader starts at the visible point of its part with the fewest crossings, then the shortest
    way to a row; a fully hidden part has no balloon.
    pieces: visible lines of each piece, (n, 2), paper mm, y up. axis: direction of the rows.
    """
    import shapely

    axis = axis / np.hypot(*axis)
    frame = np.stack([axis, [-axis[1], axis[0]]])  # along the axis, across it
    lines = [(part.name, shapely.LineString(p @ frame.T)) for part, paths in pieces for p in paths]
    tree = shapely.STRtree([line for _, line in lines])
    _, low, _, high = shapely.total_bounds(tree.geometries)
    rows: dict[float, list[tuple[float, Field, Part]]] = {high + ROWS_MM: [], low - ROWS_MM: []}
    for part in {part.name: part for part, _ in pieces}.values():
        part_lines = [line for name, line in lines if name == part.name]
        if not part_lines:
            continue
        other_lines = shapely.union_all([line for name, line in lines if name != part.name])
        points = np.tile(shapely.get_coordinates(part_lines), (2, 1))
        row = np.repeat(list(rows), len(points) // 2)
        to_row = row - points[:, 1]
        ends = np.repeat(points[:, None], 2, axis=1)
        ends[:, 0, 1] += LEADER_START_MM * np.sign(to_row)
        ends[:, 1, 1] = row
        # A leader ending where two parts seem to touch is ambiguous.
        crossed = 1 * shapely.dwithin(shapely.points(points), other_lines, LEADER_CLEAR_MM)
        hits, _ = tree.query(shapely.linestrings(ends), predicate="intersects")
        crossed += np.bincount(hits, minlength=len(points))
        k = np.lexsort((np.abs(to_row).round(3), crossed))[0]
        rows[row[k]].append((float(points[k, 0]), points[k], part))
    balloons = []
    for across, entries in rows.items():
        entries.sort(key=lambda entry: entry[0])
        positions = spread([entry[0] for entry in entries], BALLOON_PITCH_MM)
        for t, (_, anchor, part) in zip(positions, entries, strict=True):
            balloons.append(Balloon(part, np.array([t, across]) @ frame, anchor @ frame))
    return balloons


def spread(targets: Sequence[float], gap: float) -> list[float]:
    """Return ordered positions at least `gap` apart, closest to the targets (least squares)."""
    from scipy.optimize import isotonic_regression

    offsets = gap * np.arange(len(targets))
    places: list[float] = (isotonic_regression(np.array(targets) - offsets).x + offsets).tolist()
    return places


def regions(triangles: Sequence[Field], view: View, scale: float) -> list[list[Field]]:
    """Return the outlines of each body's visible region, the bodies hiding one another.

    Loops (n, 2), mm in the model's plane, for the even-odd rule; they match hidden-line removal
    to one sample and are covered by its lines.
    triangles: (n, 3, 3) of each body's mesh, outwards. scale: paper over model.
    """
    import cv2

    step_mm = TINT_SAMPLE_MM / scale
    points = np.concatenate([view.flat(t).reshape(-1, 2) for t in triangles])
    low = points.min(axis=0) - TINT_SPARE_PX * step_mm
    columns, rows = np.ceil((points.max(axis=0) - low) / step_mm).astype(int) + TINT_SPARE_PX
    near = np.full((rows, columns), -np.inf)
    owner = np.full((rows, columns), -1)
    for body, corners in enumerate(triangles):
        _draw_body(body, (view.flat(corners) - low) / step_mm, view.depth(corners), near, owner)
    body_loops = []
    for body in range(len(triangles)):
        mask = (owner == body).astype(np.uint8)
        outlines, _ = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
        loops = [cv2.approxPolyDP(outline, 0.7, True)[:, 0] for outline in outlines]
        body_loops.append([loop * step_mm + low for loop in loops if len(loop) > 2])
    return body_loops


def _draw_body(
    body: int, flat: Field, depth: Field, near: NDArray[np.float64], owner: NDArray[np.int64]
) -> None:
    """Rasterise a body's front-facing triangles with a depth test; units of samples."""
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
        z = depth[k, 0] + s * (depth[k, 1] - depth[k, 0]) + t * (depth[k, 2] - depth[k, 0])
        window = np.s_[y0 : y1 + 1, x0 : x1 + 1]
        over = (s >= 0) & (t >= 0) & (s + t <= 1) & (z > near[window])
        near[window][over] = z[over]
        owner[window][over] = body
