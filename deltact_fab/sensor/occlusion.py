"""Self-occlusion of a surface: the nearest point along a pixel's ray is visible.

Where the flank of a deep dent overhangs, several points of the face project to one pixel. Between
them lies a piece with a mirrored image; so the ambiguous pixels are those under such a piece, and
the nearest of the other points there is visible.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Field

IndexArray = NDArray[np.intp]
_INSIDE_SLACK = -1e-9  # by hand: barycentric rounding; a pixel on an edge belongs to both sides
_MAX_PAIRS = 2_000_000  # by hand: triangle-pixel pairs per batch; bounds the memory


def folded_pixels(at_px: Field, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Pixels (h, w) onto which a folded piece of the surface projects.

    at_px: image points (x, y) of a grid of surface points, (rows, columns, 2).
    """
    turned = _triangles(_doubled_areas(at_px) <= 0)
    disputed = np.zeros(shape, bool)
    for pixel, _, _ in _covered(at_px, turned, np.ones(shape, bool)):
        disputed.ravel()[pixel] = True
    return disputed


def nearest_surface(at_px: Field, depth: Field, mask: NDArray[np.bool_]) -> Field:
    """Grid position (column, row) visible at each pixel of the mask, (n, 2).

    at_px: as above. depth: of the same points along the camera's axis, (rows, columns). mask:
    pixels (h, w) of the image. nan if nothing projects there; linear within a triangle.
    """
    columns = depth.shape[1]
    facing = _triangles((_doubled_areas(at_px) > 0) & _reaches(at_px, mask))
    best = np.full(mask.size, np.inf)
    position = np.full((mask.size, 2), np.nan)
    for pixel, corners, share in _covered(at_px, facing, mask):
        behind = np.einsum("nk,nk->n", depth.ravel()[corners], share)
        # The last write to a pixel wins: write the nearest last.
        order = np.argsort(-behind, kind="stable")
        order = order[behind[order] < best[pixel[order]]]
        pixel, corners, share = pixel[order], corners[order], share[order]
        best[pixel] = behind[order]
        position[pixel, 0] = np.einsum("nk,nk->n", corners % columns, share)
        position[pixel, 1] = np.einsum("nk,nk->n", corners // columns, share)
    return position[mask.ravel()]


def _doubled_areas(at_px: Field) -> Field:
    """Doubled areas of the two triangles per cell (2, rows - 1, columns - 1); < 0: folded."""
    a, b, c, d = at_px[:-1, :-1], at_px[:-1, 1:], at_px[1:, :-1], at_px[1:, 1:]
    return np.stack((_cross(b - a, c - a), _cross(c - d, b - d)))


def _triangles(chosen: NDArray[np.bool_]) -> IndexArray:
    """Flat corner indices (n, 3) of the chosen triangles."""
    half, row, column = np.nonzero(chosen)
    columns = chosen.shape[2] + 1
    a = row * columns + column
    first = np.where(half, a + columns + 1, a)
    second = np.where(half, a + columns, a + 1)
    return np.stack((first, second, np.where(half, a + 1, a + columns)), -1)


def _reaches(at_px: Field, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """True for cells (rows - 1, columns - 1) whose bounding box contains a pixel of the mask."""
    corners = at_px[:-1, :-1], at_px[:-1, 1:], at_px[1:, :-1], at_px[1:, 1:]
    size = np.array(mask.shape[::-1])
    low = np.clip(np.ceil(np.minimum.reduce(corners)), 0, size).astype(np.intp)
    high = np.clip(np.floor(np.maximum.reduce(corners)) + 1, low, size).astype(np.intp)
    until = np.pad(mask.astype(np.intp).cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    (x0, y0), (x1, y1) = (np.moveaxis(v, -1, 0) for v in (low, high))
    return until[y1, x1] - until[y0, x1] - until[y1, x0] + until[y0, x0] > 0


def _cross(a: Field, b: Field) -> NDArray[np.float64]:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _covered(
    at_px: Field, triangles: IndexArray, mask: NDArray[np.bool_]
) -> Iterator[tuple[IndexArray, IndexArray, Field]]:
    """Yield, in batches, flat mask pixels under triangles, corners (n, 3), barycentric weights."""
    w = mask.shape[1]
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if not len(rows):
        return
    corners_px = at_px.reshape(-1, 2)[triangles]
    low = np.maximum(np.ceil(corners_px.min(1)), (columns[0], rows[0])).astype(np.intp)
    high = np.minimum(np.floor(corners_px.max(1)), (columns[-1], rows[-1])).astype(np.intp)
    size = np.maximum(high - low + 1, 0)
    count = size[:, 0] * size[:, 1]
    touched = np.flatnonzero(count)
    parts = np.cumsum(count[touched]) // _MAX_PAIRS
    for part in range(int(parts[-1]) + 1 if len(parts) else 0):
        batch = touched[parts == part]
        owner = np.repeat(batch, count[batch])
        first = np.cumsum(count[batch]) - count[batch]
        nth = np.arange(len(owner)) - np.repeat(first, count[batch])
        pixel = low[owner] + np.stack((nth % size[owner, 0], nth // size[owner, 0]), -1)
        flat = pixel[:, 1] * w + pixel[:, 0]
        selected = mask.ravel()[flat]
        owner, pixel, flat = owner[selected], pixel[selected], flat[selected]
        a, b, c = (corners_px[owner, k] - pixel for k in range(3))
        share = np.stack((_cross(b, c), _cross(c, a), _cross(a, b)), -1)
        total = share.sum(1)
        share = share / np.where(total == 0, np.nan, total)[:, None]
        inside = (share >= _INSIDE_SLACK).all(1)
        yield flat[inside], triangles[owner[inside]], share[inside]
