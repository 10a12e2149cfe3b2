"""The force field of a model that says where, against the traction that a virtual rig recorded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...aliases import Array
from ...measure.force import LocalFeatures, TractionField
from ...record import Run, RunTruth
from .dataset import ForceData, point_flows
from .judge import fit

CONTACT = 0.05
"""Of the peak pressure: where there is a contact."""


@dataclass(frozen=True)
class FieldError:
    """Means over the frames that press, each by a model that saw nothing of their position.

    pressure, traction: error over the contact, of the peak pressure; of the traction its length.
    total: length of the error of the field's sum, of the measured force; total_n: its RMS in N.
    """

    frames: int
    pressure: float
    traction: float
    total: float
    total_n: float

    @property
    def line(self) -> str:
        """In a sentence."""
        return (
            f"Force field of {self.frames} frames on left-out positions against truth: pressure "
            f"off by {self.pressure:.3f} of its peak in the mean over the contact, traction by "
            f"{self.traction:.3f}; its total by {self.total_n:.3f} N, {100 * self.total:.1f} % of "
            "the force in the mean"
        )


def field_error(runs: Sequence[Run], data: ForceData, name: str) -> FieldError | None:
    """Of a feature set on its own runs; None where it has no field, or no truth has traction."""
    features = data.sets[name]
    positions = data.points["position"].to_numpy()
    if not isinstance(features, LocalFeatures) or len(set(positions)) < 2:
        return None
    models = {p: fit(data, name, positions != p) for p in dict.fromkeys(positions)}
    truths = {run.folder: run.truth() for run in runs}
    if any(truth is None or not truth.tractions for truth in truths.values()):
        return None
    rows = []
    for i, run, frame_id, flow in point_flows(runs, data, features.every):
        truth = truths[run.folder]
        assert truth is not None, "looked at above"
        field = features.traction(flow, models[positions[i]])
        row = frame_errors(field, truth, frame_id, data.wrench[i, :3])
        rows += [] if row is None else [row]
    if not rows:
        return None
    pressure, traction, off_n, force_n = np.array(rows).T
    return FieldError(
        len(rows), float(pressure.mean()), float(traction.mean()),
        float((off_n / force_n).mean()), float(np.sqrt((off_n**2).mean())),
    )  # fmt: skip


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
