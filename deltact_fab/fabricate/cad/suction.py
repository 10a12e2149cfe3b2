"""Suction cups of a part as it is printed, hanging from the platform into the resin.

Each layer forms on the film, and the part is then pulled off it. A hollow that film, part and
platform close on all sides holds by vacuum, and may tear the part off.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .mesh import Mesh

CELL_MM = 0.5  # by hand, in plan and height: smaller costs time, larger closes narrow vents
MAX_CUP_MM2 = 100.0
"""By hand: 10 N at full vacuum, as much as a foot of MIN_CONTACT_MM2 bears; bores of pins pass."""


def find_cups(mesh: Mesh, on_supports: bool) -> list[float]:
    """Return the areas (mm2) of the cups in the layer with the largest, largest first.

    mesh: in print pose. on_supports: resin flows in below the part, else the platform closes it.
    A hollow counts up to the layer where it opens to the sides.
    """
    from scipy.cluster.hierarchy import DisjointSet
    from scipy.ndimage import label

    in_plane = np.zeros((3, 3, 3), bool)
    in_plane[1, 1, :] = in_plane[1, :, 1] = True
    # Empty regions of each layer, numbered layer by layer; 0 is the part.
    regions, count = label(~_cells(mesh), in_plane)
    area_mm2 = (np.bincount(regions.ravel()) * CELL_MM**2).tolist()
    codes = np.unique(regions[1:] * np.int64(count + 1) + regions[:-1])
    links = [(n, k) for n, k in zip(*(v.tolist() for v in divmod(codes, count + 1)), strict=True)]
    open_air, start = 0, 1
    worst: list[float] = []
    joined = DisjointSet(range(count + 1))
    for layer, last in zip(regions, regions.max(axis=(1, 2)).tolist(), strict=True):
        joined.merge(open_air, int(layer[0, 0]))
        news = range(start, last + 1)
        for pair in links:
            if pair[0] in news and pair[1]:
                joined.merge(*pair)
        if on_supports and start == 1:
            for region in news:
                joined.merge(open_air, region)
        cups: dict[int, float] = {}
        for region in news:
            if not joined.connected(open_air, region):
                root = int(joined[region])
                cups[root] = cups.get(root, 0.0) + area_mm2[region]
        worst = max(worst, sorted(cups.values(), reverse=True))
        start = last + 1
    return worst


def _cells(mesh: Mesh) -> NDArray[np.bool_]:
    """Return the cells (z, x, y) whose middle is inside, with a border of empty ones in plan.

    Each triangle switches all cells of a column above it between outside and inside.
    """
    corners = mesh.corners_mm / CELL_MM
    # Off the mesh's own coordinates by irrational shares: no middle lies on an edge.
    corners -= corners.min(axis=(0, 1)) - (1.4142, 1.7321, 0.0)
    nx, ny, nz = np.ceil(corners.max(axis=(0, 1))).astype(int) + (2, 2, 0)
    a, u, v = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    twice = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    first = np.ceil(corners[..., :2].min(axis=1) - 0.5).astype(int)
    width, length = (np.ceil(corners[..., :2].max(axis=1) - 0.5).astype(int) - first).T
    count = np.where(np.abs(twice) > 1e-9, width * length, 0)
    t = np.repeat(np.arange(len(count)), count)
    step = np.arange(len(t)) - np.repeat(np.cumsum(count) - count, count)
    x, y = first[t, 0] + step % width[t], first[t, 1] + step // width[t]
    right, up = x + 0.5 - a[t, 0], y + 0.5 - a[t, 1]
    along_u = (right * v[t, 1] - up * v[t, 0]) / twice[t]
    along_v = (up * u[t, 0] - right * u[t, 1]) / twice[t]
    hit = (along_u >= 0) & (along_v >= 0) & (along_u + along_v < 1)
    z = a[t, 2] + along_u * u[t, 2] + along_v * v[t, 2]
    crossings = np.zeros((nz + 1, nx, ny), np.int8)
    z_cell = np.clip(np.ceil(z[hit] - 0.5), 0, nz).astype(int)
    np.add.at(crossings, (z_cell, x[hit], y[hit]), 1)
    return np.asarray(np.cumsum(crossings, axis=0, dtype=np.int8)[:nz] % 2 == 1)
