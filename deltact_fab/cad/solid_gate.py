"""The gate every solid passes: the kernel returns wrong shapes without an exception.

Seen from it: an empty compound that calls itself valid, an untouched box in place of a shell, two
solids where a hole split the part.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import RunFailed
from .kernel import show

Box = tuple[tuple[float, float, float], tuple[float, float, float]]
BOX_TOLERANCE_MM = 1e-5
VOLUME_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Expected:
    """What a part must be, from closed forms.

    volume_mm3: lowest and highest volume; equal where a closed form is exact.
    box_mm: (minimum, maximum) corners of the bounding box.
    parameters: the numbers the part was made from, for messages.
    """

    volume_mm3: tuple[float, float]
    box_mm: Box
    parameters: Mapping[str, float]

    @classmethod
    def exact(cls, volume_mm3: float, box_mm: Box, parameters: Mapping[str, float]) -> Expected:
        """Of a volume in closed form."""
        return cls((volume_mm3, volume_mm3), box_mm, parameters)


def around(half_x_mm: float, half_y_mm: float, low_mm: float, high_mm: float) -> Box:
    """The box about the z axis, from low to high."""
    return (-half_x_mm, -half_y_mm, low_mm), (half_x_mm, half_y_mm, high_mm)


@dataclass(frozen=True)
class SolidProperties:
    """What the kernel says of the solid before any mesh exists."""

    volume_mm3: float
    area_mm2: float
    box_mm: Box


def gate(part: str, shape: Any, expected: Expected) -> tuple[Any, SolidProperties]:
    """Check a shape and return its one Solid with its measures.

    Raises RunFailed naming part, finding and parameters unless the shape is exactly one valid
    solid with one shell, and its volume (relative 1e-6) and box (1e-5 mm) are as computed.
    """

    def fail(found: str) -> RunFailed:
        return RunFailed(f"{part}: {found}; parameters {show(expected.parameters)}")

    if flaw := flaw_of(shape):
        raise fail(flaw)
    (solid,) = shape.Solids()
    found = SolidProperties(float(solid.Volume()), float(solid.Area()), bounding_box(solid))
    low, high = expected.volume_mm3
    if not low * (1 - VOLUME_TOLERANCE) <= found.volume_mm3 <= high * (1 + VOLUME_TOLERANCE):
        right = f"{low:.6f}" if low == high else f"{low:.6f} to {high:.6f}"
        raise fail(f"volume {found.volume_mm3:.6f} mm3, expected {right}")
    if not np.allclose(found.box_mm, expected.box_mm, rtol=0, atol=BOX_TOLERANCE_MM):
        raise fail(f"bounding box {found.box_mm}, expected {expected.box_mm}")
    return solid, found


def flaw_of(shape: Any) -> str:
    """What keeps a shape from being one valid solid with one closed shell; empty when it is one."""
    solids = shape.Solids()
    if len(solids) != 1:
        return f"{len(solids)} solids, expected one"
    if not solids[0].isValid():
        return "the kernel calls it invalid"
    shells = solids[0].Shells()
    if len(shells) != 1:
        return f"{len(shells)} shells, expected one"
    return "" if shells[0].wrapped.Closed() else "its shell is open"


def bounding_box(solid: Any) -> Box:
    """Tight box of the exact surfaces, without the mesh and without the shape's tolerance."""
    from OCP.Bnd import Bnd_Box
    from OCP.BRepBndLib import BRepBndLib

    box = Bnd_Box()
    BRepBndLib.AddOptimal_s(solid.wrapped, box, False, False)
    box.SetGap(0.0)
    x0, y0, z0, x1, y1, z1 = box.Get()
    return (x0, y0, z0), (x1, y1, z1)
