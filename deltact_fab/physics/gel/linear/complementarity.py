"""Contact on a part of a linear face: pressure at a depth, and shear within a bound.

Each is a convex minimisation with one constraint per node, solved separately and without history;
`contact` iterates between them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from deltact_fab.common import Field, Point, SolverError
from deltact_fab.sensor import BlockWindow, FreeBlock, Indenter

from .. import time_limit

# By hand: work against failures or a looser bound, never the solution.
MAX_CONTACT_ITERATIONS = 4000
_POWER_STEPS = 12  # to the largest eigenvalue: the uniform start is already close to it
SUBSET_SHARE = 0.7  # of a set of nodes: a smaller part gets an eigenvalue of its own


def normal_contact(
    operator: BlockWindow, pressure_mpa: Field, rest_gap_mm: Field, goal_mm: float
) -> tuple[Field, float, int]:
    """Solve p >= 0, gap >= 0, p gap = 0 at a given depth by Polonsky-Keer conjugate gradients.

    pressure_mpa: first guess, (my, mx). rest_gap_mm: gap without pressure, (my, mx), inf where the
    indenter does not reach. Returns pressure, worst violation (mm) and operator applications.
    Raises SolverError when `goal_mm` is not reached.
    """
    p = pressure_mpa
    gap = rest_gap_mm + operator.normal_of_pressure(p)
    applications = 1
    direction = np.zeros_like(p)
    old = 0.0
    for _ in range(MAX_CONTACT_ITERATIONS):
        time_limit.check()
        worst = normal_violation(gap, p)
        if worst <= goal_mm:
            return p, worst, applications
        # Penetrating nodes enter with their present residual.
        active = (p > 0) | (gap < 0)
        residual = np.where(active, gap, 0.0)
        new = float(np.vdot(residual, residual))
        direction = np.where(active, residual + (new / old if old else 0.0) * direction, 0.0)
        image = operator.normal_of_pressure(direction)
        applications += 1
        step = float(np.vdot(residual, direction)) / float(np.vdot(direction, image))
        stepped = p - step * direction
        clipped = bool(np.any(stepped < 0))
        if clipped:
            p = np.maximum(stepped, 0.0)
            gap = rest_gap_mm + operator.normal_of_pressure(p)
            applications += 1
        else:
            p = stepped
            gap = gap - step * image
        # A changed set of active nodes ends the conjugacy.
        changed = clipped or bool(np.any((p == 0) & (gap < 0)))
        old = 0.0 if changed else new
    raise SolverError(
        f"contact: pressure not converged after {MAX_CONTACT_ITERATIONS} iterations: "
        f"violation {worst:.1e} mm, {goal_mm:.1e} mm required"
    )


class ShearComplianceBound:
    """Largest eigenvalue of an operator's shear compliance, for changing sets of nodes."""

    def __init__(self, operator: BlockWindow) -> None:
        self._operator = operator
        self._last_bound: tuple[NDArray[np.bool_], float] | None = None

    def largest(self, active: NDArray[np.bool_]) -> tuple[float, int]:
        """Return an upper estimate on the active nodes (my, mx), and operator applications.

        That of a set also bounds its subsets (Cauchy's interlacing), so the last one is reused as
        long as the set lies within it and is not much smaller.
        """
        if self._last_bound is not None:
            nodes, value = self._last_bound
            if not (active & ~nodes).any() and active.sum() >= SUBSET_SHARE * nodes.sum():
                return value, 0
        nodes = binary_dilation(active)
        # The kernel is positive and long-ranged, so the uniform vector is close to the extreme one.
        v = np.stack([nodes, nodes]).astype(np.float64)
        value = 1.0
        for _ in range(_POWER_STEPS):
            v = self._operator.shear_of_shear(v / np.linalg.norm(v)) * nodes
            value = float(np.linalg.norm(v))
        self._last_bound = nodes, 1.02 * value
        return 1.02 * value, _POWER_STEPS


def friction_contact(
    operator: BlockWindow,
    shear_mpa: Field,
    free_slip_mm: Field,
    bound_mpa: Field,
    goal_mm: float,
    compliance: ShearComplianceBound,
) -> tuple[Field, Field, float, int]:
    """Minimise 1/2 q.C q + q.free_slip over |q| <= bound: accelerated gradient with restart.

    shear_mpa: first guess, (2, my, mx). free_slip_mm: slip without shear traction, (2, my, mx).
    bound_mpa: friction x pressure, (my, mx). compliance: of the operator. Restart after O'Donoghue
    and Candes (Found. Comput. Math. 15, 2015). Returns shear, slip, worst violation (mm: slip in
    stick, or the part of the slip that friction does not oppose) and operator applications. Raises
    SolverError when `goal_mm` is not reached.
    """
    largest, applications = compliance.largest(bound_mpa > 0)
    step = 1 / largest
    q = _on_disc(shear_mpa, bound_mpa)
    slip = operator.shear_of_shear(q) + free_slip_mm
    applications += 1
    ahead, ahead_slip, momentum = q, slip, 1.0
    for _ in range(MAX_CONTACT_ITERATIONS):
        time_limit.check()
        worst = float(np.abs(q - _on_disc(q - step * slip, bound_mpa)).max()) / step
        if worst <= goal_mm:
            return q, slip, worst, applications
        q_new = _on_disc(ahead - step * ahead_slip, bound_mpa)
        slip_new = operator.shear_of_shear(q_new) + free_slip_mm
        applications += 1
        if np.vdot(ahead - q_new, q_new - q) > 0:
            momentum, weight = 1.0, 0.0
        else:
            longer = (1 + math.sqrt(1 + 4 * momentum**2)) / 2
            weight = (momentum - 1) / longer
            momentum = longer
        # The operator is linear, so the extrapolated slip costs no application.
        ahead = q_new + weight * (q_new - q)
        ahead_slip = slip_new + weight * (slip_new - slip)
        q, slip = q_new, slip_new
    raise SolverError(
        f"contact: friction not converged after {MAX_CONTACT_ITERATIONS} iterations: "
        f"violation {worst:.1e} mm, {goal_mm:.1e} mm required"
    )


