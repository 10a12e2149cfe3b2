"""Indenters as a mesh can feel them: no convex radius smaller than about half a cell.

A facet cannot follow an edge that turns within it: its contact points jump between the two sides
and Newton's method does not settle. The rounding shrinks with the mesh, so it is one more part of
the mesh error, and the fine indenter is found again where cells are twice its radius or less.
"""

from __future__ import annotations

import contextlib
from dataclasses import replace

from ...shapes import Indenter, PosedTip, PrismTip, RidgeTip, Tip, TurnedTip
from ...shapes.bounded import ShapeError
from ...shapes.turned import ProfilePiece

BLUNT = 0.5  # least radius over the cell size


def blunted(indenter: Indenter, cell_mm: float) -> Indenter:
    """The indenter with its edges, corners and noses rounded to BLUNT x cell_mm, where it allows.

    The lowest point stays where it is, and so do name, outline and reach.
    """
    radius = BLUNT * cell_mm
    return replace(indenter, tips=tuple(_blunt(tip, radius) for tip in indenter.tips))


def _blunt(tip: Tip, radius_mm: float) -> Tip:
    """As much of the radius as the tip's other dimensions leave room for."""
    for share in (1.0, 0.8, 0.6, 0.4):
        with contextlib.suppress(ShapeError):
            return _with_radius(tip, share * radius_mm)
    return tip


def _with_radius(tip: Tip, radius_mm: float) -> Tip:
    if isinstance(tip, PosedTip):
        plain = _with_radius(tip.tip, radius_mm)
        return tip if isinstance(plain, PosedTip) else replace(tip, tip=plain)
    if isinstance(tip, PrismTip):
        edge, corner = max(tip.edge_mm, radius_mm), max(tip.corner_mm, radius_mm)
        # A rounded edge needs a corner at least as round to be swept along.
        return replace(tip, edge_mm=edge, corner_mm=max(corner, edge + tip.corner_mm - tip.edge_mm))
    if isinstance(tip, RidgeTip):
        return replace(tip, radius_mm=max(tip.radius_mm, radius_mm))
    if isinstance(tip, TurnedTip):
        return replace(tip, pieces=_rounded_rim(tip, radius_mm))
    return tip


def _rounded_rim(tip: TurnedTip, radius_mm: float) -> tuple[ProfilePiece, ...]:
    """The last arc, from a flat face up to the rim, made wider; other profiles as they are."""
    *inner, last = tip.pieces
    if last.centre_mm is None or not inner or inner[-1].centre_mm is not None:
        return tip.pieces
    rim, top = last.end_mm
    foot = inner[-1].end_mm
    old = rim - last.centre_mm[0]
    flat = abs(top - foot[1] - old) < 1e-9 and old < radius_mm
    if not flat:
        return tip.pieces
    start = (rim - radius_mm, foot[1])
    high = foot[1] + radius_mm
    return (*inner[:-1], ProfilePiece(start), ProfilePiece((rim, high), (start[0], high)))
