"""Line pictures by hidden-line removal, lightly tinted: one part, and the sensor taken apart.

Every length on paper is in millimetres. Colours and widths are attributes, not a style sheet, so
that several pictures can stand in one page.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...aliases import Points
from ..assembly import PlacedPart, assemble, bench, lifted
from ..build import build_part
from ..dimensions import Design
from ..kernel import guarded
from ..part import Part
from ..rays import first_hit
from ..registry import of_group
from ..solid_gate import bounding_box
from .balloons import RADIUS_MM, Balloon, arranged
from .hidden_lines import regions
from .page import FONT, LARGE_MM, SMALL_MM, number, path_data, text_width_mm
from .projection import SAME_MM, ProjectedLines, View, project

CORNER = View((1, 1, -0.9), (0, 0, 1))
TIPS_UP = View((1, -1, 0.9), (0, 0, -1))
# The sensor lies on its side: the axis runs across the page, the touched face looks at the reader.
APART = View((-0.62, -0.42, -0.66), (0, 1, 0))
# The same from the back and from the side of the cable.
FROM_BACK = View((-0.62, 0.42, 0.66), (0, 1, 0))

PART_MM = (84.0, 64.0)  # room of a part's picture
APART_MM = 180.0  # width of the exploded view
BENCH_ROOM_MM = (120.0, 110.0)
STEP_ROOM_MM = (120.0, 64.0)  # room of a step's picture, without balloons and legend
STEP_GAP_MM = 7.0  # between what is together and what comes to it
MARGIN_MM = 3.0
CHORD_MM = 0.02
MESH_MM, MESH_RAD = 0.05, 0.2
LINE, THIN, CONTOUR = 0.25, 0.13, 0.5  # widths in mm
STEP_MM = 0.25  # along an axis, between the points that are asked whether they are seen


def part_svg(part: Part, design: Design, solid: Any = None) -> str:
    """One part seen from a corner; an indenter stands on its stem.

    solid: as built from the design; built here when it is not given. Raises what build_part raises.
    """
    if solid is None:
        solid, _ = build_part(part, design)
    view = TIPS_UP if part.indenter is not None else CORNER
    with guarded(part.name):
        lines = project([solid], view.direction, view.up, CHORD_MM)[0]
        body = Body(part, 0, lines, mesh(solid), view)
    low, high = lines.box_mm
    size = high - low
    room = np.array(PART_MM) - 2 * MARGIN_MM
    scale = float(min(room / size))
    paper = _Paper(scale, (low[0], high[1]), MARGIN_MM, MARGIN_MM)
    width, height = (size * scale + 2 * MARGIN_MM).tolist()
    return _document(width, height, part.name, _drawn([body], paper))


def exploded_svg(design: Design, solids: Mapping[str, Any] | None = None) -> str:
    """The sensor taken apart along its axis, with numbers: the paper's where it has one.

    solids: ready solids by part name, for those that need not be built. The axes of the four
    screws are drawn where nothing hides them.
    """
    placed = assemble(design, 1.0, of_group("sensor", design), solids)
    return _numbered("exploded view", placed, APART, APART_MM, math.inf, design)


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
    return _numbered(title, placed, view, *STEP_ROOM_MM)


def scene_svg(title: str, placed: Sequence[PlacedPart]) -> str:
    """Pieces as they are placed, seen from a corner, with balloons and a legend."""
    return _numbered(title, placed, CORNER, *STEP_ROOM_MM)


def bench_svg(design: Design, indenter: Part, solids: Mapping[str, Any] | None = None) -> str:
    """The test bench put together, the tip on the face: what `cad check` holds apart.

    solids: as for exploded_svg.
    """
    return _numbered("test bench", bench(design, indenter, solids), CORNER, *BENCH_ROOM_MM)


def _numbered(
    title: str,
    placed: Sequence[PlacedPart],
    view: View,
    wide_mm: float,
    high_mm: float,
    axes_of: Design | None = None,
) -> str:
    """Pieces of the sensor with balloons and a legend, as large as the room allows.

    axes_of: the design whose screws' axes are drawn too.
    """
    with guarded(title):
        found = project([p.solid for p in placed], view.direction, view.up, CHORD_MM)
        bodies = [
            Body(p.part, p.index, lines, mesh(p.solid), view)
            for p, lines in zip(placed, found, strict=True)
        ]
    # Of the meshes, for a piece may be hidden altogether.
    corners = np.concatenate([view.flat(body.triangles).reshape(-1, 2) for body in bodies])
    low, high = corners.min(axis=0), corners.max(axis=0)
    room = np.array([wide_mm, high_mm]) - 2 * MARGIN_MM
    scale = float(min(room / (high - low)))
    names = {p.part.name for p in placed}
    others = {p.part.name: p.part for p in placed if p.part.group != "sensor"}
    parts = [*of_group("sensor"), *others.values()]
    labels = {n: label for n, label in _labels(parts).items() if n in names}
    pieces = [(b.part, [line * scale for line in b.lines.visible]) for b in bodies]
    balloons = arranged(pieces, view.flat((0, 0, -1)))
    # Everything in the paper's millimetres, y upwards, to see how large the page must be.
    reach = np.concatenate([np.array([low, high]) * scale, *(b.reach for b in balloons)])
    low, high = reach.min(axis=0), reach.max(axis=0)
    paper = _Paper(1.0, (low[0], high[1]), MARGIN_MM, MARGIN_MM)
    model = _Paper(scale, (low[0] / scale, high[1] / scale), MARGIN_MM, MARGIN_MM)
    if axes_of is not None:
        items = _drawn(sorted(bodies, key=lambda b: b.middle_mm), model)
        items.append(_axes(placed, bodies, axes_of, model))
    else:
        shapes = regions([body.triangles for body in bodies], view, scale)
        items = _together(bodies, shapes, model)
    for balloon in balloons:
        items += _balloon(balloon, labels[balloon.part.name], paper)
    width, height = (high - low + 2 * MARGIN_MM).tolist()
    if axes_of is None:
        # A step is small, and names what is seen in it.
        labels = {b.part.name: labels[b.part.name] for b in balloons}
        width = max(width, STEP_ROOM_MM[0])
    pieces_of = {part.name: part.quantity for part in parts}
    legend, legend_mm = _legend(labels, pieces_of, width, height)
    return _document(width, height + legend_mm, title, [*items, *legend])


@dataclass(frozen=True)
class Body:
    """One piece: its lines, and its mesh as corners of triangles (n, 3, 3), outwards."""

    part: Part
    index: int
    lines: ProjectedLines
    triangles: Points
    view: View

    @property
    def middle_mm(self) -> float:
        """z of its middle: taken apart along z, what lies behind in z is behind on paper."""
        z = self.triangles[..., 2]
        return float(z.min() + z.max()) / 2


@dataclass(frozen=True)
class _Paper:
    """From the model's plane to the page: scale, and where the upper left corner goes."""

    scale: float
    corner_mm: tuple[float, float]
    left_mm: float
    top_mm: float

    def of(self, points: Any) -> Points:
        """Points (n, 2) on the page, y downwards."""
        p = np.asarray(points, float)
        x = self.left_mm + (p[..., 0] - self.corner_mm[0]) * self.scale
        y = self.top_mm + (self.corner_mm[1] - p[..., 1]) * self.scale
        return np.stack([x, y], axis=-1)


