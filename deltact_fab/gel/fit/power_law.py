"""Force between solved depths: log F over log d as a monotone cubic (PCHIP).

There a power law (a sphere's d^1.5, a punch's d) is a straight line.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...aliases import Field


class PowerLaw(NamedTuple):
    """Monotone cubic of log force over log depth, its start, the exponent before it."""

    curve: Any
    start: float
    power: float


def interpolant(depth_mm: Field, normal_n: Field) -> PowerLaw:
    """Through depths (n,) above 0, rising, and forces (n,) above 0."""
    from scipy.interpolate import PchipInterpolator

    x, y = np.log(depth_mm), np.log(normal_n)
    curve = PchipInterpolator(x, y)
    # The exponent of the first interval; the one-sided slope of PCHIP is noisier.
    return PowerLaw(curve, float(x[0]), float((y[1] - y[0]) / (x[1] - x[0])))


def evaluated(law: PowerLaw, at_mm: Field) -> Field:
    """Value at depths of 0 or more; a power law before the first point."""
    touched = at_mm > 0
    t = np.log(np.where(touched, at_mm, 1.0))
    inner, before = np.maximum(t, law.start), np.minimum(t - law.start, 0.0)
    return np.where(touched, np.exp(law.curve(inner) + law.power * before), 0.0)


def left_out(depth_mm: Field, normal_n: Field) -> float:
    """Largest relative error at a point, but the end points, interpolated from the others."""
    worst = 0.0
    for k in range(1, len(depth_mm) - 1):
        kept = np.arange(len(depth_mm)) != k
        law = interpolant(depth_mm[kept], normal_n[kept])
        value = evaluated(law, depth_mm[k : k + 1])
        worst = max(worst, abs(float(value[0]) / float(normal_n[k]) - 1))
    return worst
