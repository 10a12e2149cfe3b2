"""Solids to lines on a plane: exact hidden-line removal by the CAD kernel, sampled to polylines."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...aliases import Points, Vector

CHORD_MM = 0.005
ANGLE_RAD = 0.15
SAME_MM = 1e-4  # lines closer than this are one line; far below what any printer draws


@dataclass(frozen=True)
class View:
    """A parallel projection.

    direction: where the viewer looks. up: a direction that points upwards on the paper.
    """

    direction: Vector
    up: Vector

    @cached_property
    def axes(self) -> tuple[Points, Points, Points]:
        """Unit vectors to the right, upwards and towards the viewer.

        Raises ValueError when direction and up are parallel.
        """
        back = -_unit(np.array(self.direction, float))
        right = np.cross(np.array(self.up, float), back)
        if not np.linalg.norm(right) > 1e-9:
            raise ValueError(f"up {self.up} is parallel to direction {self.direction}")
        right = _unit(right)
        return right, np.cross(back, right), back

    def flat(self, points_mm: Any) -> Points:
        """Points (n, 3) or (3,) on the paper, (n, 2) or (2,) in mm."""
        right, up, _ = self.axes
        return np.asarray(points_mm, float) @ np.stack([right, up], axis=1)

    def depth(self, points_mm: Any) -> Points:
        """How far points (n, 3) lie towards the viewer, (n,) in mm."""
        return np.asarray(np.asarray(points_mm, float) @ self.axes[2])


@dataclass(frozen=True)
class ProjectedLines:
    """Lines of one solid, polylines (n, 2) in mm, right and up on the paper.

    visible, hidden: sharp edges and outlines. smooth: visible edges where two faces meet without
    a corner.
    """

    visible: tuple[Points, ...]
    hidden: tuple[Points, ...]
    smooth: tuple[Points, ...]

    @property
    def box_mm(self) -> tuple[Points, Points]:
        """Lower left and upper right corner of everything that is drawn."""
        every = np.concatenate([*self.visible, *self.hidden, *self.smooth])
        return every.min(axis=0), every.max(axis=0)


def project(
    solids: Sequence[Any],
    direction: Vector,
    up: Vector,
    chord_mm: float = CHORD_MM,
) -> list[ProjectedLines]:
    """Each solid's visible and hidden lines, the solids hiding one another.

    chord_mm: largest distance of a polyline from its curve. A straight hidden line is left out
    where a visible one of any of the solids covers it.
    """
    from OCP.BRepBuilderAPI import BRepBuilderAPI_Copy
    from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt
    from OCP.HLRAlgo import HLRAlgo_Projector
    from OCP.HLRBRep import HLRBRep_Algo, HLRBRep_HLRToShape

    right, _, back = View(direction, up).axes
    # Copies: one solid may stand in two places, and a mesh left by an export changes its box.
    shapes = [BRepBuilderAPI_Copy(solid.wrapped, True, False).Shape() for solid in solids]
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
    covering = _Straights(line for visible, _, _ in drawn for line in visible)
    return [
        ProjectedLines(_tidy(visible, None), _tidy(hidden, covering), _tidy(smooth, covering))
        for visible, hidden, smooth in drawn
    ]


def sampled(edge: Any, chord_mm: float = CHORD_MM) -> Points:
    """Points (n, 3) along a cadquery or kernel edge, in its curve's sense."""
    from OCP.BRepAdaptor import BRepAdaptor_Curve
    from OCP.GCPnts import GCPnts_TangentialDeflection
    from OCP.GeomAbs import GeomAbs_Line

    curve = BRepAdaptor_Curve(getattr(edge, "wrapped", edge))
    if curve.GetType() == GeomAbs_Line:
        ends = [curve.Value(curve.FirstParameter()), curve.Value(curve.LastParameter())]
    else:
        at = GCPnts_TangentialDeflection(curve, ANGLE_RAD, chord_mm)
        ends = [at.Value(i) for i in range(1, at.NbPoints() + 1)]
    return np.array([(p.X(), p.Y(), p.Z()) for p in ends])


def _lines(compound: Any, chord_mm: float) -> Iterator[Points]:
    """The edges of a compound that lies in the paper's plane, (n, 2) each."""
    from OCP.BRepLib import BRepLib
    from OCP.TopAbs import TopAbs_EDGE
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopoDS import TopoDS

    if compound is None or compound.IsNull():
        return
    BRepLib.BuildCurves3d_s(compound)
    explorer = TopExp_Explorer(compound, TopAbs_EDGE)
    while explorer.More():
        yield sampled(TopoDS.Edge(explorer.Current()), chord_mm)[:, :2]
        explorer.Next()


def _unit(vector: Points) -> Points:
    length = float(np.linalg.norm(vector))
    if not length > 0:
        raise ValueError("a direction of length 0")
    return np.asarray(vector / length)


