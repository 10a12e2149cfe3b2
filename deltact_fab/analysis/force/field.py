"""The force field of a model that says where, against the traction that a virtual rig recorded."""

from __future__ import annotations

import numpy as np

from ...aliases import Array
from ...measure.force import TractionField
from ...record import RunTruth

CONTACT = 0.05
"""Of the peak pressure: where there is a contact."""


def frame_errors(
    field: TractionField, truth: RunTruth, frame_id: str, force_n: Array
) -> tuple[float, ...] | None:
    """Pressure and traction of the peak, total and force in N; None where nothing presses."""
    from scipy.interpolate import RegularGridInterpolator

    x_mm, y_mm = truth.face_mm(frame_id)
    nodes = truth.traction_mpa(frame_id)
    peak = -nodes[..., 2].min()
    if peak <= 1e-6:
        return None
    at = np.stack(np.meshgrid(field.y_mm, field.x_mm, indexing="ij"), axis=-1)
    true = RegularGridInterpolator((y_mm, x_mm), nodes)(at)
    off = (field.traction_mpa - true)[-true[..., 2] > CONTACT * peak] / peak
    apart_n = np.linalg.norm(field.force_n - force_n)
    return (
        float(np.abs(off[:, 2]).mean()), float(np.linalg.norm(off, axis=1).mean()),
        float(apart_n), float(np.linalg.norm(force_n)),
    )  # fmt: skip
