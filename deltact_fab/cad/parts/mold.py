"""The mold that the skins are cast in, several at a time (paper, Fabrication Process).

Section of one cavity, along x:                     Seen from above, 2 x 2:

    z = top       --+      frame      +--           +-----------------+
                    |                 |             |  +--+     +--+  |  web, pry notch
    z = seat        +--+           +--+             | +----+   +----+ |
                       |   skin    |                | | [] |   | [] | |
    z = base            '---------'                 | +----+   +----+ |
    z = 0         ---------------------             |  +--+     +--+  |

Frame: z = 0 is the underside, z up; x and y as in the sensor, from the middle of the mold. The
sensor frame is turned half about x: the touched face lies at the bottom, at z = base.

The skin frame is an insert, outer face down, so that a cavity is the protruding part of the skin
alone; what is behind it fills the frame's window. On both y sides of a seat a notch as deep as the
seat takes the blade that lifts the frame out. Every wall is upright: the silicone gives way.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from ..checks import Expected
from ..dimensions import Design, Point2
from ..kernel import require
from .skin_frame import window_area_mm2

if TYPE_CHECKING:
    from cadquery import Shape

NAME = "mold"


def centres_mm(design: Design) -> list[Point2]:
    """Axes of the cavities, row by row; pitch = frame + web."""
    mold = design.mold
    x, y = (side + mold.web_mm for side in design.frame_outer_mm)
    return [
        (x * (column - (mold.columns - 1) / 2), y * (row - (mold.rows - 1) / 2))
        for row in range(mold.rows)
        for column in range(mold.columns)
    ]


def seat_mm(design: Design) -> Point2:
    """Sides of a seat = frame + 2 fit: (39.2, 40.2)."""
    x, y = design.frame_outer_mm
    return x + 2 * design.mold.fit_mm, y + 2 * design.mold.fit_mm


def cavity_volume_mm3(design: Design) -> float:
    """Volume of one cavity = skin - the frame's window in front of the ledge.

    That window is (thickness - protrusion) deep, and the frame brings it along.
    """
    behind_mm = design.skin.thickness_mm - design.skin.protrusion_mm
    return design.skin_volume_mm3 - window_area_mm2(design) * behind_mm


def expect(design: Design) -> Expected:
    """Closed forms of the mold."""
    mold, (x, y, z) = design.mold, design.mold_outer_mm
    seat = seat_mm(design)
    cut_mm2 = seat[0] * seat[1] + 2 * mold.pry_width_mm * mold.pry_mm
    cut_mm3 = cavity_volume_mm3(design) + cut_mm2 * mold.seat_mm
    volume_mm3 = x * y * z - mold.columns * mold.rows * cut_mm3
    return Expected(
        (volume_mm3, volume_mm3),
        ((-x / 2, -y / 2, 0.0), (x / 2, y / 2, z)),
        {**asdict(design.skin), **asdict(mold)},
    )


def build(design: Design) -> Shape:
    """The mold as one solid in its own frame, z from 0 to its top."""
    cq = require()
    x, y, z = design.mold_outer_mm
    block = cq.Workplane().rect(x, y).extrude(z).val()
    cutter = _cutter(cq, design)
    return block.cut(*(cutter.moved(cq.Location((*at, 0.0))) for at in centres_mm(design)))


def _cutter(cq: Any, design: Design) -> Any:
    """What is cut away for one skin with its frame: cavity, seat, notches; 1 mm over the top."""
    mold, skin = design.mold, design.skin
    floor_mm = mold.base_mm + skin.protrusion_mm
    x, y = seat_mm(design)
    cavity = (
        cq.Workplane()
        .workplane(offset=mold.base_mm)
        .rect(skin.width_mm, skin.length_mm)
        .extrude(skin.protrusion_mm + 1)
        .faces("<Z")
        .edges()
        .fillet(skin.edge_fillet_mm)
    )
    above = cq.Workplane().workplane(offset=floor_mm)
    seat = above.rect(x, y).extrude(mold.seat_mm + 1)
    notches = above.rect(mold.pry_width_mm, y + 2 * mold.pry_mm).extrude(mold.seat_mm + 1)
    return cavity.union(seat).union(notches).val()
