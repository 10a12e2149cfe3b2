"""What is seen of each of several bodies that sit inside one another, as outlines on paper.

Their borders are the lines of hidden-line removal to within a step, and lie under those lines.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...aliases import Points
from .projection import View

STEP_MM = 0.1  # on paper; a line is 0.25 wide
_SPARE_PX = 2


def regions(triangles: Sequence[Points], view: View, scale: float) -> list[list[Points]]:
    """Loops (n, 2) of each body in mm of the model's plane, to be filled by the even-odd rule.

    triangles: corners (n, 3, 3) of each body's mesh, outwards. scale: paper over model.
    """
    import cv2

    step_mm = STEP_MM / scale
    every = np.concatenate([view.flat(t).reshape(-1, 2) for t in triangles])
    low = every.min(axis=0) - _SPARE_PX * step_mm
    columns, rows = np.ceil((every.max(axis=0) - low) / step_mm).astype(int) + _SPARE_PX
    near = np.full((rows, columns), -np.inf)
    seen = np.full((rows, columns), -1)
    for body, corners in enumerate(triangles):
        _draw(body, (view.flat(corners) - low) / step_mm, view.depth(corners), near, seen)
    found = []
    for body in range(len(triangles)):
        mask = (seen == body).astype(np.uint8)
        outlines, _ = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
        loops = [cv2.approxPolyDP(outline, 0.7, True)[:, 0] for outline in outlines]
        found.append([loop * step_mm + low for loop in loops if len(loop) > 2])
    return found


def _draw(
    body: int, flat: Points, depth: Points, near: NDArray[np.float64], seen: NDArray[np.int64]
) -> None:
    """The triangles of one body that face the viewer, where nothing lies nearer; units of steps."""
    u, v = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    first = np.ceil(flat.min(axis=1)).astype(int)
    last = np.floor(flat.max(axis=1)).astype(int)
    for k in np.flatnonzero((area > 1e-9) & (first <= last).all(axis=1)):
        (x0, y0), (x1, y1) = first[k], last[k]
        dx = np.arange(x0, x1 + 1) - flat[k, 0, 0]
        dy = (np.arange(y0, y1 + 1) - flat[k, 0, 1])[:, None]
        s = (dx * v[k, 1] - dy * v[k, 0]) / area[k]
        t = (dy * u[k, 0] - dx * u[k, 1]) / area[k]
        at = depth[k, 0] + s * (depth[k, 1] - depth[k, 0]) + t * (depth[k, 2] - depth[k, 0])
        window = np.s_[y0 : y1 + 1, x0 : x1 + 1]
        over = (s >= 0) & (t >= 0) & (s + t <= 1) & (at > near[window])
        near[window][over] = at[over]
        seen[window][over] = body
