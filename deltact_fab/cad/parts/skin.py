"""The skin: the clear silicone block behind the pattern (paper, Tactile Subsystem).

    z = 0               .--------------------.     edges of the touched face rounded, edge_fillet
                        |   width x length   |
    z = -protrusion     +--+              +--+     above: proud of the frame
                           |              |
    z = -thickness         +--------------+        below: fills the frame's window, notched around
                                                   its corner posts

The vertical edges stay sharp: the mold's cavity is the plain block above the frame.
"""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING

from ...shapes import SensorDimensions
from ..checks import Expected, less
from ..kernel import require
from .skin_frame import post_in_window_mm

if TYPE_CHECKING:
    from cadquery import Shape

NAME = "skin"


def expect(dims: SensorDimensions) -> Expected:
    """Closed forms of the skin. Raises InputError stating the inequality that fails.

    A fillet of radius R around a w x l face takes 2 (w + l) R^2 (1 - pi/4) - 4 R^3 (5/3 - pi/2):
    the second term is what two cylinders share where they meet in a mitre.
    """
    skin = dims.skin
    r = skin.edge_fillet_mm
    x, y = post_in_window_mm(dims)
    less(NAME, ("0", 0.0), ("edge_fillet_mm", r))
    less(NAME, ("edge_fillet_mm", r), ("protrusion_mm", skin.protrusion_mm))
    for side, notch, length in (("width", x, skin.width_mm), ("length", y, skin.length_mm)):
        less(NAME, ("2 edge_fillet_mm", 2 * r), (f"{side}_mm", length))
        less(NAME, (f"2 notches along the {side}", 2 * notch), (f"{side}_mm", length))
    below_mm = skin.thickness_mm - skin.protrusion_mm
    rounded_mm3 = 2 * (skin.width_mm + skin.length_mm) * r**2 * (1 - math.pi / 4)
    rounded_mm3 -= 4 * r**3 * (5 / 3 - math.pi / 2)
    block_mm3 = skin.width_mm * skin.length_mm * skin.thickness_mm
    volume_mm3 = block_mm3 - rounded_mm3 - 4 * x * y * below_mm
    half = (skin.width_mm / 2, skin.length_mm / 2)
    return Expected(
        (volume_mm3, volume_mm3),
        ((-half[0], -half[1], -skin.thickness_mm), (half[0], half[1], 0.0)),
        {**asdict(skin), "post_mm": dims.frame.post_mm},
    )


def build(dims: SensorDimensions) -> Shape:
    """The skin as one solid in the sensor frame, z from -thickness to 0."""
    cq = require()
    skin = dims.skin
    w, h = skin.width_mm / 2, skin.length_mm / 2
    x, y = post_in_window_mm(dims)
    below_mm = skin.thickness_mm - skin.protrusion_mm
    block = (
        cq.Workplane()
        .workplane(offset=-skin.thickness_mm)
        .rect(skin.width_mm, skin.length_mm)
        .extrude(skin.thickness_mm)
        .faces(">Z")
        .edges()
        .fillet(skin.edge_fillet_mm)
    )
    if x == 0 or below_mm == 0:
        return block.val()
    # One millimetre longer on the three outer sides, so that no face of the cutter coincides.
    notches = (
        cq.Workplane()
        .workplane(offset=-skin.thickness_mm - 1)
        .pushPoints([(sx * (w - x / 2 + 0.5), sy * (h - y / 2 + 0.5)) for sx, sy in CORNERS])
        .rect(x + 1, y + 1)
        .extrude(below_mm + 1)
    )
    return block.cut(notches).val()


CORNERS = ((-1, -1), (1, -1), (-1, 1), (1, 1))
