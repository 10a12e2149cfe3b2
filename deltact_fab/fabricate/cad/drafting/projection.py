"""Exact hidden-line removal by the CAD kernel, sampled to polylines; the four views of a part."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Field, Point, Point2

from ..kernel import require
from .dimensioning import Callouts

TANGENT_RAD = 1e-6  # by hand: above rounding; larger draws a slight edge as smooth
# By hand: finer sampling costs time and bytes. Lines closer than the last are one, below any print.
SHEET_CHORD_MM, SAMPLING_ANGLE_RAD, SAME_LINE_MM = 0.005, 0.15, 1e-4


@dataclass(frozen=True)
class View:
    """A parallel projection; direction: line of sight, up: upwards on the paper."""

    direction: Point
    up: Point

    @cached_property
    def axes(self) -> tuple[Field, Field, Field]:
        """Unit vectors to the right, upwards and towards the viewer."""
        back = -np.array(self.direction, float) / np.linalg.norm(self.direction)
        right = np.cross(np.array(self.up, float), back)
        right /= np.linalg.norm(right)
        return right, np.cross(back, right), back

    def flat(self, points_mm: Any) -> Field:
        """Project points (n, 3) or (3,) to the paper, (n, 2) or (2,), mm."""
        right, up, _ = self.axes
        return np.asarray(points_mm, float) @ np.stack([right, up], axis=1)

    def depth(self, points_mm: Any) -> Field:
        """Return the depth of points (n, 3) towards the viewer, (n,), mm."""
        return np.asarray(np.asarray(points_mm, float) @ self.axes[2])


SHEET_VIEWS = {
    "front": View((0, 1, 0), (0, 0, 1)),
    "top": View((0, 0, -1), (0, 1, 0)),
    "left": View((1, 0, 0), (0, 0, 1)),
    "picture": View((1, 1, -0.8), (0, 0, 1)),
}
# The part turned by 180 degrees about x.
FLIPPED_VIEWS = {
    name: View(*((x, -y, -z) for x, y, z in (view.direction, view.up)))
    for name, view in SHEET_VIEWS.items()
}


@dataclass(frozen=True)
class DrawnView:
    """Lines of one solid in a view, polylines (n, 2), mm, right and up on the paper.

    visible, hidden: sharp edges and outlines. smooth: visible tangent edges. hatched: faces of a
    section, each its loops.
    """

    view: View
    visible: tuple[Field, ...]
    hidden: tuple[Field, ...]
    smooth: tuple[Field, ...]
    hatched: Sequence[Sequence[Field]] = ()

    @cached_property
    def box_mm(self) -> tuple[Point2, Point2]:
        """Lower left and upper right corner of all lines."""
        points = np.concatenate([*self.visible, *self.hidden, *self.smooth])
        (x0, y0), (x1, y1) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
        return (x0, y0), (x1, y1)

    def shows(self, points_mm: Any, near_mm: float) -> NDArray[np.bool_]:
        """Return (n,) True for points (n, 3), mm, that lie on a visible line."""
        import shapely

        points = shapely.points(self.view.flat(points_mm))
        return np.asarray(shapely.distance(self._visible_lines, points) < near_mm)

    @cached_property
    def _visible_lines(self) -> Any:
        import shapely

        return shapely.MultiLineString([*self.visible, *self.smooth])


def project(solids: Sequence[Any], view: View, chord_mm: float = SHEET_CHORD_MM) -> list[DrawnView]:
    """Return each solid's visible and hidden lines, the solids hiding one another.

    chord_mm: largest distance of a polyline from its curve. Hidden lines covered by visible ones
    are dropped.
    """
    from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt
    from OCP.HLRAlgo import HLRAlgo_Projector
    from OCP.HLRBRep import HLRBRep_Algo, HLRBRep_HLRToShape

    right, _, back = view.axes
    # Copies: one solid may stand in two places, and a mesh left by an export changes its box.
    shapes = [_with_smooth_edges(solid) for solid in solids]
    removal = HLRBRep_Algo()
    for shape in shapes:
        removal.Add(shape)
    plane = gp_Ax2(gp_Pnt(0, 0, 0), gp_Dir(*back.tolist()), gp_Dir(*right.tolist()))
    removal.Projector(HLRAlgo_Projector(plane))
    removal.Update()
    removal.Hide()
    extractor = HLRBRep_HLRToShape(removal)
    line_sets = []
    for shape in shapes:
        visible = [*_lines(extractor.VCompound(shape), chord_mm)]
        visible += _lines(extractor.OutLineVCompound(shape), chord_mm)
        hidden = [*_lines(extractor.HCompound(shape), chord_mm)]
        hidden += _lines(extractor.OutLineHCompound(shape), chord_mm)
        smooth = [*_lines(extractor.Rg1LineVCompound(shape), chord_mm)]
        line_sets.append((visible, hidden, smooth))
    covering = _merge_lines(line for visible, _, _ in line_sets for line in visible)
    return [
        DrawnView(view, _clean(visible), _clean(hidden, covering), _clean(smooth, covering))
        for visible, hidden, smooth in line_sets
    ]


def _with_smooth_edges(solid: Any) -> Any:
    """Return a copy whose flush and tangent faces meet in edges marked as smooth."""
    from OCP.BRepLib import BRepLib

    shape = solid.copy().wrapped
    BRepLib.EncodeRegularity_s(shape, TANGENT_RAD)
    return shape


def sample_edge(edge: Any, chord_mm: float = SHEET_CHORD_MM) -> Field:
    """Sample a cadquery Edge to points (n, 3), in its curve's sense."""
    from OCP.BRepAdaptor import BRepAdaptor_Curve
    from OCP.GCPnts import GCPnts_TangentialDeflection

    curve = BRepAdaptor_Curve(edge.wrapped)
    sampler = GCPnts_TangentialDeflection(curve, SAMPLING_ANGLE_RAD, chord_mm)
    points = (sampler.Value(i) for i in range(1, sampler.NbPoints() + 1))
    return np.array([(p.X(), p.Y(), p.Z()) for p in points])


