"""The rigid transform between sensor and stage."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from ..aliases import Vector


@dataclass(frozen=True)
class StageFrame:
    """Rigid transform between the sensor frame and the stage's machine frame.

    machine = Rz(angle) Ry(tilt[1]) Rx(tilt[0]) of the sensor point, then the origin added. Without
    a tilt the stage's z points up along the sensor's +z; with one the resting face lies as askew to
    the stage's axes as it was registered. Straight lines remain straight.
    """

    origin_machine_mm: Vector
    angle_deg: float = 0.0
    tilt_deg: tuple[float, float] = (0.0, 0.0)
    """Of the face, about the sensor's x, then about y."""

    def to_machine_mm(self, sensor_mm: Vector) -> Vector:
        """A tip position in the sensor frame to machine coordinates."""
        c, s = self._cos_sin()
        x, y, z = self._tilted(sensor_mm)
        ox, oy, oz = self.origin_machine_mm
        return (ox + c * x - s * y, oy + s * x + c * y, oz + z)

    def to_sensor_mm(self, machine_mm: Vector) -> Vector:
        """Machine coordinates to a tip position in the sensor frame."""
        c, s = self._cos_sin()
        x, y, z = (m - o for m, o in zip(machine_mm, self.origin_machine_mm, strict=True))
        return self._levelled((c * x + s * y, -s * x + c * y, z))

    def facing(self, normal_machine: Vector) -> StageFrame:
        """The same with the tilt of a face whose outward normal this is, of any length.

        Raises ValueError for a normal that does not point up.
        """
        length = math.hypot(*normal_machine)
        if not (math.isfinite(length) and normal_machine[2] > 0):
            raise ValueError(f"a face's normal {normal_machine} must point up (z > 0)")
        c, s = self._cos_sin()
        x, y, z = (n / length for n in normal_machine)
        x, y = c * x + s * y, -s * x + c * y
        tilt = (math.degrees(-math.asin(y)), math.degrees(math.atan2(x, z)))
        return dataclasses.replace(self, tilt_deg=tilt)

    def _cos_sin(self) -> tuple[float, float]:
        angle = np.deg2rad(self.angle_deg)
        return float(np.cos(angle)), float(np.sin(angle))

    def _tilted(self, p: Vector) -> Vector:
        if self.tilt_deg == (0.0, 0.0):
            return p  # to the bit
        (cx, sx), (cy, sy) = ((math.cos(a), math.sin(a)) for a in map(math.radians, self.tilt_deg))
        x, y, z = p[0], cx * p[1] - sx * p[2], sx * p[1] + cx * p[2]
        return (cy * x + sy * z, y, -sy * x + cy * z)

    def _levelled(self, p: Vector) -> Vector:
        if self.tilt_deg == (0.0, 0.0):
            return p
        (cx, sx), (cy, sy) = ((math.cos(a), math.sin(a)) for a in map(math.radians, self.tilt_deg))
        x, y, z = cy * p[0] - sy * p[2], p[1], sy * p[0] + cy * p[2]
        return (x, cx * y + sx * z, -sx * y + cx * z)
