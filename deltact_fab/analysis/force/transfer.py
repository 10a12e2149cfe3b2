"""Another sensor's calibration carried over from a few presses: its shape, with two new factors.

Gel of another modulus answers with the same field and another force, so all force scales alike;
another thickness or Poisson's ratio moves pressure against shear. So there is one factor for what
comes of pressure (fz, tx, ty) and one for what comes of shear (fx, fy, tz), and one press that is
sheared tells both.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...aliases import Array
from ...errors import InputError
from ...measure.force import COMPONENTS, ForceModel
from .dataset import ForceData
from .judge import fit, force_error_n, held_out

_SHEAR = np.isin(COMPONENTS, ("fx", "fy", "tz"))
MIN_SURE = 0.1
"""Standard error of a factor above which the presses do not determine it."""
CLEARLY = 0.8
"""Of the transfer's error, below which a fresh fit's is called better."""


@dataclass(frozen=True)
class TransferredCalibration:
    """A calibration carried over by two factors, pressure and shear.

    shear_known: False where the presses were not sheared enough, and shear took pressure's factor.
    Errors of the force, None where they could not be told: error_n at a position left out,
    fresh_error_n the same of a new fit of the same features, as_is_error_n of the calibration as it
    came.
    """

    model: ForceModel
    pressure: float
    shear: float
    shear_known: bool
    presses: int
    error_n: float | None
    fresh_error_n: float | None
    as_is_error_n: float | None

    @property
    def line(self) -> str:
        """What was done, and what it is worth beside a fresh fit."""
        text = (
            f"carried over from {self.presses} presses: pressure x {self.pressure:.3f}, "
            f"shear x {self.shear:.3f}"
        )
        if not self.shear_known:
            text += " (that of pressure: these presses do not determine it)"
        if self.error_n is None:
            return f"{text}; press at a second place to estimate the error"
        fresh = "cannot be made" if self.fresh_error_n is None else f"{self.fresh_error_n:.2f} N"
        text += (
            f"; error of the force {self.error_n:.2f} N on a position left out (as it came "
            f"{self.as_is_error_n:.2f} N; a fresh fit {fresh})"
        )
        if self.fresh_error_n is not None and self.fresh_error_n < CLEARLY * self.error_n:
            text += ": the fresh fit is better, leave --transfer out"
        return text

    def as_dict(self) -> dict[str, Any]:
        """Plain data, without the model."""
        return {key: value for key, value in vars(self).items() if key != "model"}


def transfer(model: ForceModel, data: ForceData) -> TransferredCalibration:
    """Fit the two factors, and judge them place by place.

    Raises InputError for presses that say nothing of pressure.
    """
    X, wrench = data.features[model.features], data.wrench
    as_is = model.predict(X)
    pressure, shear, known = _factors(as_is, wrench)

    def moved(fitted: Array, judged: Array) -> Array:
        pressure, shear, _ = _factors(as_is[fitted], wrench[fitted])
        return as_is[judged] * np.where(_SHEAR, shear, pressure)

    def fresh(fitted: Array, judged: Array) -> Array:
        return fit(data, model.features, fitted).predict(X[judged])

    error_n, fresh_n = (
        force_error_n(held_out(data.points, wrench, "position", 0, how) - wrench)
        for how in (moved, fresh)
    )
    scaled = model.coefficients * np.where(_SHEAR, shear, pressure)[:, None]
    return TransferredCalibration(
        replace(model, coefficients=scaled), pressure, shear, known,
        data.points["press"].nunique(), error_n, fresh_n, force_error_n(as_is - wrench),
    )  # fmt: skip


def _factors(predicted: Array, wrench: Array) -> tuple[float, float, bool]:
    """Factors of pressure and shear, and whether the presses determined the second."""
    pressure, sure = _factor(predicted[:, 2], wrench[:, 2])
    if sure > MIN_SURE:
        raise InputError(
            "transfer: the presses do not determine the factor of the normal force "
            f"({pressure:.2f} +- {sure:.2f}); press deeper, or on more places"
        )
    shear, sure = _factor(predicted[:, :2].ravel(), wrench[:, :2].ravel())
    return (pressure, shear, True) if sure <= MIN_SURE else (pressure, pressure, False)


def _factor(p: Array, y: Array) -> tuple[float, float]:
    """Least squares of measured on predicted through 0, and its standard error."""
    size = float(p @ p)
    if size == 0 or len(p) < 2:
        return 1.0, np.inf
    factor = float(p @ y) / size
    return factor, float(np.sqrt(np.sum((y - factor * p) ** 2) / (len(p) - 1) / size))
