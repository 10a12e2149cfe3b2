"""Light from outside: straight ways through the cable's notch to the lens or to the gel's back.

Straight ways only: what bounces off the black walls is left to the foam around the cable.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .built import Built
from .rays import first_hit
from .row import Row

NAME = "no light through the notch"
ACROSS, UP = 9, 4  # places in the notch's mouth
TARGETS = 7  # a side, over the plate's back
CLEAR = ("acrylic", "skin")
# The board and its connector stop light wherever they are; the lens is what must not be reached.
FOAM_HEIGHTS = 2.0  # a plug shorter than that is pulled out with the cable
SHORT = 1 - 1e-3


def rows(built: Built) -> Iterator[Row]:
    """Rays from the mouth of the open notch, without cable and foam."""
    design, (_, outer_y) = built.design, built.design.frame_outer_mm
    shell, low = design.shell, design.z_floor_mm
    inset = 1e-3
    x = np.linspace(-shell.cable_width_mm / 2 + inset, shell.cable_width_mm / 2 - inset, ACROSS)
    z = np.linspace(low + inset, low + shell.cable_height_mm - inset, UP)
    mouth = np.array([(a, -outer_y / 2 - inset, b) for a in x for b in z])
    half_x, half_y = design.ledge_half_mm
    across = np.linspace(-1 + inset, 1 - inset, TARGETS)
    back = [(half_x * a, half_y * b, design.z_joint_mm) for a in across for b in across]
    aims = np.array([(0.0, 0.0, design.z_lens_mm), *back])
    start = np.repeat(mouth, len(aims), axis=0)
    way = np.tile(aims, (len(mouth), 1)) - start
    names = [p.name for p in built.parts if p.group == "sensor" and p.name not in CLEAR]
    corners = np.concatenate(
        [
            built.mesh(part.name).corners_mm + np.array(shift)
            for part in built.parts
            if part.name in names
            for shift in part.places(design)
        ]
    )
    far, _ = first_hit(start, way, corners, 0.0)
    through = int((far > SHORT).sum())
    foam = shell.cable_foam_mm
    closed = foam >= FOAM_HEIGHTS * shell.cable_height_mm
    found = f"{through} of {len(far)} straight ways open without foam; foam {foam:g} mm"
    limit = f"0, or foam >= {FOAM_HEIGHTS:g} x the notch's height: shell.cable_foam_mm"
    yield Row(NAME, "shell, camera, light-holder", found, limit, through == 0 or closed)
