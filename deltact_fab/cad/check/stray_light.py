"""Light from outside: straight ways through the cable's notch to the lens or to the gel's back.

Straight ways only: what bounces off the black walls is left to the foam around the cable.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..rays import first_hit
from .built import BuiltDesign
from .pairs import pieces
from .row import Row

NAME = "no light through the notch"
ACROSS, UP = 9, 4  # places in the notch's mouth
TARGETS = 7  # a side, over the plate's back
CLEAR = ("acrylic", "skin")
# The board and its connector stop light wherever they are; the lens is what must not be reached.
FOAM_HEIGHTS = 2.0  # a plug shorter than that is pulled out with the cable
SHORT = 1 - 1e-3


def rows(built: BuiltDesign) -> Iterator[Row]:
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
    dark = [p for p in built.parts if p.group == "sensor" and p.name not in CLEAR]
    standing = pieces(dark, built)

    def is_open() -> list[bool]:
        corners = [built.mesh(p.part.name).corners_mm + np.array(p.shift_mm) for p in standing]
        far, _ = first_hit(start, way, np.concatenate(corners), 0.0)
        return list((far > SHORT).tolist())

    given = [start.tolist(), way.tolist(), [p.shift_mm for p in standing]]
    way_open = np.array(built.fact("open ways", [p.name for p in dark], is_open, given))
    through = int(way_open.sum())
    end = aims[np.flatnonzero(way_open) % len(aims)]
    # Where the open ways end: what the camera sees counts most, the plate's rim beside the ring
    # lies outside of its picture.
    lens = end[:, 2] < design.z_joint_mm
    view_x, view_y = design.optics.view_mm
    seen = ~lens & (np.abs(end[:, 0]) <= view_x / 2) & (np.abs(end[:, 1]) <= view_y / 2)
    on_lens, in_view = int(lens.sum()), int(seen.sum())
    foam = shell.cable_foam_mm
    closed = foam >= FOAM_HEIGHTS * shell.cable_height_mm
    found = (
        f"open without foam, of {len(way)} straight ways: {on_lens} to the lens, {in_view} to the "
        f"plate in view, {through - on_lens - in_view} to its rim beside it; foam {foam:g} mm"
    )
    limit = (
        f"none, or shell.cable_foam_mm >= {FOAM_HEIGHTS * shell.cable_height_mm:g} mm, "
        f"{FOAM_HEIGHTS:g} x the notch's height"
    )
    yield Row(NAME, "shell, camera, light-holder", found, limit, through == 0 or closed)
