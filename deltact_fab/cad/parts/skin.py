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

from collections.abc import Iterator

from ..dimensions import Design
from ..kernel import Shape, cuboid, require
from ..part import CLEAR, Part
from ..rule import Quantity, Rule
from ..solid_gate import Box, around


def box(design: Design) -> Box:
    """The plain block."""
    skin = design.skin
    return around(skin.width_mm / 2, skin.length_mm / 2, -skin.thickness_mm, 0.0)


def build(design: Design) -> Shape:
    """The skin as one solid in the sensor frame, z from -thickness to 0."""
    cq = require()
    skin = design.skin
    w, h = skin.width_mm / 2, skin.length_mm / 2
    x, y = design.post_in_window_mm
    below_mm = skin.thickness_mm - skin.protrusion_mm
    block = cuboid(around(w, h, -skin.thickness_mm, 0.0))
    block = block.faces(">Z").edges().fillet(skin.edge_fillet_mm)
    if x == 0 or below_mm == 0:
        return block.val()
    # One millimetre longer on the three outer sides, so that no face of the cutter coincides.
    corners = [(sx * (w - (x - 1) / 2), sy * (h - (y - 1) / 2)) for sx in (-1, 1) for sy in (-1, 1)]
    notches = cq.Workplane().workplane(offset=-skin.thickness_mm - 1).pushPoints(corners)
    return block.cut(notches.rect(x + 1, y + 1).extrude(below_mm + 1)).val()


def rules(d: Design) -> Iterator[Rule]:
    """The camera's picture ends within the face: there is nothing to see beside it."""
    for view_mm, px, side in zip(
        d.optics.view_mm, ("width", "height"), ("width", "length"), strict=True
    ):
        view = Quantity(f"view (optics.image_{px}_px x mm_per_px)", view_mm)
        yield view.at_most(f"skin.{side}_mm", getattr(d.skin, f"{side}_mm"))


def note(d: Design) -> str:
    """How much silicone one takes."""
    return f"{d.skin_volume_mm3 / 1000:.2f} cm³ each; see Solaris"


PARTS = (
    Part(
        "skin",
        "Solaris silicone, Shore 15A, clear, 1:1",
        "cast in the mold",
        build,
        box,
        explode_mm=46,
        colour=CLEAR,
        sections=("skin", "frame", "screw", "shell"),
        derived=("post_in_window_mm",),
        rules=rules,
        note=note,
        how="cast in its frame, step D",
        look_for="clear, dry, bonded to the acrylic",
    ),
)
