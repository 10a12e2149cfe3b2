"""Solids to lines on a plane: exact hidden-line removal by the CAD kernel, sampled to polylines;
and the four views of a part, one of them cut.
"""

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

CHORD_MM = 0.005
ANGLE_RAD = 0.15
SAME_MM = 1e-4  # lines closer than this are one line; far below what any printer draws


@dataclass(frozen=True)
class View:
    """A parallel projection.

    direction: where the viewer looks. up: a direction that points upwards on the paper.
    """

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
        """Points (n, 3) or (3,) on the paper, (n, 2) or (2,) in mm."""
        right, up, _ = self.axes
        return np.asarray(points_mm, float) @ np.stack([right, up], axis=1)

    def depth(self, points_mm: Any) -> Field:
        """How far points (n, 3) lie towards the viewer, (n,) in mm."""
        return np.asarray(np.asarray(points_mm, float) @ self.axes[2])


VIEWS = {
    "front": View((0, 1, 0), (0, 0, 1)),
    "top": View((0, 0, -1), (0, 1, 0)),
    "left": View((1, 0, 0), (0, 0, 1)),
    "picture": View((1, 1, -0.8), (0, 0, 1)),
}
# The part turned half about x.
FLIPPED = {
    name: View(*((x, -y, -z) for x, y, z in (view.direction, view.up)))
    for name, view in VIEWS.items()
}


@dataclass(frozen=True)
class DrawnView:
    """Lines of one solid in a view, polylines (n, 2) in mm, right and up on the paper.

    visible, hidden: sharp edges and outlines. smooth: visible edges where two faces meet without
    a corner. hatched: faces of a section, each its loops.
    """

    view: View
    visible: tuple[Field, ...]
    hidden: tuple[Field, ...]
    smooth: tuple[Field, ...]
    hatched: Sequence[Sequence[Field]] = ()

    @cached_property
    def box_mm(self) -> tuple[Point2, Point2]:
        """Lower left and upper right corner of everything that is drawn."""
        every = np.concatenate([*self.visible, *self.hidden, *self.smooth])
        (x0, y0), (x1, y1) = every.min(axis=0).tolist(), every.max(axis=0).tolist()
        return (x0, y0), (x1, y1)

    def shows(self, points: Field, near_mm: float) -> NDArray[np.bool_]:
        """Which points (n, 2) on the model's plane lie on a visible line."""
        import shapely

        return np.asarray(shapely.distance(self._shown, shapely.points(points)) < near_mm)

    @cached_property
    def _shown(self) -> Any:
        import shapely

        return shapely.MultiLineString([*self.visible, *self.smooth])


def project(solids: Sequence[Any], view: View, chord_mm: float = CHORD_MM) -> list[DrawnView]:
    """Each solid's visible and hidden lines, the solids hiding one another.

    chord_mm: largest distance of a polyline from its curve. A hidden line is left out where a
    visible one of any of the solids covers it.
    """
    from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt
    from OCP.HLRAlgo import HLRAlgo_Projector
    from OCP.HLRBRep import HLRBRep_Algo, HLRBRep_HLRToShape

    right, _, back = view.axes
    # Copies: one solid may stand in two places, and a mesh left by an export changes its box.
    shapes = [solid.copy().wrapped for solid in solids]
    removal = HLRBRep_Algo()
    for shape in shapes:
        removal.Add(shape)
    plane = gp_Ax2(gp_Pnt(0, 0, 0), gp_Dir(*back.tolist()), gp_Dir(*right.tolist()))
    removal.Projector(HLRAlgo_Projector(plane))
    removal.Update()
    removal.Hide()
    found = HLRBRep_HLRToShape(removal)
    drawn = []
    for shape in shapes:
        visible = [*_lines(found.VCompound(shape), chord_mm)]
        visible += _lines(found.OutLineVCompound(shape), chord_mm)
        hidden = [*_lines(found.HCompound(shape), chord_mm)]
        hidden += _lines(found.OutLineHCompound(shape), chord_mm)
        smooth = [*_lines(found.Rg1LineVCompound(shape), chord_mm)]
        drawn.append((visible, hidden, smooth))
    covering = _united(line for visible, _, _ in drawn for line in visible)
    return [
        DrawnView(view, _tidy(visible), _tidy(hidden, covering), _tidy(smooth, covering))
        for visible, hidden, smooth in drawn
    ]


