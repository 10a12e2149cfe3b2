"""The true shape in one frame of a virtual rig: the depth, and where there is contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...aliases import Array
from ...measure.face import FaceFlow
from ...optics import LatticeSampler
from ...record import RunTruth
from ...shapes import Indenter

TOUCHING_MM = 0.06
"""A point this near to the indenter's surface touches it, where no traction was recorded. The
gel's cells follow the indenter to within some .04 mm."""
PRESSED = 0.01
"""Of the greatest pressure: what is more is contact, where traction was recorded."""


@dataclass(frozen=True)
class TrueShape:
    """depth_mm (h, w), contact (h, w) bool at a flow's points; contact_by: how it is decided."""

    depth_mm: Array
    contact: Array
    contact_by: str


def true_shape(
    truth: RunTruth, frame_id: str, flow: FaceFlow, indenter: Indenter, tip_mm: Array
) -> TrueShape:
    """Of a frame in which the indenter's tip stands at tip_mm (3,)."""
    sampler = LatticeSampler.make(truth.lattice, flow.x_mm, flow.y_mm)
    u_mm = sampler(truth.displacement_mm(frame_id))
    if not truth.tractions:
        at = np.stack(np.meshgrid(flow.x_mm, flow.y_mm), axis=-1) + u_mm[..., :2]
        height = indenter.height_mm(at[..., 0] - tip_mm[0], at[..., 1] - tip_mm[1])
        contact = (u_mm[..., 2] >= tip_mm[2] + height - TOUCHING_MM) & (u_mm[..., 2] < 0)
        return TrueShape(-u_mm[..., 2], contact, "geometry")
    from scipy.interpolate import RegularGridInterpolator

    pressure = -truth.traction_mpa(frame_id)[..., 2]
    x, y = truth.face_mm(frame_id)
    grid = np.stack(np.meshgrid(flow.y_mm, flow.x_mm, indexing="ij"), axis=-1)
    pressed = RegularGridInterpolator((y, x), pressure)(grid)
    return TrueShape(-u_mm[..., 2], pressed > PRESSED * max(pressure.max(), 1e-9), "traction")
