"""The paper's estimators (Contact Force Estimation): its simple sums, and its 3 x 6 model (n = 3).

In the model, the normal force at each point is linear in D, D^2, D^3 of the non-negative density
D, and either shear force in a, a^2, a^3, b, b^2, b^3 of a = (h + r)_x and b = (h + r)_y; the paper
prints the same columns for both shears. Coefficients are fitted to the totals over the view, so the
field integrates to them. The paper has no torque: first moments are used for it here.

Sums are multiplied by the area of a point's cell, so that they do not depend on the spacing.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from deltact_fab.common import Array

from ..face import FaceFlow, fill_unknown
from ..hodge import Hodge
from ..sensor_id import SensorModel
from ..shape.density import jacobian_density
from .model import Features, ForceModel, TractionField

TURNING_LABELS = ("x ry mm4", "y rx mm4", "x hy mm4", "y hx mm4")
_D_LABELS = ("D mm2", "D^2 mm2", "D^3 mm2")
_A_LABELS = ("a mm3", "a^2 mm4", "a^3 mm5")
_B_LABELS = ("b mm3", "b^2 mm4", "b^3 mm5")
_XD_LABELS = ("xD mm3", "xD^2 mm3", "xD^3 mm3")
_YD_LABELS = ("yD mm3", "yD^2 mm3", "yD^3 mm3")


class Sums(Features):
    """Sum of |d| for the normal force, sum of V for shear, first moments for torque.

    The paper takes the norm of the sum of V; its two components give the direction too.
    """

    name = "sums"
    names = ("|d| mm3", "x|d| mm4", "y|d| mm4", "Vx mm3", "Vy mm3", *TURNING_LABELS)
    explains = {  # noqa: RUF012
        "fx": ("Vx mm3",),
        "fy": ("Vy mm3",),
        "fz": ("|d| mm3",),
        "tx": ("y|d| mm4", "Vy mm3"),
        "ty": ("x|d| mm4", "Vx mm3"),
        "tz": TURNING_LABELS,
    }

    def __init__(self, view: SensorModel) -> None:
        """Ignore the view; no property of the sensor is needed."""

    def compute(self, flow: FaceFlow) -> Array:
        """Features (9,) in mm3 and mm4."""
        flow = fill_unknown(flow)
        parts = Hodge(flow.shift_mm)
        spread = np.sqrt(np.einsum("...i,...i", parts.d, parts.d))
        shear = [integrals(flow.shift_mm[..., i], flow)[0] for i in (0, 1)]
        return np.concatenate((integrals(spread, flow), shear, turning(parts, flow)))


def integrals(values: Array, flow: FaceFlow) -> Array:
    """Integrals (3,) over the view of values (h, w) at a flow's points, and of x, y times them."""
    columns, rows = values.sum(axis=0, dtype=float), values.sum(axis=1, dtype=float)
    return np.array([columns.sum(), columns @ flow.x_mm, rows @ flow.y_mm]) * flow.cell_mm**2


def turning(parts: Hodge, flow: FaceFlow) -> Array:
    """Moments (4,) about the face's centre of the divergence-free parts, see TURNING_LABELS.

    A twist on the spot is in r, and a shear force off the centre in h too; the gel's stiffness
    differs between the two.
    """
    fields = (parts.r, parts.h)
    pairs = [(integrals(p[..., 1], flow)[1], integrals(p[..., 0], flow)[2]) for p in fields]
    return np.concatenate(pairs)


class Paper(Features):
    """The paper's model as printed.

    Its even powers break mirror symmetry: mirrored presses do not give mirrored forces. signed: use
    the density below 0 too, which the paper clips ("non-negative") and which shear produces as much
    as positive density.
    """

    name = "paper"
    local = True
    names = (*_D_LABELS, *_A_LABELS, *_B_LABELS, *_XD_LABELS, *_YD_LABELS, *TURNING_LABELS)
    explains = {  # noqa: RUF012
        "fx": _A_LABELS + _B_LABELS,
        "fy": _A_LABELS + _B_LABELS,
        "fz": _D_LABELS,
        "tx": _YD_LABELS,
        "ty": _XD_LABELS,
        "tz": TURNING_LABELS,
    }

    def __init__(self, view: SensorModel, signed: bool = False) -> None:
        self._mm_per_px = view.camera.mm_per_px
        self._min_density = -np.inf if signed else 0.0
        if signed:
            self.name = "paper-signed"

    def compute(self, flow: FaceFlow) -> Array:
        """Integrals of the terms over the view, and their first moments, (19,)."""
        flow = fill_unknown(flow)
        parts = Hodge(flow.shift_mm)
        terms = self._terms(flow, parts.hr)
        sums = np.transpose([integrals(term, flow) for term in terms])
        return np.concatenate((sums[0], *sums[1:, :3], turning(parts, flow)))

    def traction(self, flow: FaceFlow, model: ForceModel) -> TractionField:
        """The paper's force per pixel, here per area; it integrates to the model's force."""
        flow = fill_unknown(flow)
        terms = self._terms(flow, Hodge(flow.shift_mm).hr)
        share = model.coefficients[:3, : len(terms)]
        field = np.tensordot(share, terms.astype(float), axes=1)
        return TractionField(np.moveaxis(field, 0, -1), flow.x_mm, flow.y_mm, flow.cover)

    def _terms(self, flow: FaceFlow, hr: Array) -> Array:
        """Terms D, D^2, D^3, a, ..., b^3 at each point, (9, h, w)."""
        density = jacobian_density(flow, self._mm_per_px)
        bases = (np.maximum(density.relative_depth, self._min_density), hr[..., 0], hr[..., 1])
        return np.stack([power for a in bases for power in (a, a * a, a * a * a)])


Signed = partial(Paper, signed=True)
