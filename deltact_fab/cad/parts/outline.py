"""A closed outline whose edges are joined one after the other."""

from __future__ import annotations

from typing import Any

from ..kernel import require

_APART_MM = 1e-6


def closed(plan: Any) -> Any:
    """A workplane's pending edges as one pending wire, closed by a line where it is open.

    In place of `Workplane.close()`: given all edges at once, the kernel chooses by memory address
    which of two ends that meet it keeps, and the end of an arc is not the corner to the last bit.
    The same part would then be other bytes from run to run.
    """
    cq = require()
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeWire

    edges = plan.ctx.popPendingEdges()
    start, end = edges[0].startPoint(), edges[-1].endPoint()
    if (end - start).Length > _APART_MM:
        edges.append(cq.Edge.makeLine(end, start))
    joined = BRepBuilderAPI_MakeWire()
    for edge in edges:
        joined.Add(edge.wrapped)
    plan.ctx.firstPoint = None
    return plan.newObject([cq.Wire(joined.Wire())]).toPending()
