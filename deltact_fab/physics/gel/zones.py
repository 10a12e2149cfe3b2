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


def _areas(at: Field) -> Field:
    """Integrals of the nodes' hats: the trapezoids' weights."""
    half = np.diff(at) / 2
    return np.append(half, 0.0) + np.append(0.0, half)


def _hats_up_to(x: Field, at: Field) -> Field:
    """(points, nodes): integrals of the hats from the first node on; outer ones go on as 1."""
    n, width = len(at), np.diff(at)
    i = np.clip(np.searchsorted(at, x, side="right") - 1, 0, n - 2)
    rows, s = np.arange(len(x)), np.clip((x - at[i]) / width[i], 0.0, 1.0)
    passed = (np.arange(n - 1) < i[:, None]) * (width / 2)
    found = np.zeros((len(x), n))
    found[:, :-1] += passed
    found[:, 1:] += passed
    found[rows, i] += width[i] * (s - s**2 / 2)
    found[rows, i + 1] += width[i] * s**2 / 2
    found[:, 0] += np.minimum(x - at[0], 0.0)
    found[:, -1] += np.maximum(x - at[-1], 0.0)
    return found


def hermite(knots: Field, at: Field) -> Field:
    """Matrix (points, knots) of the local cubic; outside of the knots the last cubic goes on.

    Slopes at the knots are those of parabolas through three neighbours.
    """
    from scipy.interpolate import CubicHermiteSpline

    values = np.eye(len(knots))
    slopes = np.gradient(values, knots, axis=0, edge_order=2 if len(knots) > 2 else 1)
    return np.asarray(CubicHermiteSpline(knots, values, slopes)(at))


NEAR, FAR = 0.75, 1.5  # cells beyond the points that touch
RIM, STICK_RIM = 0.1, 0.2  # cells by which the rims of contact and stick zone may be off
AT_BOUND = 1e-6  # of friction's bound
SLIPPING, STICKING = 1, 2  # 0: apart

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

    def beside(self, coarse: Zones) -> Zones:
        """With no smaller errors than the change from a coarser mesh."""
        fine, other = vars(self), vars(coarse)
        names = ("contact_area", "stick_area")
        change = {f"{n}_error_mm2": abs(fine[f"{n}_mm2"] - other[f"{n}_mm2"]) for n in names}
        return replace(self, **{n: max(fine[n], more) for n, more in change.items()})


def measured(
    axes_mm: Sequence[Field], place_mm: Field, inside: Field, sticks: Flags,
    off_mm: tuple[float, float], lattice_mm: tuple[Field, Field],
) -> tuple[Zones, ZoneMap]:  # fmt: skip
    """What touches, and the map (ny, nx) of it on another lattice, of the nearest nodes.

    axes_mm: x and y of the nodes at rest, evenly spaced. place_mm (ny, nx, 2): where they are now.
    inside (ny, nx): the share of each that touches. sticks (ny, nx): of those. off_mm: how far the
    rims of contact and stick zone may be off. lattice_mm: x and y of the map.
    """
    steps = [at[1] - at[0] for at in reversed(axes_mm)]
    (xy, xx), (yy, yx) = (np.gradient(place_mm[..., k], *steps) for k in (0, 1))
    # What lies below a fold is not seen.
    each = np.maximum(xx * yy - xy * yx, 0.0) * math.prod(steps)
    found: list[float] = []
    for zone, off in zip((inside, inside * sticks), off_mm, strict=True):
        rim = np.hypot(*np.gradient(zone, *steps))
        found += [float((each * zone).sum()), off * float((each * rim).sum())]
    # Where cells are as large as the contact, by their square: from a tenth of the area on.
    found[1] *= max(1.0, 10 * found[1] / found[0])
    x, y = np.tensordot(each * inside, place_mm, 2) / found[0]
    zone_map = np.pad(np.where(sticks, STICKING, SLIPPING) * (inside >= 0.5), 1)
    columns, rows = (
        (np.rint((to - at[0]) / (at[1] - at[0])).astype(int) + 1).clip(0, len(at) + 1)
        for at, to in zip(axes_mm, lattice_mm, strict=True)
    )
    zones = Zones(found[0], found[1], found[2], found[3], (float(x), float(y)))
    return zones, zone_map[np.ix_(rows, columns)].astype(np.uint8)


def inside(gap_mm: Field, touched: Flags, cell_mm: float, steps_mm: Sequence[float]) -> Field:
    """Share (ny, nx) of each node that touches, on nodes steps_mm apart along y and x.

    gap_mm (ny, nx): to the indenter. touched (ny, nx): next to a point that is under pressure.
    """
    from scipy.ndimage import distance_transform_edt

    def to_mm(there: Flags) -> Field:
        return np.asarray(distance_transform_edt(~there, sampling=steps_mm))

    step_mm = max(steps_mm)
    beyond = np.abs(to_mm(touched) - NEAR * cell_mm) < step_mm
    level = float(np.median(gap_mm[beyond])) if beyond.any() else 0.0
    near = gap_mm < level
    away = to_mm(near) - step_mm / 2
    ring = ~near & (away < (FAR - NEAR) * cell_mm)
    if level <= 0 or not ring.any():
        return touched.astype(np.float64)  # contact up to the face's edge, or in a fold
    start = level ** (2 / 3)
    rise = ((gap_mm[ring] ** (2 / 3) - start) * away[ring]).sum() / (away[ring] ** 2).sum()
    found = np.clip((to_mm(~near) - start / rise) / step_mm, 0.0, 1.0)
    return found if found.any() else touched.astype(np.float64)  # too small a contact for its cells
