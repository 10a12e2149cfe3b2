"""The ATI Nano17, the bench's force and torque sensor: a bought part, kept as the room it takes.

    +-------+   z = height: the stage's side
    |       |   a cylinder of the published diameter and height; cable and holes are left out
    +-------+   z = 0: the tool's side, on the adapter

Frame: as the adapter's, z = 0 on it. Its numbers stand in `[adapter]`, with what is bolted to it.
"""

from __future__ import annotations

from ..dimensions import Design
from ..kernel import Shape
from ..part import BOUGHT, STEEL, Part, Shift
from ..solid_gate import Box, around
from .solids import cylinders


def box(design: Design) -> Box:
    """The cylinder."""
    radius = design.adapter.sensor_mm / 2
    return around(radius, radius, 0.0, design.adapter.sensor_height_mm)


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
        box,
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
