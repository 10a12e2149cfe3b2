"""The rigid motion of the whole view, and the flow that remains without it."""

from __future__ import annotations

import numpy as np

from ..aliases import Array
from .face import FaceFlow


def rigid(flow: FaceFlow) -> tuple[Array, float, Array]:
    """Shift (2,) mm and turn in degrees that best fit the known points, and what is left (n, 2).

    Least squares over x -> R x + t (Kabsch 1976, in the plane). At least one point must be known.
    """
    # As complex numbers x + i y: numpy is slow along an axis of two.
    at = (flow.x_mm + 1j * flow.y_mm[:, None])[flow.known]
    to = at + flow.shift_mm[..., 0][flow.known] + 1j * flow.shift_mm[..., 1][flow.known]
    middle, landed = at.mean(), to.mean()
    a, b = at - middle, to - landed
    turn = np.angle(np.vdot(a, b))
    spun = np.exp(1j * turn)
    shift, left = landed - spun * middle, b - a * spun
    apart = left.view(float).reshape(-1, 2)
    return np.array((shift.real, shift.imag)), float(np.degrees(turn)), apart
