"""Contact forces on a bench that is not where its rig file says, in closed form.

A gel of the design lies somewhere else, and askew; every indenter has a length of its own. A tip
that goes below the true face meets Hertz' force, made stiffer by the acrylic under it, or that of a
flat punch. Nothing is drawn and nothing solved: `GelScene`
is the gel of an experiment, this is the one that a tool is found on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Point
from deltact_fab.sensor import (
    EllipsoidTip,
    GelMaterial,
    Indenter,
    PosedTip,
    SkinDimensions,
    SphereTip,
    StageFrame,
    Tip,
    flat_punch_n_per_mm,
    parse_indenter,
)

FLATNESS_MM = 0.05  # by hand: underside within this of its lowest point touches at once
# Dimitriadis et al. (2002): an incompressible layer that is bonded, powers of sqrt(R d)/h.
_DIMITRIADIS_C = (1.0, 1.133, 1.283, 0.769, 0.0975)


def hertz_force_n(radius_mm: float, depth_mm: float, material: GelMaterial) -> float:
    """Rigid paraboloid on a half-space: F = 4/3 E/(1 - nu^2) sqrt(R d^3), a = sqrt(R d)."""
    modulus = material.modulus_mpa / (1 - material.poisson**2)
    return 4 / 3 * modulus * math.sqrt(radius_mm * depth_mm**3)


@dataclass(frozen=True)
class _ContactTip:
    """One tip: where it is under the indenter's axis, its stiffness if it is flat."""

    at_mm: tuple[float, float]
    ball_mm: float  # its radius; 0: flat
    n_per_mm: float


class BenchFace:
    """A misplaced gel under a carriage, and the indenter that is mounted.

    frame: where the face truly lies for a tool of the length that the stage's origin was measured
    with. skin: its size and thickness; beside it there is nothing.
    """

    def __init__(self, frame: StageFrame, skin: SkinDimensions) -> None:
        self._frame = frame
        self._skin = skin
        self._material = GelMaterial()
        self._longer_mm = 0.0
        self._touching: Sequence[_ContactTip] = ()
        self.deepest_mm = -math.inf
        """Largest depth of the lowest tip below the true face over all calls of `wrench`."""

    def mount(self, indenter: Indenter | str, longer_mm: float = 0.0) -> None:
        """Mount an indenter whose tip is lower by this much than the one measured with."""
        self._longer_mm = longer_mm
        shape = parse_indenter(indenter) if isinstance(indenter, str) else indenter
        self._touching = [self._contact_tip(tip) for tip in shape.tips]

    def wrench(self, carriage_mm: Point) -> NDArray[np.float64]:
        """Force (N) and torque (N mm), (6,), with the carriage there, machine mm."""
        x, y, z = carriage_mm
        z -= self._longer_mm
        total = np.zeros(6)
        for touching in self._touching:
            radius = touching.ball_mm
            tip = (x + touching.at_mm[0], y + touching.at_mm[1], z + radius)
            at_x, at_y, height = self._frame.to_sensor_mm(tip)
            depth = radius - height
            self.deepest_mm = max(self.deepest_mm, depth)
            force = self._force_n(touching, depth, at_x, at_y)
            total += (0, 0, -force, -at_y * force, at_x * force, 0)
        return total

    def _force_n(self, touching: _ContactTip, depth_mm: float, x_mm: float, y_mm: float) -> float:
        half = self._skin.opening_half_mm
        if depth_mm <= 0 or abs(x_mm) > half[0] or abs(y_mm) > half[1]:
            return 0.0
        if not touching.ball_mm:
            return touching.n_per_mm * depth_mm
        chi = math.sqrt(touching.ball_mm * depth_mm) / self._skin.thickness_mm
        stiffer = sum(c * chi**k for k, c in enumerate(_DIMITRIADIS_C))
        return hertz_force_n(touching.ball_mm, depth_mm, self._material) * stiffer

    def _contact_tip(self, tip: Tip) -> _ContactTip:
        plain = tip.tip if isinstance(tip, PosedTip) else tip
        if isinstance(plain, SphereTip | EllipsoidTip):
            return _ContactTip(tip.lowest_mm, tip.radius_mm, 0.0)
        radius = math.sqrt(_flat_mm2(tip) / math.pi)
        stiffness = flat_punch_n_per_mm(radius, self._skin.thickness_mm, self._material)
        return _ContactTip((tip.x_mm, tip.y_mm), 0.0, stiffness)


def _flat_mm2(tip: Tip) -> float:
    """Area of an underside that is within FLAT_MM of its lowest point."""
    x, y = (np.linspace(-half, half, 201) for half in tip.half_mm)
    grid = np.meshgrid(x + tip.x_mm, y + tip.y_mm)
    # The lowest point of a tilted tip may lie between the points looked at.
    points = max((tip.height_mm(*grid) <= FLATNESS_MM).sum(), 1)
    return float(points * (x[1] - x[0]) * (y[1] - y[0]))
