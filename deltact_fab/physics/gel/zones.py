"""Contact and stick zones of a solved face, and averaging onto the lattice of the resting face.

The rim of a hard contact is where the gap g beside it closes. It opens as the power 3/2 of the
distance (Johnson, Contact Mechanics, ch. 5), so g^(2/3) is a straight line there, over more than a
cell, whereas pressures next to the rim are the least accurate of a mesh with a few cells across the
contact. So the contour of g about NEAR_CELLS outside the contact is moved inwards by extrapolating
g^(2/3) from there to FAR_CELLS.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Field, Point2, SolverError


def means(edges_mm: Field, at_mm: Field) -> Field:
    """Matrix (nodes, parts) from values between edges to means at the nodes, along one axis.

    Tractions jump, so values that are constant over parts of the face go to the lattice's nodes by
    area. A node holds the mean weighted with its hat function: 1 at the node, 0 from the next ones
    on. Hats are nowhere negative, add up to 1 and reproduce x and y, so the trapezoidal sum over
    the face gives the parts' force, and on the resting face their moment.
    edges_mm (parts + 1,), at_mm (nodes,): rising. Parts outside the last node count to it.
    """
    shares = np.diff(_hats_up_to(edges_mm, at_mm), axis=0).T
    return np.ascontiguousarray(shares / _areas(at_mm)[:, None])


def _areas(nodes: Field) -> Field:
    """Integrals of the nodes' hat functions: the trapezoidal weights."""
    half = np.diff(nodes) / 2
    return np.append(half, 0.0) + np.append(0.0, half)


def _hats_up_to(x: Field, nodes: Field) -> Field:
    """Integrals (points, nodes) of the hats from the first node; the outer hats continue as 1."""
    n, width = len(nodes), np.diff(nodes)
    i = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, n - 2)
    rows, s = np.arange(len(x)), np.clip((x - nodes[i]) / width[i], 0.0, 1.0)
    passed = (np.arange(n - 1) < i[:, None]) * (width / 2)
    integrals = np.zeros((len(x), n))
    integrals[:, :-1] += passed
    integrals[:, 1:] += passed
    integrals[rows, i] += width[i] * (s - s**2 / 2)
    integrals[rows, i + 1] += width[i] * s**2 / 2
    integrals[:, 0] += np.minimum(x - nodes[0], 0.0)
    integrals[:, -1] += np.maximum(x - nodes[-1], 0.0)
    return integrals


def hermite(knots: Field, points: Field) -> Field:
    """Matrix (points, knots) of local cubic interpolation, extrapolated outside the knots.

    Slopes at the knots are those of parabolas through three neighbours.
    """
    from scipy.interpolate import CubicHermiteSpline

    values = np.eye(len(knots))
    slopes = np.gradient(values, knots, axis=0, edge_order=2 if len(knots) > 2 else 1)
    return np.asarray(CubicHermiteSpline(knots, values, slopes)(points))


# Cells outside the contact; by hand: nearer has the mesh's error, farther leaves the power law.
NEAR_CELLS, FAR_CELLS = 0.75, 1.5
RIM_ERROR, STICK_RIM_ERROR = 0.14, 0.2  # cells; measured, docs/evidence/gel.md
FRICTION_MARGIN = 1e-6  # of friction's bound; by hand: above rounding
SLIP_ZONE, STICK_ZONE = 1, 2  # values of a zone map by definition; 0: no contact

Flags = NDArray[np.bool_]
ZoneMap = NDArray[np.uint8]


@dataclass(frozen=True)
class Zones:
    """Zones of the whole contact, seen along z in the deformed state; errors are estimates.

    contact_area_mm2: projected on the face, pi a^2 of Hertz; a steep indenter touches more surface.
    stick_area_mm2: part below friction's bound; without friction all of the contact slips.
    centroid_mm: (x, y) of the contact in the sensor frame; without contact, the tip's.
    """

    contact_area_mm2: float = 0.0
    contact_area_error_mm2: float = 0.0
    stick_area_mm2: float = 0.0
    stick_area_error_mm2: float = 0.0
    centroid_mm: Point2 = (0.0, 0.0)

    def with_errors_at_least(self, coarse: Zones) -> Zones:
        """Enlarge the errors to at least the change from a coarser mesh."""
        fine, reference = vars(self), vars(coarse)
        names = ("contact_area", "stick_area")
        change = {f"{n}_error_mm2": abs(fine[f"{n}_mm2"] - reference[f"{n}_mm2"]) for n in names}
        return replace(self, **{n: max(fine[n], minimum) for n, minimum in change.items()})


