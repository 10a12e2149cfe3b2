"""What a frame says of the force on the sensor: in all, and where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...aliases import Array

COMPONENTS = ("fx", "fy", "fz", "tx", "ty", "tz")
"""Order of a wrench (6,): N on the sensor, and N mm about the centre of its resting face."""


@dataclass(frozen=True)
class Wrench:
    """Force and torque on the sensor about the centre of its resting face; a press has Fz < 0.

    force_n, torque_nmm (3,) float64, nan where it was not calibrated. cover: share of the points
    it rests on whose motion is known; where it is 0 nothing was seen and the wrench is 0.
    extrapolated: a feature lies beyond what the model was trained on, so no error that was measured
    then holds.
    """

    force_n: Array
    torque_nmm: Array
    cover: float
    extrapolated: bool


@dataclass(frozen=True)
class TractionField:
    """Traction on the sensor at points of the resting face, (ny, nx, 3) float64, MPa = N / mm2.

    x_mm (nx,), y_mm (ny,): the points, equally spaced, each standing for its cell. cover: as of a
    Wrench.
    """

    traction_mpa: Array
    x_mm: Array
    y_mm: Array
    cover: float

    @property
    def cell_mm2(self) -> float:
        """Area that a point stands for."""
        return float((self.x_mm[1] - self.x_mm[0]) * (self.y_mm[1] - self.y_mm[0]))

    @property
    def pressed(self) -> bool:
        """Whether anything touches the face."""
        return bool(self.traction_mpa[..., 2].any())

    def centre_mm(self) -> Array:
        """Centre of the pressure on the resting face, (2,); its middle where nothing presses."""
        pressure = self.traction_mpa[..., 2]
        total = pressure.sum() or 1.0
        return np.array([(pressure @ self.x_mm).sum(), (self.y_mm @ pressure).sum()]) / total

    @property
    def force_n(self) -> Array:
        """Its integral, (3,)."""
        return np.asarray(self.traction_mpa.sum(axis=(0, 1), dtype=float) * self.cell_mm2)

    @property
    def torque_nmm(self) -> Array:
        """Its moment about the centre of the resting face, (3,), taken on the resting face."""
        tx, ty, tz = np.moveaxis(self.traction_mpa, -1, 0)
        x, y = self.x_mm, self.y_mm[:, None]
        moments = [(y * tz).sum(), -(x * tz).sum(), (x * ty - y * tx).sum()]
        return np.array(moments) * self.cell_mm2
