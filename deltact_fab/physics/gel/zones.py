"""The lattice over the resting face, and where the gel touches, where it sticks: of a solved face.

The rim of a hard contact is where the gap g beside it comes down to nothing. It opens as the power
3/2 of the distance (Johnson, Contact Mechanics, ch. 5), so g^(2/3) is a straight line there, far
beyond a cell; pressures next to the rim are what a mesh of a few cells across the contact knows
worst. So the contour of g about NEAR cells outside of what touches is moved in, by how g^(2/3)
rises from there to FAR cells.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Field, Point2


def means(edges_mm: Field, at_mm: Field) -> Field:
    """Matrix (nodes, parts) from values on the parts between edges to the nodes' means, one way.

    Tractions jump, so what a level has on parts of the face, each with one value, goes to the
    lattice's nodes by areas. A node holds the mean around it, weighted with its hat: 1 at the node,
    0 from the next ones on. Hats are nowhere negative, add up to 1 and reproduce x and y, so the
    trapezoids' sum over the face gives the parts' own force, and on the resting face their moment.
    edges_mm (parts + 1,), at_mm (nodes,): rising. What lies beyond the last node is counted to it.
    """
    shares = np.diff(_hats_up_to(edges_mm, at_mm), axis=0).T
    return np.ascontiguousarray(shares / _areas(at_mm)[:, None])


def _areas(nodes: Field) -> Field:
    """Integrals of the nodes' hats: the trapezoids' weights."""
    half = np.diff(nodes) / 2
    return np.append(half, 0.0) + np.append(0.0, half)


def _hats_up_to(x: Field, nodes: Field) -> Field:
    """(points, nodes): integrals of the hats from the first node on; outer ones go on as 1."""
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
    """Matrix (points, knots) of the local cubic; outside of the knots the last cubic goes on.

    Slopes at the knots are those of parabolas through three neighbours.
    """
    from scipy.interpolate import CubicHermiteSpline

    values = np.eye(len(knots))
    slopes = np.gradient(values, knots, axis=0, edge_order=2 if len(knots) > 2 else 1)
    return np.asarray(CubicHermiteSpline(knots, values, slopes)(points))


NEAR_CELLS, FAR_CELLS = 0.75, 1.5  # cells beyond the points that touch
RIM_ERROR, STICK_RIM_ERROR = (
    0.1,
    0.2,
)  # cells by which the rims of contact and stick zone may be off
BOUND_MARGIN = 1e-6  # of friction's bound
SLIP_ZONE, STICK_ZONE = 1, 2  # 0: apart

Flags = NDArray[np.bool_]
ZoneMap = NDArray[np.uint8]


@dataclass(frozen=True)
class Zones:
    """Zones of the whole contact, seen along z in the deformed state; errors are estimates.

    contact_area_mm2: on the face's plane, pi a^2 of Hertz; a steep indenter has a larger surface.
    stick_area_mm2: of it, below friction's bound; without friction all that touches slips.
    centroid_mm: (x, y) of its middle in the sensor frame; without contact, the tip's.
    """

    contact_area_mm2: float = 0.0
    contact_area_error_mm2: float = 0.0
    stick_area_mm2: float = 0.0
    stick_area_error_mm2: float = 0.0
    centroid_mm: Point2 = (0.0, 0.0)

    def with_errors_at_least(self, coarse: Zones) -> Zones:
        """With no smaller errors than the change from a coarser mesh."""
        fine, reference = vars(self), vars(coarse)
        names = ("contact_area", "stick_area")
        change = {f"{n}_error_mm2": abs(fine[f"{n}_mm2"] - reference[f"{n}_mm2"]) for n in names}
        return replace(self, **{n: max(fine[n], minimum) for n, minimum in change.items()})


def measure_zones(
    axes_mm: Sequence[Field], place_mm: Field, inside: Field, sticks: Flags,
    rim_errors_mm: tuple[float, float], lattice_mm: tuple[Field, Field],
) -> tuple[Zones, ZoneMap]:  # fmt: skip
    """What touches, and the map (ny, nx) of it on another lattice, of the nearest nodes.

    axes_mm: x and y of the nodes at rest, evenly spaced. place_mm (ny, nx, 2): where they are now.
    inside (ny, nx): the share of each that touches. sticks (ny, nx): of those. off_mm: how far the
    rims of contact and stick zone may be off. lattice_mm: x and y of the map.
    """
    steps = [axis[1] - axis[0] for axis in reversed(axes_mm)]
    (xy, xx), (yy, yx) = (np.gradient(place_mm[..., k], *steps) for k in (0, 1))
    # What lies below a fold is not seen.
    areas = np.maximum(xx * yy - xy * yx, 0.0) * math.prod(steps)
    figures: list[float] = []
    for zone, error_mm in zip((inside, inside * sticks), rim_errors_mm, strict=True):
        rim = np.hypot(*np.gradient(zone, *steps))
        figures += [float((areas * zone).sum()), error_mm * float((areas * rim).sum())]
    # Where cells are as large as the contact, by their square: from a tenth of the area on.
    figures[1] *= max(1.0, 10 * figures[1] / figures[0])
    x, y = np.tensordot(areas * inside, place_mm, 2) / figures[0]
    zone_map = np.pad(np.where(sticks, STICK_ZONE, SLIP_ZONE) * (inside >= 0.5), 1)
    columns, rows = (
        (np.rint((to - axis[0]) / (axis[1] - axis[0])).astype(int) + 1).clip(0, len(axis) + 1)
        for axis, to in zip(axes_mm, lattice_mm, strict=True)
    )
    zones = Zones(figures[0], figures[1], figures[2], figures[3], (float(x), float(y)))
    return zones, zone_map[np.ix_(rows, columns)].astype(np.uint8)


def contact_share(
    gap_mm: Field, touched: Flags, cell_mm: float, steps_mm: Sequence[float]
) -> Field:
    """Share (ny, nx) of each node that touches, on nodes steps_mm apart along y and x.

    gap_mm (ny, nx): to the indenter. touched (ny, nx): next to a point that is under pressure.
    """
    from scipy.ndimage import distance_transform_edt

    def to_mm(mask: Flags) -> Field:
        return np.asarray(distance_transform_edt(~mask, sampling=steps_mm))

    step_mm = max(steps_mm)
    band = np.abs(to_mm(touched) - NEAR_CELLS * cell_mm) < step_mm
    level = float(np.median(gap_mm[band])) if band.any() else 0.0
    near = gap_mm < level
    distance = to_mm(near) - step_mm / 2
    ring = ~near & (distance < (FAR_CELLS - NEAR_CELLS) * cell_mm)
    if level <= 0 or not ring.any():
        return touched.astype(np.float64)  # contact up to the face's edge, or in a fold
    start = level ** (2 / 3)
    rise = ((gap_mm[ring] ** (2 / 3) - start) * distance[ring]).sum() / (distance[ring] ** 2).sum()
    share = np.clip((to_mm(~near) - start / rise) / step_mm, 0.0, 1.0)
    return share if share.any() else touched.astype(np.float64)  # too small a contact for its cells
