"""The paper's simple estimators (Contact Force Estimation), and their moments, which are ours.

Sums are times the area of a point's cell, in mm, so that they do not depend on the distance of the
points.
"""

from __future__ import annotations

import numpy as np

from ...aliases import Array
from ..face import FaceFlow, whole
from ..hodge import Hodge, decompose
from ..view import SensorView
from .model import Features

TURNING = ("x ry mm4", "y rx mm4", "x hy mm4", "y hx mm4")


class Sums(Features):
    """The sum of |d| for the normal force, the sum of V for shear, first moments for torque.

    The paper takes the norm of the sum of V, the size of the shear force; its two components say
    its direction too.
    """

    name = "sums"
    names = ("|d| mm3", "x|d| mm4", "y|d| mm4", "Vx mm3", "Vy mm3", *TURNING)
    explains = {  # noqa: RUF012
        "fx": ("Vx mm3",),
        "fy": ("Vy mm3",),
        "fz": ("|d| mm3",),
        "tx": ("y|d| mm4", "Vy mm3"),
        "ty": ("x|d| mm4", "Vx mm3"),
        "tz": TURNING,
    }

    def __init__(self, view: SensorView) -> None:
        """Nothing of the sensor is needed."""

    def of(self, flow: FaceFlow) -> Array:
        """(9,) in mm3 and mm4."""
        flow = whole(flow)
        parts = decompose(flow)
        spread = np.sqrt(np.einsum("...i,...i", parts.d, parts.d))
        shear = [integrals(flow.shift_mm[..., i], flow)[0] for i in (0, 1)]
        return np.concatenate((integrals(spread, flow), shear, turning(parts, flow)))


def integrals(values: Array, flow: FaceFlow) -> Array:
    """Over the view, of values (h, w) at the flow's points, and of x and of y times them: (3,)."""
    columns, rows = values.sum(axis=0, dtype=float), values.sum(axis=1, dtype=float)
    return np.array([columns.sum(), columns @ flow.x_mm, rows @ flow.y_mm]) * flow.cell_mm**2


def turning(parts: Hodge, flow: FaceFlow) -> Array:
    """The TURNING of the face, (4,): moments about its centre of what has no divergence.

    A twist on the spot is in r, and a shear force off the centre in h too: they are apart because
    the gel answers them with unlike stiffness.
    """
    return np.concatenate(
        [
            (integrals(part[..., 1], flow)[1], integrals(part[..., 0], flow)[2])
            for part in (parts.r, parts.h)
        ]
    )