def mesh(solid: Any) -> Points:
    """Corners of the solid's triangles, (n, 3, 3); of a copy, for a mesh stays with a shape."""
    from cadquery import Solid
    from OCP.BRepBuilderAPI import BRepBuilderAPI_Copy

    copy = Solid(BRepBuilderAPI_Copy(solid.wrapped, True, False).Shape())
    vertices, triangles = copy.tessellate(MESH_MM, MESH_RAD)
    return np.array([v.toTuple() for v in vertices])[np.array(triangles)]


def silhouette(triangles: Points, view: View) -> list[Points]:
    """Loops whose even-odd filling is what the solid covers on paper."""
    import shapely

    flat = view.flat(triangles)
    a, b = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    front = flat[a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] > 1e-9]
    whole = shapely.union_all(shapely.polygons(front), grid_size=SAME_MM)
    # Wide enough that triangles which only touch hang together.
    whole = whole.buffer(2 * SAME_MM, join_style="mitre").simplify(SAME_MM)
    faces = shapely.get_parts(whole)
    return [np.array(r.coords)[:-1] for f in faces for r in (f.exterior, *f.interiors)]


def _tint(part: Part) -> str:
    """The part's colour, light enough that black lines stand out on it."""
    mixed = [1 - (1 - c) * 0.35 * (0.5 + part.colour[3] / 2) for c in part.colour[:3]]
    return "#" + "".join(f"{round(255 * c):02x}" for c in mixed)


