"""Part 3, the sensor shell (paper, Mechanical Subsystem: opaque, walls of 1.5 mm).

Section below z_boss, seen along -z:     Section at x = 0:

            +-------+
            | mount |    y                z_joint  +-+-+               +-+-+
        +---+-------+---+  ^                       | |_| ledge         |_| |
    +---+   wall, ledge +---+                      | |                   | +-------+
    |   +---------------+   | +-> x                | |      cavity       | | mount |
    | |                   | |                      +-+                   | |       |
    | |      cavity       | |             z_floor  (cable notch)         +-+-------+
    | |                   | |
    |   +---------------+   |
    +---+  cable notch  +---+             -> y to the right

In each corner stands a post with a through hole on a screw's axis, from z_boss to the joint. Below
z_boss the cover's boss takes its place and the wall's, and keeps `cover.fit_mm` from the shell.
The ledges carry the acrylic's y edges from behind.

The testing shell has two tabs in place of the mount, one on each x side, by which it is screwed to
a table with the back of its cover on the table.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from ..checks import Box, Expected
from ..dimensions import Design
from ..kernel import require
from . import mount
from .acrylic import notched
from .mount import boss_room, cuboid

if TYPE_CHECKING:
    from cadquery import Shape, Workplane

NAME = "shell"


def expect(design: Design) -> Expected:
    """Closed forms of the shell with its mount: they share a face and no volume."""
    bare, added = _bare(design), mount.expect(design)
    volume_mm3 = bare.volume_mm3[0] + added.volume_mm3[0]
    (low, high), (low_m, high_m) = bare.box_mm, added.box_mm
    return Expected(
        (volume_mm3, volume_mm3),
        (
            (min(low[0], low_m[0]), low[1], min(low[2], low_m[2])),
            (max(high[0], high_m[0]), high_m[1], max(high[2], high_m[2])),
        ),
        {**bare.parameters, **{f"mount.{k}": v for k, v in added.parameters.items()}},
    )


def expect_testing(design: Design) -> Expected:
    """Closed forms of the testing shell; a tab = cuboid - holes - what clears the cover."""
    bare, table, fit = _bare(design), design.table, design.cover.fit_mm
    outer_x, outer_y = design.frame_outer_mm
    top = design.z_back_mm + table.height_mm
    beside_mm = max(table.width_mm / 2 - (outer_y / 2 - design.boss_room_mm), 0.0)
    boss_mm = max(min(design.z_boss_mm, top) - design.z_floor_mm, 0.0)
    tab_mm3 = table.tab_mm * table.width_mm * table.height_mm
    tab_mm3 -= 2 * math.pi / 4 * table.hole_mm**2 * table.height_mm
    tab_mm3 -= fit * (table.width_mm * design.cover.floor_mm + 2 * beside_mm * boss_mm)
    volume_mm3 = bare.volume_mm3[0] + 2 * tab_mm3
    reach = outer_x / 2 + table.tab_mm
    return Expected(
        (volume_mm3, volume_mm3),
        ((-reach, -outer_y / 2, design.z_back_mm), (reach, outer_y / 2, design.z_joint_mm)),
        {
            **bare.parameters,
            "table.tab_mm": table.tab_mm,
            "table.width_mm": table.width_mm,
            "table.height_mm": table.height_mm,
            "table.hole_pitch_mm": table.hole_pitch_mm,
        },
    )


def _bare(design: Design) -> Expected:
    """Closed forms of the shell without mount and tabs.

    Tube + posts beyond the wall - screw holes - wall beside the bosses + ledges - cable notch.
    """
    shell, (outer_x, outer_y) = design.shell, design.frame_outer_mm
    (x, y), wall, room = design.cavity_half_mm, shell.wall_mm, design.boss_room_mm
    post_mm = design.z_joint_mm - design.z_boss_mm
    boss_mm = design.z_boss_mm - design.z_floor_mm
    volume_mm3 = (outer_x * outer_y - 4 * x * y) * design.shell_depth_mm
    hole_mm2 = math.pi / 4 * design.screw.row.clearance_mm**2
    volume_mm3 += 4 * ((design.post_mm - wall) ** 2 - hole_mm2) * post_mm
    volume_mm3 -= 4 * (2 * room - wall) * wall * boss_mm
    volume_mm3 += 2 * 2 * design.post_edge_mm[0] * shell.ledge_mm * shell.ledge_height_mm
    volume_mm3 -= shell.cable_width_mm * shell.cable_height_mm * wall
    half = (outer_x / 2, outer_y / 2)
    return Expected(
        (volume_mm3, volume_mm3),
        ((-half[0], -half[1], design.z_floor_mm), (half[0], half[1], design.z_joint_mm)),
        {
            "outer_x_mm": outer_x,
            "outer_y_mm": outer_y,
            "depth_mm": design.shell_depth_mm,
            "wall_mm": wall,
            "post_mm": design.post_mm,
            "boss_mm": boss_mm,
            "cover.fit_mm": design.cover.fit_mm,
            "ledge_mm": shell.ledge_mm,
            "ledge_height_mm": shell.ledge_height_mm,
            "cable_width_mm": shell.cable_width_mm,
            "cable_height_mm": shell.cable_height_mm,
        },
    )


def build(design: Design) -> Shape:
    """The shell with its mount as one solid in the sensor frame."""
    cq = require()
    return _body(cq, design).union(mount.build(design)).val()


def build_testing(design: Design) -> Shape:
    """The shell with two table tabs in place of the mount, one solid in the sensor frame."""
    cq = require()
    return _body(cq, design).union(_tab(cq, design, -1)).union(_tab(cq, design, 1)).val()


def _body(cq: Any, design: Design) -> Workplane:
    """The shell without mount and tabs; the posts are what the cavity leaves."""
    shell, (x, y) = design.shell, design.cavity_half_mm
    outer_x, outer_y = design.frame_outer_mm
    floor, joint = design.z_floor_mm, design.z_joint_mm
    ledge = joint - shell.ledge_height_mm
    corner = (design.post_mm - shell.wall_mm, design.post_mm - shell.wall_mm)
    body = cuboid(cq, ((-outer_x / 2, -outer_y / 2, floor), (outer_x / 2, outer_y / 2, joint)))
    # One cutter inside the other: between the ledges the cavity is only narrower in y.
    for inward, low, high in ((0.0, floor - 1, ledge), (shell.ledge_mm, floor - 1, joint + 1)):
        outline = notched((x, y - inward), (corner[0], corner[1] - inward))
        plan = cq.Workplane().workplane(offset=low).polyline(outline).close()
        body = body.cut(plan.extrude(high - low))
    if design.z_boss_mm > floor:
        body = body.cut(boss_room(cq, design))
    holes = (
        cq.Workplane()
        .workplane(offset=floor - 1)
        .pushPoints(design.screw_centres_mm)
        .circle(design.screw.row.clearance_mm / 2)
        .extrude(design.shell_depth_mm + 2)
    )
    half = shell.cable_width_mm / 2
    notch: Box = (
        (-half, -outer_y / 2 - 1, floor - 1),
        (half, 1 - y, floor + shell.cable_height_mm),
    )
    return body.cut(holes).cut(cuboid(cq, notch))


def _tab(cq: Any, design: Design, side: int) -> Workplane:
    """One tab at +x (side 1) or -x (-1); it touches the wall and clears floor and bosses."""
    table, fit = design.table, design.cover.fit_mm
    face = design.frame_outer_mm[0] / 2
    half, back = table.width_mm / 2, design.z_back_mm

    def bar(near: float, far: float, y: float, low: float, high: float) -> Workplane:
        x = sorted((side * near, side * far))
        return cuboid(cq, ((x[0], -y, low), (x[1], y, high)))

    tab = bar(face, face + table.tab_mm, half, back, back + table.height_mm)
    tab = tab.cut(bar(face - 1, face + fit, half + 1, back - 1, design.z_floor_mm))
    if design.z_boss_mm > design.z_floor_mm:
        tab = tab.cut(boss_room(cq, design))
    middle = side * (face + table.tab_mm / 2)
    holes = (
        cq.Workplane()
        .workplane(offset=back - 1)
        .pushPoints([(middle, sy * table.hole_pitch_mm / 2) for sy in (-1, 1)])
        .circle(table.hole_mm / 2)
        .extrude(table.height_mm + 2)
    )
    return tab.cut(holes)