class _Straights:
    """Straight lines as intervals along their carrier: overlapping ones become one."""

    def __init__(self, lines: Iterable[Points]) -> None:
        self.along: dict[tuple[int, int, int], list[tuple[float, float]]] = {}
        self.carrier: dict[tuple[int, int, int], tuple[Points, Points]] = {}
        for line in lines:
            if _is_straight(line):
                self._add(line)
        self.along = {key: _union(parts) for key, parts in self.along.items()}

    def _add(self, line: Points) -> None:
        key, origin, step = _carrier(line)
        # A carrier whose rounding falls on a boundary also answers to its neighbour's key.
        key = next((k for k in _near(key) if k in self.carrier), key)
        origin, step = self.carrier.setdefault(key, (origin, step))
        a, b = sorted(((line[[0, -1]] - origin) @ step).tolist())
        self.along.setdefault(key, []).append((a, b))

    def less(self, other: _Straights) -> Iterator[Points]:
        """Own lines without what lies under the other's."""
        for key, parts in self.along.items():
            origin, step = self.carrier[key]
            cover = []
            for k in _near(key):
                if k in other.along:
                    o, s = other.carrier[k]
                    shift, sense = float((o - origin) @ step), float(s @ step)
                    ends = [
                        sorted((shift + sense * a, shift + sense * b)) for a, b in other.along[k]
                    ]
                    cover += [(a, b) for a, b in ends]
            for a, b in _without(parts, _union(cover)):
                yield np.stack([origin + a * step, origin + b * step])

    def lines(self) -> Iterator[Points]:
        """All of them."""
        for key, parts in self.along.items():
            origin, step = self.carrier[key]
            for a, b in parts:
                yield np.stack([origin + a * step, origin + b * step])


def _is_straight(line: Points) -> bool:
    return len(line) == 2


def _carrier(line: Points) -> tuple[tuple[int, int, int], Points, Points]:
    """Key, foot of the origin, and direction of the endless line through a straight one."""
    step = line[-1] - line[0]
    step = step / np.hypot(*step)
    if step[0] < -1e-9 or (abs(step[0]) <= 1e-9 and step[1] < 0):
        step = -step
    normal = np.array([-step[1], step[0]])
    off = float(line[0] @ normal)
    key = (round(float(step[0]) * 1e5), round(float(step[1]) * 1e5), round(off / SAME_MM))
    return key, normal * off, step


def _near(key: tuple[int, int, int]) -> Iterator[tuple[int, int, int]]:
    for d in (0, -1, 1):
        yield key[0], key[1], key[2] + d


def _union(parts: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    joined: list[tuple[float, float]] = []
    for a, b in sorted(parts):
        if joined and a <= joined[-1][1] + SAME_MM:
            joined[-1] = (joined[-1][0], max(b, joined[-1][1]))
        else:
            joined.append((a, b))
    return joined


def _without(
    parts: list[tuple[float, float]], cover: list[tuple[float, float]]
) -> Iterator[tuple[float, float]]:
    for a, b in parts:
        for low, high in cover:
            if low > a + SAME_MM and low < b:
                yield a, low
            a = max(a, min(high, b)) if low < b else a
        if b - a > SAME_MM:
            yield a, b


def _tidy(lines: Iterable[Points], covering: _Straights | None) -> tuple[Points, ...]:
    """Each line once, straight ones joined and uncovered, then chained; in a fixed order."""
    lines = [line for line in lines if np.hypot(*np.ptp(line, axis=0)) > SAME_MM]
    straight = _Straights(lines)
    kept = list(straight.lines() if covering is None else straight.less(covering))
    curved = {}
    for line in lines:
        if not _is_straight(line):
            key = _key(line)
            curved[min(key, key[::-1])] = line
    kept += curved.values()
    return tuple(sorted((_chosen_sense(c) for c in _chained(kept)), key=_key))


def _key(line: Points) -> tuple[tuple[int, ...], ...]:
    return tuple(tuple(round(v / SAME_MM) for v in p) for p in line.tolist())


def _chosen_sense(line: Points) -> Points:
    key = _key(line)
    return (line if key <= key[::-1] else line[::-1]) + 0.0


def _chained(lines: Iterable[Points]) -> list[Points]:
    """Lines that meet end to end, with no third one there, as one polyline."""
    lines = sorted((_chosen_sense(line) for line in lines), key=_key)
    at: dict[tuple[int, ...], list[int]] = {}
    for i, line in enumerate(lines):
        for end in (0, -1):
            at.setdefault(_key(line)[end], []).append(i)
    used: set[int] = set()
    chains = []
    for i, line in enumerate(lines):
        if i in used:
            continue
        used.add(i)
        for _ in range(2):
            line = line[::-1]
            while True:
                here = at[_key(line)[-1]]
                onward = [j for j in here if j not in used]
                if len(here) != 2 or len(onward) != 1:
                    break
                nxt = lines[onward[0]]
                if _key(nxt)[0] != _key(line)[-1]:
                    nxt = nxt[::-1]
                used.add(onward[0])
                line = np.concatenate([line, nxt[1:]])
        chains.append(line)
    return chains