def _drawn(bodies: Sequence[Body], paper: _Paper) -> list[str]:
    """The bodies from the farthest to the nearest: contour, tint, lines."""
    items = []
    for body in bodies:
        shape = path_data([paper.of(p) for p in silhouette(body.triangles, body.view)], True)
        items.append(f'<g data-part="{escape(body.part.name)}" data-piece="{body.index}">')
        # Half of the stroke lies outside; the tint covers the other half and the inner borders.
        items.append(
            f'<path d="{shape}" fill="none" stroke="#000" stroke-width="{2 * CONTOUR}" '
            'stroke-linejoin="round"/>'
        )
        items.append(
            f'<path d="{shape}" fill="{_tint(body.part)}" fill-rule="evenodd" stroke="none"/>'
        )
        items += _lines(body, paper)
        items.append("</g>")
    return items


def _together(
    bodies: Sequence[Body], shapes: Sequence[Sequence[Points]], paper: _Paper
) -> list[str]:
    """Bodies of which none is behind another as a whole: what is seen of each, then all lines."""
    paths = [path_data([paper.of(loop) for loop in loops], True) for loops in shapes]
    items = [
        f'<path d="{path}" fill="none" stroke="#000" stroke-width="{2 * CONTOUR}" '
        'stroke-linejoin="round"/>'
        for path in paths
    ]
    for body, path in zip(bodies, paths, strict=True):
        tint = _tint(body.part)
        # As wide as a line, so that no gap shows between two of them.
        items.append(
            f'<path data-part="{escape(body.part.name)}" d="{path}" fill="{tint}" '
            f'fill-rule="evenodd" stroke="{tint}" stroke-width="{LINE}"/>'
        )
    for body in bodies:
        items += _lines(body, paper)
    return items


def _lines(body: Body, paper: _Paper) -> list[str]:
    items = []
    for lines, width in ((body.lines.smooth, THIN), (body.lines.visible, LINE)):
        if lines:
            data = path_data([paper.of(line) for line in lines])
            items.append(
                f'<path d="{data}" fill="none" stroke="#000" stroke-width="{width}" '
                'stroke-linecap="round" stroke-linejoin="round"/>'
            )
    return items


def _labels(parts: Sequence[Part]) -> dict[str, str]:
    """The paper's number of each part, letters for what it does not number."""
    letters = iter("ABCDEFGHIJKLMNOPQRSTUVWXYZ")
    return {p.name: str(p.number) if p.number else next(letters) for p in parts}