def _lines(compound: Any, chord_mm: float) -> Iterator[Field]:
    """Yield the edges (n, 2) of a compound in the paper's plane."""
    from cadquery import Compound
    from OCP.BRepLib import BRepLib

    if compound is None or compound.IsNull():
        return
    BRepLib.BuildCurves3d_s(compound)
    for edge in Compound(compound).Edges():
        yield sample_edge(edge, chord_mm)[:, :2]


def _merge_lines(lines: Iterable[Field]) -> Any:
    """Merge lines to one geometry without duplicates."""
    import shapely

    long = (line for line in lines if np.hypot(*np.ptp(line, axis=0)) > SAME_LINE_MM)
    return shapely.union_all([shapely.LineString(line) for line in long], grid_size=SAME_LINE_MM)


def _clean(lines: Iterable[Field], covering: Any = None) -> tuple[Field, ...]:
    """Return the lines without duplicates and covered parts, chained, in a fixed order."""
    import shapely

    merged = _merge_lines(lines if covering is None else _drop_doubles(lines))
    if covering is not None:
        merged = shapely.difference(merged, covering, grid_size=SAME_LINE_MM)
    parts = shapely.get_parts(shapely.line_merge(merged).normalize())
    chains = [line.coords for line in parts]
    return tuple(np.array(chain) + 0.0 for chain in sorted(map(list, chains)))


def _drop_doubles(lines: Iterable[Field]) -> list[Field]:
    """Return the lines but those along a longer one: their dashes would fill each other's gaps."""
    import shapely

    ends = shapely.MultiLineString([np.round(line, 4) for line in lines])
    chains = shapely.get_parts(shapely.line_merge(ends))
    chains = chains[np.argsort(-shapely.length(chains), kind="stable")]
    along = shapely.buffer(chains, 2 * SHEET_CHORD_MM, quad_segs=1)
    long, short = shapely.STRtree(chains).query(along, predicate="covers")
    doubles = np.unique(short[long < short])
    return [np.array(chain.coords) for chain in np.delete(chains, doubles)]


def project_views(solid: Any, callouts: Callouts) -> dict[str, DrawnView]:
    """Return the four views by name; the left one is a section if the callouts ask for it."""
    projections = {}
    for name, view in (FLIPPED_VIEWS if callouts.flipped else SHEET_VIEWS).items():
        if name == "left" and callouts.cut_x_mm is not None:
            projections[name] = _section(solid, view, callouts.cut_x_mm)
        else:
            (projections[name],) = project([solid], view)
    return projections


def _section(solid: Any, view: View, x_mm: float) -> DrawnView:
    """Cut at x = x_mm: lines of the far half, and the cut faces."""
    cq = require()
    box = solid.BoundingBox()
    low = cq.Vector(x_mm, box.ymin - 1, box.zmin - 1)
    half = solid.intersect(cq.Solid.makeBox(box.xmax + 1 - x_mm, box.ylen + 2, box.zlen + 2, low))
    (projection,) = project([half], view)
    faces = []
    for face in half.Faces():
        bounds = face.BoundingBox()
        if abs(bounds.xmin - x_mm) < 1e-4 and abs(bounds.xmax - x_mm) < 1e-4:
            wires = [face.outerWire(), *face.innerWires()]
            faces.append([view.flat(_outline(wire)) for wire in wires])
    faces.sort(key=lambda loops: [loop.min(axis=0).round(4).tolist() for loop in loops])
    return replace(projection, hidden=(), hatched=faces)


def _outline(wire: Any) -> Field:
    """Sample a closed wire to points (n, 3), its edges end to end."""
    from OCP.TopAbs import TopAbs_REVERSED

    points = []
    for edge in wire:
        along = sample_edge(edge)
        points.append(along[::-1] if edge.wrapped.Orientation() == TopAbs_REVERSED else along)
    return np.concatenate(points)
