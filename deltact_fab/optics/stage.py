"""The rigid transform between sensor and stage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class StageFrame:
    """Rigid transform between the sensor frame and the stage's machine frame.

    machine = rotation about z by angle_deg of the sensor point, then the origin added. The stage's
    z points up along the sensor's +z.
    """

    origin_machine_mm: tuple[float, float, float]
    angle_deg: float = 0.0

    def to_machine_mm(self, sensor_mm: tuple[float, float, float]) -> tuple[float, float, float]:
        """A tip position in the sensor frame to machine coordinates."""
        c, s = self._cos_sin()
        x, y, z = sensor_mm
        ox, oy, oz = self.origin_machine_mm
        return (ox + c * x - s * y, oy + s * x + c * y, oz + z)

    def to_sensor_mm(self, machine_mm: tuple[float, float, float]) -> tuple[float, float, float]:
        """Machine coordinates to a tip position in the sensor frame."""
        c, s = self._cos_sin()
        x, y, z = (m - o for m, o in zip(machine_mm, self.origin_machine_mm, strict=True))
        return (c * x + s * y, -s * x + c * y, z)

    def _cos_sin(self) -> tuple[float, float]:
        angle = np.deg2rad(self.angle_deg)
        return float(np.cos(angle)), float(np.sin(angle))
