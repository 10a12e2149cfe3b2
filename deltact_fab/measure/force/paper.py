"""The paper's 3 x 6 model of force and force field (Contact Force Estimation, n = 3).

At each point the normal force is linear in D, D^2, D^3 of the non-negative density D, and either
shear force in a, a^2, a^3, b, b^2, b^3 of a = (h + r)_x and b = (h + r)_y; the paper prints the
columns of both shears the same. Summed over the view, the coefficients are fitted to the total, so
the field integrates to it. What the paper does not have is torque: here first moments stand for it.
"""

from __future__ import annotations

import numpy as np

from ...aliases import Array
from ..face import FaceFlow
from ..hodge import decompose
from ..hole_filling import whole
from ..shape.density import by_jacobian
from ..view import SensorView
from .model import ForceModel, LocalFeatures
from .sums import TURNING, integrals, turning
from .wrench import TractionField

_D = ("D mm2", "D^2 mm2", "D^3 mm2")
_A = ("a mm3", "a^2 mm4", "a^3 mm5")
_B = ("b mm3", "b^2 mm4", "b^3 mm5")
_XD = ("xD mm3", "xD^2 mm3", "xD^3 mm3")
_YD = ("yD mm3", "yD^2 mm3", "yD^3 mm3")


class Paper(LocalFeatures):
    """The model as it is printed.

    Its even powers take no part in a mirror: the face and its mirror image, pressed and sheared
    alike, are not told to have mirrored forces.
    """

    name = "paper"
    names = (*_D, *_A, *_B, *_XD, *_YD, *TURNING)
    explains = {  # noqa: RUF012
        "fx": _A + _B,
        "fy": _A + _B,
        "fz": _D,
        "tx": _YD,
        "ty": _XD,
        "tz": TURNING,
    }

    def __init__(self, view: SensorView) -> None:
        self._mm_per_px = view.camera.mm_per_px

    def of(self, flow: FaceFlow) -> Array:
        """(19,): the integrals of the terms over the view, and their first moments."""
        flow = whole(flow)
        parts = decompose(flow)
        terms = self._terms(flow, parts.hr)
        sums = np.transpose([integrals(term, flow) for term in terms])
        return np.concatenate((sums[0], *sums[1:, :3], turning(parts, flow)))

    def traction(self, flow: FaceFlow, model: ForceModel) -> TractionField:
        """The per-pixel force of the paper, here by area; it integrates to the model's force."""
        flow = whole(flow)
        terms = self._terms(flow, decompose(flow).hr)
        share = model.coefficients[:3, : len(terms)]
        field = np.tensordot(share, terms.astype(float), axes=1)
        return TractionField(np.moveaxis(field, 0, -1), flow.x_mm, flow.y_mm, flow.cover)

    def _terms(self, flow: FaceFlow, hr: Array) -> Array:
        """D, D^2, D^3, a, ..., b^3 at each point, (9, h, w)."""
        density = by_jacobian(flow, self._mm_per_px)
        one = (np.maximum(density.relative_depth, 0.0), hr[..., 0], hr[..., 1])
        return np.stack([power for a in one for power in (a, a * a, a * a * a)])
