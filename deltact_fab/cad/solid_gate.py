"""The gate every solid passes: the kernel returns wrong shapes without an exception.

Seen from it: an empty compound that calls itself valid, an untouched box in place of a shell, two
solids where a hole split the part.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..aliases import Point
from ..errors import RunFailed

Box = tuple[tuple[float, float, float], tuple[float, float, float]]
BOX_TOLERANCE_MM = 1e-5
VOLUME_TOLERANCE = 1e-6


def around(half_x_mm: float, half_y_mm: float, low_mm: float, high_mm: float) -> Box:
    """The box about the z axis, from low to high."""
    return (-half_x_mm, -half_y_mm, low_mm), (half_x_mm, half_y_mm, high_mm)


def shifted(box: Box, by_mm: Point) -> Box:
    """The box moved."""
    low, high = ((x + by_mm[0], y + by_mm[1], z + by_mm[2]) for x, y, z in box)
    return low, high


def enclosing(boxes: Iterable[Box]) -> Box:
    """The box around boxes, of which there is one at least."""
    lows, highs = zip(*boxes, strict=True)
    (x0, y0, z0), (x1, y1, z1) = np.min(lows, axis=0).tolist(), np.max(highs, axis=0).tolist()
    return (x0, y0, z0), (x1, y1, z1)


@dataclass(frozen=True)
class SolidProperties:
    """What the kernel says of the solid before any mesh exists."""

    volume_mm3: float
    area_mm2: float
    box_mm: Box


def gate(part: str, shape: Any, box_mm: Box) -> tuple[Any, SolidProperties]:
    """Check a shape and return its one Solid with its measures.

    Raises RunFailed naming part and finding unless the shape is exactly one valid solid with one
    closed shell, within 1e-5 mm in the box that its dimensions give. Volumes are held against
    closed forms by the tests.
    """
    if flaw := flaw_of(shape):
        raise RunFailed(f"{part}: {flaw}")
    (solid,) = shape.Solids()
    found = SolidProperties(float(solid.Volume()), float(solid.Area()), bounding_box(solid))
    if not np.allclose(found.box_mm, box_mm, rtol=0, atol=BOX_TOLERANCE_MM):
        raise RunFailed(f"{part}: bounding box {found.box_mm}, expected {box_mm}")
    if not found.volume_mm3 > 0:
        raise RunFailed(f"{part}: volume {found.volume_mm3:.6f} mm3: it is inside out")
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
