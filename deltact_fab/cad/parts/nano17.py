"""The ATI Nano17, the bench's force and torque sensor: a bought part, kept as the room it takes.

    +-------+   z = height: the stage's side
    |       |   a cylinder of the published diameter and height; cable and holes are left out
    +-------+   z = 0: the tool's side, on the adapter

Frame: as the adapter's, z = 0 on it. Its numbers stand in `[adapter]`, with what is bolted to it.
"""

from __future__ import annotations

import math

from ..dimensions import Design
from ..kernel import Shape
from ..part import BOUGHT, STEEL, Part, Shift
from ..solid_gate import Expected, around
from .solids import cylinders


def expect(design: Design) -> Expected:
    """Closed forms of a cylinder."""
    r, high = design.adapter.sensor_mm / 2, design.adapter.sensor_height_mm
    volume_mm3 = math.pi * r**2 * high
    about = {"diameter_mm": 2 * r, "height_mm": high}
    return Expected.exact(volume_mm3, around(r, r, 0.0, high), about)


def build(design: Design) -> Shape:
    """The cylinder as one solid."""
    return cylinders([(0, 0)], design.adapter.sensor_mm, 0, design.adapter.sensor_height_mm).val()


def places(design: Design) -> list[Shift]:
    """On the adapter, which lies on the tool holder's flange."""
    return [(0.0, 0.0, design.tool.height_mm + design.adapter.thickness_mm)]


PARTS = (
    Part(
        "nano17",
        "ATI Nano17, six axes",
        BOUGHT,
        build,
        expect,
        group="bench",
        explode_mm=100.0,
        colour=STEEL,
        places=places,
        sections=("adapter",),
        note="{d.adapter.sensor_mm:g} mm wide, {d.adapter.sensor_height_mm:g} mm high as published",
        how="bought",
        look_for="measure its diameter, height and bolt circle before the adapter is printed",
    ),
)
