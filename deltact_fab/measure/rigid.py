"""The rigid motion of the whole view, and the flow that remains without it."""

from __future__ import annotations

import numpy as np

from ..aliases import Array
from .face import FaceFlow


def rigid(flow: FaceFlow) -> tuple[Array, float, Array]:
    """Shift (2,) mm and turn in degrees that best fit the known points, and what is left (n, 2).

    Least squares over x -> R x + t (Kabsch 1976, in the plane). At least one point must be known.
    """
    x, y = np.meshgrid(flow.x_mm, flow.y_mm)
    at = np.stack((x[flow.known], y[flow.known]), axis=-1)
    to = at + flow.shift_mm[flow.known].astype(float)
    a, b = at - at.mean(0), to - to.mean(0)
    turn = np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b))
    c, s = np.cos(turn), np.sin(turn)
    spun = np.array([[c, -s], [s, c]])
    shift = to.mean(0) - spun @ at.mean(0)
    return shift, float(np.degrees(turn)), to - (at @ spun.T + shift)
