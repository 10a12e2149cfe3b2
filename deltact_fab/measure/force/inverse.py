"""Force from the traction that the inverse of the face finds, and a few calibrated factors.

Its total is the force already, but for Young's modulus, which is not known, and a few percent that
linear elasticity leaves out: so a force needs a factor, which may depend a little on the place.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from ...aliases import Array
from ..face import FaceFlow
from ..view import SensorView
from .model import Features, ForceModel, TractionField
from .press import FaceInverse, inverse_for

_SUMS = ("Fx/E mm2", "Fy/E mm2", "Fz/E mm2", "Tx/E mm3", "Ty/E mm3", "Tz/E mm3")
_PLACED = ("Fx r2/E mm4", "Fy r2/E mm4", "Fz r2/E mm4")


class Inverse(Features):
    """Sums and moments of the inverse's traction: two factors a force, two a tilting torque.

    A force's second factor goes with the square of its distance from the centre: the centre gives
    some 3 % more than a place 8 mm off it. It is held at 0 as by a press of twenty states whose
    factor is known to 2 %. The traction is not in the resting face, so shear has an arm: a torque
    about x takes the force along y too, and one about y that along x.
    """

    name = "inverse-placed"
    rests_on_gel = local = True
    names = _SUMS + _PLACED
    held = dict.fromkeys(_PLACED, 130.0)  # in mm2
    explains = {  # noqa: RUF012
        "fx": ("Fx/E mm2", "Fx r2/E mm4"),
        "fy": ("Fy/E mm2", "Fy r2/E mm4"),
        "fz": ("Fz/E mm2", "Fz r2/E mm4"),
        "tx": ("Tx/E mm3", "Fy/E mm2"),
        "ty": ("Ty/E mm3", "Fx/E mm2"),
        "tz": ("Tz/E mm3",),
    }

    def __init__(self, view: SensorView) -> None:
        self.view = view

    @cached_property
    def inverse(self) -> FaceInverse:
        """The solver for the traction; made on first use."""
        return inverse_for(self.view)

    def of(self, flow: FaceFlow) -> Array:
        """(9,): force and torque for a modulus of 1 MPa, and force times the place's r^2."""
        press = self.inverse.of(flow)
        force, centre = press.force_n, press.centre_mm()
        return np.concatenate((force, press.torque_nmm, force * (centre @ centre)))

    def cover(self, flow: FaceFlow) -> float:
        """Share of what presses on the face whose motion is known."""
        return self.inverse.of(flow).cover

    def traction(self, flow: FaceFlow, model: ForceModel) -> TractionField:
        """The inverse's traction, scaled by a model so that its total is the model's force.

        Pressure is scaled as a whole. Shear takes the factor of its own total, and what the model
        says beyond that goes with the pressure, as friction would.
        """
        raw = self.inverse.of(flow)
        total = model.predict(self.of(flow)[None])[0, :3]
        if not raw.pressed:
            return raw
        share = raw.traction_mpa[..., 2] / raw.force_n[2]
        own = model.coefficients[:2, :2].diagonal()
        field = np.empty_like(raw.traction_mpa)
        field[..., 2] = share * total[2]
        field[..., :2] = raw.traction_mpa[..., :2] * own
        field[..., :2] += share[..., None] * (total[:2] - own * raw.force_n[:2])
        return replace(raw, traction_mpa=field)