def sampled(edge: Any, chord_mm: float = CHORD_MM) -> Field:
    """Points (n, 3) along a cadquery Edge, in its curve's sense."""
    from OCP.BRepAdaptor import BRepAdaptor_Curve
    from OCP.GCPnts import GCPnts_TangentialDeflection

    at = GCPnts_TangentialDeflection(BRepAdaptor_Curve(edge.wrapped), ANGLE_RAD, chord_mm)
    points = (at.Value(i) for i in range(1, at.NbPoints() + 1))
    return np.array([(p.X(), p.Y(), p.Z()) for p in points])


def _lines(compound: Any, chord_mm: float) -> Iterator[Field]:
    """The edges of a compound that lies in the paper's plane, (n, 2) each."""
    from cadquery import Compound
    from OCP.BRepLib import BRepLib

    if compound is None or compound.IsNull():
        return
    BRepLib.BuildCurves3d_s(compound)
    for edge in Compound(compound).Edges():
        yield sampled(edge, chord_mm)[:, :2]


def _united(lines: Iterable[Field]) -> Any:
    """All lines as one geometry, each place once."""
    import shapely

    seen = [shapely.LineString(line) for line in lines if np.hypot(*np.ptp(line, axis=0)) > SAME_MM]
    return shapely.union_all(seen, grid_size=SAME_MM)


def _tidy(lines: Iterable[Field], covering: Any = None) -> tuple[Field, ...]:
    """Each line once, uncovered, chained where two meet end to end; in a fixed order."""
    import shapely

    whole = _united(lines)
    if covering is not None:
        whole = shapely.difference(whole, covering, grid_size=SAME_MM)
    chains = [line.coords for line in shapely.get_parts(shapely.line_merge(whole).normalize())]
    return tuple(np.array(chain) + 0.0 for chain in sorted(map(list, chains)))


def views(solid: Any, said: Callouts) -> dict[str, DrawnView]:
    """The four projections; the left one cut where the callouts ask for a section."""
    drawn = {}
    for name, view in (FLIPPED if said.flipped else VIEWS).items():
        if name == "left" and said.cut_x_mm is not None:
            drawn[name] = _section(solid, view, said.cut_x_mm)
        else:
            (drawn[name],) = project([solid], view)
    return drawn


def _section(solid: Any, view: View, x_mm: float) -> DrawnView:
    """What is left on the far side of the plane x = x_mm, and the faces that the plane cuts."""
    cq = require()
    box = solid.BoundingBox()
    low = cq.Vector(x_mm, box.ymin - 1, box.zmin - 1)
    kept = solid.intersect(cq.Solid.makeBox(box.xmax + 1 - x_mm, box.ylen + 2, box.zlen + 2, low))
    (drawn,) = project([kept], view)
    faces = []
    for face in kept.Faces():
        bounds = face.BoundingBox()
        if abs(bounds.xmin - x_mm) < 1e-4 and abs(bounds.xmax - x_mm) < 1e-4:
            wires = [face.outerWire(), *face.innerWires()]
            faces.append([view.flat(_outline(wire)) for wire in wires])
    faces.sort(key=lambda loops: [loop.min(axis=0).round(4).tolist() for loop in loops])
    return replace(drawn, hidden=(), hatched=faces)


def _outline(wire: Any) -> Field:
    """A closed wire as points (n, 3), its edges end to end."""
    from OCP.TopAbs import TopAbs_REVERSED

    points = []
    for edge in wire:
        along = sampled(edge)
        points.append(along[::-1] if edge.wrapped.Orientation() == TopAbs_REVERSED else along)
    return np.concatenate(points)
