"""Relative depth as the paper has it: minus the Gaussian density, smoothed by a guided filter."""

from __future__ import annotations

import cv2
import numpy as np

from ...aliases import Array
from ..face import FaceFlow
from .density import Density

RADIUS_MM = 0.6
EPS = 2.5e-4
"""Variance of the density below which the filter smooths: of .016, thrice what flow noise makes."""


def relative_depth(density: Density, flow: FaceFlow) -> Array:
    """Minus the density of a flow's points, from rest, (h, w) float32, without unit.

    The guided filter (He and Sun 2015) with the density as its own guide keeps edges. Seen off the
    axis a press moves the pattern outwards as a whole, which spreads it on the near side and
    crowds it on the far one: there it is no map of the depth (`depth` is).
    """
    radius = max(1, round(RADIUS_MM / flow.cell_mm))
    own = np.ascontiguousarray(density.relative_depth, np.float32)
    return np.asarray(cv2.ximgproc.guidedFilter(own, own, radius, EPS))
