"""The end-effector mount on the shell's +y side (paper: 20 mm long, to be redesigned at will).

    block, seen along -z        franka, seen along x          plate, seen along -z

    |        | shell            shell |       | flange        |          |
    +-+----+-+                        |       +---+           +----------+
      | o  |                    ------+       | = |  upper    |          |  outer x wide,
      |    |  width x length          +-------+   |           |          |  as high as the
      | o  |  holes along z           |  arm      |           +----------+  shell, no holes
      +----+                          +-------+   |
                                ------+       | = |  lower

The flange's screws run along y, and the sensor's body stands behind both of them: no driver comes
straight at a head. So the arm meets the flange in its middle, between the screws, and each head or
nut has the room of a washer above or below it, open to three sides. A cap screw goes in from the
sensor's side and is turned with a key whose short leg fits into the gap; or the screw comes from
the finger and the nut is held by pliers. The hole pattern is unverified.

A mount wider than the wall between the cover's bosses keeps `cover.fit_mm` from them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from ..checks import Box, Expected
from ..dimensions import Design
from ..kernel import require

if TYPE_CHECKING:
    from cadquery import Workplane

NAME = "mount"
Point3 = tuple[float, float, float]


def bars(design: Design) -> list[Box]:
    """The mount's cuboids without holes, the one at the shell first; (low, high) corners, mm."""
    mount, z = design.mount, design.z_floor_mm
    outer_x, outer_y = design.frame_outer_mm
    y = outer_y / 2
    end = y + mount.length_mm
    half = mount.width_mm / 2
    if mount.kind == "block":
        return [((-half, y, z), (half, end, z + mount.height_mm))]
    if mount.kind == "plate":
        return [((-outer_x / 2, y, z), (outer_x / 2, end, design.z_joint_mm))]
    back, front = design.flange_arm_z_mm
    root = end - mount.flange_mm
    wide = mount.flange_width_mm / 2
    return [
        ((-half, y, back), (half, root, front)),
        ((-wide, root, z), (wide, end, z + mount.flange_height_mm)),
    ]


def hole_axes(design: Design) -> list[tuple[Point3, Point3]]:
    """Both ends of each through hole's axis: along z in a block, along y in a flange."""
    mount = design.mount
    (x0, y0, z0), (x1, y1, z1) = bars(design)[-1]
    x, y, z = (x0 + x1) / 2, (y0 + y1) / 2, (z0 + z1) / 2
    if mount.kind == "block":
        rows = (y - mount.hole_pitch_mm / 2, y + mount.hole_pitch_mm / 2)
        return [((x, row, z0), (x, row, z1)) for row in rows]
    if mount.kind == "franka":
        rows = (z - mount.flange_pitch_mm / 2, z + mount.flange_pitch_mm / 2)
        return [((x, y0, row), (x, y1, row)) for row in rows]
    return []


def relief_mm3(design: Design) -> float:
    """What the cover's bosses take of the mount, fit deep, on both sides together."""
    (_, _, low), (x, _, high) = bars(design)[0]
    outer_x, _ = design.frame_outer_mm
    width_mm = max(x - (outer_x / 2 - design.boss_room_mm), 0.0)
    height_mm = max(min(high, design.z_boss_mm) - low, 0.0)
    return 2 * width_mm * height_mm * design.cover.fit_mm


def expect(design: Design) -> Expected:
    """Closed forms of the mount alone = cuboids - two holes - relief."""
    mount, cuboids = design.mount, bars(design)
    volume_mm3 = sum(math.prod(b - a for a, b in zip(*box, strict=True)) for box in cuboids)
    drilled_mm = sum(math.dist(*axis) for axis in hole_axes(design))
    volume_mm3 -= math.pi / 4 * mount.hole_mm**2 * drilled_mm + relief_mm3(design)
    (x0, y0, z0), (x1, y1, z1) = cuboids[0]
    for low, high in cuboids[1:]:
        x0, y0, z0 = min(x0, low[0]), min(y0, low[1]), min(z0, low[2])
        x1, y1, z1 = max(x1, high[0]), max(y1, high[1]), max(z1, high[2])
    return Expected(
        (volume_mm3, volume_mm3),
        ((x0, y0, z0), (x1, y1, z1)),
        {
            "length_mm": mount.length_mm,
            "width_mm": mount.width_mm,
            "height_mm": mount.height_mm,
            "hole_pitch_mm": mount.hole_pitch_mm,
            "flange_mm": mount.flange_mm,
            "flange_width_mm": mount.flange_width_mm,
            "flange_height_mm": mount.flange_height_mm,
            "flange_pitch_mm": mount.flange_pitch_mm,
            "arm_mm": mount.arm_mm,
        },
    )


def build(design: Design) -> Workplane:
    """The mount alone in the sensor frame; it touches the shell's +y face and overlaps nothing."""
    cq = require()
    first, *others = bars(design)
    body = cuboid(cq, first)
    for box in others:
        body = body.union(cuboid(cq, box))
    if design.z_boss_mm > design.z_floor_mm:
        body = body.cut(boss_room(cq, design))
    for start, end in hole_axes(design):
        axis = cq.Vector(*end) - cq.Vector(*start)
        along = axis.normalized()
        radius = design.mount.hole_mm / 2
        drill = cq.Solid.makeCylinder(radius, axis.Length + 2, cq.Vector(*start) - along, along)
        body = body.cut(cq.Workplane(drill))
    return body


def cuboid(cq: Any, box: Box) -> Workplane:
    """A box from corner to corner."""
    low, high = box
    size = [b - a for a, b in zip(low, high, strict=True)]
    return cq.Workplane(cq.Solid.makeBox(*size, cq.Vector(*low)))


def boss_room(cq: Any, design: Design) -> Workplane:
    """Cutter of the four corners below z_boss: boss + fit, inwards and outwards alike."""
    x, y = (side / 2 for side in design.frame_outer_mm)
    fit, room, low = design.cover.fit_mm, design.boss_room_mm, design.z_floor_mm - 1
    square = room + fit
    plan = cq.Workplane().workplane(offset=low).pushPoints(
        [(sx * (x + fit - square / 2), sy * (y + fit - square / 2))
         for sx in (-1, 1) for sy in (-1, 1)]
    )  # fmt: skip
    return plan.rect(square, square).extrude(design.z_boss_mm - low)