def normal_violation(gap: Field, p: Field) -> float:
    """Largest gap under pressure or penetration anywhere (mm)."""
    return float(np.abs(np.where(p > 0, gap, np.minimum(gap, 0.0))).max())


def _on_disc(q: Field, bound: Field) -> Field:
    """Project a traction (2, ...) to |q| <= bound at every node."""
    size = np.hypot(q[0], q[1])
    return q * np.where(size > bound, bound / np.where(size > 0, size, 1.0), 1.0)


MARGIN_NODES = 3  # by hand: around those below the indenter; fewer repeat more solves


@dataclass
class Patch:
    """Part of the grid that is solved, and the height field above it."""

    rows: slice
    columns: slice
    x_mm: Field  # (my, mx), node positions relative to the tip
    y_mm: Field
    indenter: Indenter
    operator: BlockWindow

    def height_mm(self, shift_mm: Field) -> Field:
        """Height above the nodes after an in-plane shift (2, my, mx)."""
        return self.indenter.height_mm(self.x_mm + shift_mm[0], self.y_mm + shift_mm[1])


def patch_below(
    face: FreeBlock, indenter: Indenter, tip: Point, grow_mm: float, shift_mm: Field
) -> Patch:
    """Return the nodes that can touch: those below the indenter's underside, and a margin.

    grow_mm: added to the depth within which a node counts as below. shift_mm: as in `footprint`.
    Raises SolverError where a tip of the indenter is above no node.
    """
    x, y, depth = tip
    rows, columns, xx, yy = footprint(face, indenter, tip, shift_mm)
    height = indenter.height_mm(xx, yy)
    for t in indenter.tips:
        at_x, at_y = t.lowest_mm
        if not np.any((np.hypot(xx - at_x, yy - at_y) <= t.radius_mm) & (height < depth)):
            raise SolverError(
                f"contact: {indenter.name} at depth {depth:g} mm touches no grid node; "
                f"a spacing below {face.spacing_mm[0]:g} mm or more depth is needed"
            )
    near: NDArray[np.bool_] = height < depth + grow_mm
    rows = _widened(rows, np.logical_or.reduce(near, axis=1), face.shape[0])
    columns = _widened(columns, np.logical_or.reduce(near, axis=0), face.shape[1])
    xx, yy = np.meshgrid(face.x_mm[columns] - x, face.y_mm[rows] - y)
    operator = face.window(
        rows.stop - rows.start, columns.stop - columns.start, rows.start, columns.start
    )
    return Patch(rows, columns, xx, yy, indenter, operator)


def footprint(
    face: FreeBlock, indenter: Indenter, tip: Point, shift_mm: Field
) -> tuple[slice, slice, Field, Field]:
    """Return rows and columns below the whole indenter, and positions (my, mx) from the tip.

    shift_mm (ny, nx, 2): in-plane shift of the nodes.
    """
    slack = float(np.abs(shift_mm).max())
    half_x, half_y = indenter.footprint_half_mm
    columns = span(np.abs(face.x_mm - tip[0]) <= half_x + slack)
    rows = span(np.abs(face.y_mm - tip[1]) <= half_y + slack)
    xx, yy = np.meshgrid(face.x_mm[columns] - tip[0], face.y_mm[rows] - tip[1])
    xx, yy = xx + shift_mm[rows, columns, 0], yy + shift_mm[rows, columns, 1]
    return rows, columns, xx, yy


def span(mask: NDArray[np.bool_]) -> slice:
    """Return the slice from the first to the last True."""
    indices = np.flatnonzero(mask)
    return slice(int(indices[0]), int(indices[-1]) + 1) if indices.size else slice(0, 0)


def _widened(within: slice, mask: NDArray[np.bool_], n: int) -> slice:
    """Widen the span of `mask` in `within` by a margin, to a multiple of 8 nodes."""
    near = span(mask)
    start, stop = within.start + near.start - MARGIN_NODES, within.start + near.stop + MARGIN_NODES
    size = min(n, 8 * math.ceil((stop - start) / 8))
    start = min(max(0, start - (size - (stop - start)) // 2), n - size)
    return slice(start, start + size)