def measure_zones(
    axes_mm: Sequence[Field], place_mm: Field, inside: Field, sticks: Flags,
    cell_mm: float, edge_error_mm: float, lattice_mm: tuple[Field, Field],
) -> tuple[Zones, ZoneMap]:  # fmt: skip
    """Return the zones and their map (ny, nx) on another lattice, by nearest nodes.

    axes_mm: x and y of the nodes at rest, evenly spaced. place_mm (ny, nx, 2): deformed positions.
    inside (ny, nx): fraction of each node in contact. sticks (ny, nx): True where it sticks.
    edge_error_mm: error of the rim at a sharp edge, besides the cells'. lattice_mm: of the map.
    Raises SolverError where no part of the contact faces the indenter.
    """
    steps = [axis[1] - axis[0] for axis in reversed(axes_mm)]
    (xy, xx), (yy, yx) = (np.gradient(place_mm[..., k], *steps) for k in (0, 1))
    # The face below a fold is hidden.
    areas = np.maximum(xx * yy - xy * yx, 0.0) * math.prod(steps)
    figures: list[float] = []
    for zone, cells in ((inside, RIM_ERROR), (inside * sticks, STICK_RIM_ERROR)):
        rim, error_mm = np.hypot(*np.gradient(zone, *steps)), edge_error_mm + cells * cell_mm
        figures += [float((areas * zone).sum()), error_mm * float((areas * rim).sum())]
    if figures[0] <= 0:
        raise SolverError(
            f"contact: the face is folded wherever it is touched; cells of {cell_mm:.3g} mm are "
            "too coarse for this depth"
        )
    # Where cells are as large as the contact (error over a tenth of the area) it grows squared.
    figures[1] *= max(1.0, 10 * figures[1] / figures[0])
    x, y = np.tensordot(areas * inside, place_mm, 2) / figures[0]
    zone_map = np.pad(np.where(sticks, STICK_ZONE, SLIP_ZONE) * (inside >= 0.5), 1)
    columns, rows = (
        (np.rint((to - axis[0]) / (axis[1] - axis[0])).astype(int) + 1).clip(0, len(axis) + 1)
        for axis, to in zip(axes_mm, lattice_mm, strict=True)
    )
    zones = Zones(figures[0], figures[1], figures[2], figures[3], (float(x), float(y)))
    return zones, zone_map[np.ix_(rows, columns)].astype(np.uint8)


def contact_share(gap_mm: Field, touched: Flags, cell_mm: float, step_mm: Sequence[float]) -> Field:
    """Fraction (ny, nx) of each node in contact; step_mm: node spacing along y and x.

    gap_mm (ny, nx): to the indenter. touched (ny, nx): True next to a point under pressure.
    """
    from scipy.ndimage import distance_transform_edt

    def to_mm(mask: Flags) -> Field:
        return np.asarray(distance_transform_edt(~mask, sampling=step_mm))

    h_mm = max(step_mm)
    band = np.abs(to_mm(touched) - NEAR_CELLS * cell_mm) < h_mm
    level = float(np.median(gap_mm[band])) if band.any() else 0.0
    near = gap_mm < level
    distance = to_mm(near) - h_mm / 2
    ring = ~near & (distance < (FAR_CELLS - NEAR_CELLS) * cell_mm)
    if level <= 0 or not ring.any():
        return touched.astype(np.float64)  # contact up to the face's edge, or in a fold
    start = level ** (2 / 3)
    rise = ((gap_mm[ring] ** (2 / 3) - start) * distance[ring]).sum() / (distance[ring] ** 2).sum()
    share = np.clip((to_mm(~near) - start / rise) / h_mm, 0.0, 1.0)
    return share if share.any() else touched.astype(np.float64)  # contact smaller than its cells