def _balloon(balloon: Balloon, label: str, paper: _Paper) -> list[str]:
    (cx, cy), (ax, ay) = paper.of(balloon.centre), paper.of(balloon.anchor)
    away = np.array([ax - cx, ay - cy])
    sx, sy = np.array([cx, cy]) + away / np.hypot(*away) * RADIUS_MM
    name = escape(balloon.part.name)
    return [
        f'<path data-leader="{name}" d="M{number(sx)} {number(sy)}L{number(ax)} {number(ay)}" '
        'fill="none" stroke="#000" stroke-width="0.18"/>',
        f'<circle cx="{number(ax)}" cy="{number(ay)}" r="0.5"/>',
        f'<circle data-balloon="{name}" cx="{number(cx)}" cy="{number(cy)}" '
        f'r="{number(RADIUS_MM)}" fill="#fff" stroke="#000" stroke-width="0.25"/>',
        _text(cx, cy + LARGE_MM * 0.42, label, LARGE_MM * 0.85, "middle"),
    ]


def _text(x: float, y: float, words: str, height_mm: float, anchor: str = "start") -> str:
    return (
        f'<text x="{number(x)}" y="{number(y)}" font-size="{number(height_mm / 0.716)}" '
        f'font-family="{FONT}" text-anchor="{anchor}">{escape(words)}</text>'
    )


def _legend(
    labels: Mapping[str, str], pieces: Mapping[str, int], width: float, top: float
) -> tuple[list[str], float]:
    """Numbers and names in columns below the picture, and the height that they take."""
    entries = sorted(labels.items(), key=lambda e: (not e[1].isdigit(), len(e[1]), e[1]))
    column = max(text_width_mm(name) for name in labels) + 18
    columns = max(1, min(len(entries), int((width - 2 * MARGIN_MM) / column)))
    rows = -(-len(entries) // columns)
    items = []
    for i, (name, label) in enumerate(entries):
        x = MARGIN_MM + (i // rows) * (width - 2 * MARGIN_MM) / columns
        y = top + 2 + (i % rows) * 5.0 + SMALL_MM
        items.append(_text(x + 4, y, label, SMALL_MM, "end"))
        items.append(_text(x + 6, y, f"{name}, {pieces[name]}×" if pieces[name] > 1 else name,
                           SMALL_MM))  # fmt: skip
    return items, rows * 5.0 + 2 + MARGIN_MM


def _axes(
    placed: Sequence[PlacedPart], bodies: Sequence[Body], design: Design, paper: _Paper
) -> str:
    """The screws' axes from their tips to the frame, where nothing stands in front of them."""
    explode = {p.part.name: p.part.explode_mm for p in placed}
    low = design.z_head_mm + design.screw.length_mm + explode["screw"]
    high = design.z_joint_mm + explode["skin-frame"]
    z = np.linspace(low, high, max(2, round(abs(high - low) / STEP_MM)))
    lines = []
    for x, y in design.screw_centres_mm:
        points = np.column_stack([np.full_like(z, x), np.full_like(z, y), z])
        seen = ~hidden(points, bodies)
        ends = np.flatnonzero(np.diff(np.concatenate([[False], seen, [False]]).astype(int)))
        for first, last in ends.reshape(-1, 2):
            if last - first > 1:
                lines.append(paper.of(APART.flat(points[[first, last - 1]])))
    return (
        f'<path data-axes="screws" d="{path_data(lines)}" fill="none" stroke="#000" '
        'stroke-width="0.15" stroke-dasharray="4 0.8 0.6 0.8"/>'
    )


def hidden(points: Points, bodies: Sequence[Body]) -> NDArray[np.bool_]:
    """Whether a triangle lies between each point (n, 3) and the viewer."""
    towards = np.broadcast_to(APART.axes[2], points.shape)
    corners = np.concatenate([body.triangles for body in bodies])
    return np.isfinite(first_hit(points, towards, corners, 1e-3)[0])


def _document(width: float, height: float, title: str, items: Sequence[str]) -> str:
    return "\n".join([
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{number(width)}mm" '
        f'height="{number(height)}mm" viewBox="0 0 {number(width)} {number(height)}">',
        f"<title>{escape(title)}</title>",
        *items,
        "</svg>",
    ]) + "\n"  # fmt: skip
