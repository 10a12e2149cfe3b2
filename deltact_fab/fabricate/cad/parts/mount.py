"""The end-effector mount on the shell's +y side (paper: 20 mm long, to be redesigned at will).

    block, seen along -z        franka, seen along x          plate, seen along -z

    |        | shell            shell |       | flange        |          |
    +-+----+-+                        |       +---+           +----------+
      | o  |                    ------+       | = |  upper    |          |  outer x wide,
      |    |  width x length          +-------+   |           |          |  as high as the
      | o  |  holes along z           |  arm      |           +----------+  shell, no holes
      +----+                          +-------+   |
                                ------+       | = |  lower

The flange's screws run along y with the sensor's body behind them, so that no straight driver
reaches the heads. So the arm meets the flange in its middle, between the screws, whose heads lie in
counterbores above and below it, open to three sides. A cap screw goes in from the sensor's side and
is turned with a key whose short leg fits into the gap. Holes (4.3, 12 apart) and counterbores (8)
are those of a public adapter for the Panda hand; they are unverified: measure your finger.

    flange, seen along -z       flange, seen along x

    |        | shell             shell |   washers, heads
    +--------+                         |     v     v
  +-+--------+-+                       +---+----------+ top
  |  o      o  |  width               +----+          |
  |            |  x length       cover     |          |
  |  o      o  |                      -----+----------+ z_back
  +------------+

The flange's back lies in the plane of the sensor's back, on the robot; its screws go in from the
face's side, where a straight key reaches them beside the shell. Below the shell it keeps
`cover.fit_mm` to the cover.

A mount wider than the wall between the cover's bosses keeps a gap of `cover.fit_mm` to them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations

from deltact_fab.common import Check, Point

from ..dimensions import Design
from ..drafting.dimensioning import Span, y_of, z_of
from ..kernel import Extent, Workplane, cuboid, cylinders, require
from ..rule import Length, PlayFit, at_most
from ..standards import FLANGE_SCREWS_MM

FLANGE_KEYS = tuple(f"mount.flange_{key}_mm" for key in ("pitch", "height", "width", "hole"))


def bars(design: Design) -> list[Extent]:
    """Return the mount's cuboids without holes, the one at the shell first."""
    mount, z = design.mount, design.z_floor_mm
    outer_x, outer_y = design.frame_outer_mm
    y = outer_y / 2
    end = y + mount.length_mm
    half = mount.width_mm / 2
    if mount.kind == "block":
        return [((-half, y, z), (half, end, z + mount.height_mm))]
    if mount.kind == "plate":
        return [((-outer_x / 2, y, z), (outer_x / 2, end, design.z_joint_mm))]
    if mount.kind == "flange":
        # Between the bosses, which would leave it as a thin sheet over them.
        fit, top = design.cover.fit_mm, design.flange_top_mm
        root = min(half, outer_x / 2 - design.boss_room_mm)
        plate = ((-half, y + fit, design.z_back_mm), (half, end, top))
        return [((-root, y, z), (root, y + fit, top)), plate]
    back, front = design.flange_arm_z_mm
    root, back_mm = end - mount.flange_mm, design.z_back_mm
    half_width = mount.flange_width_mm / 2
    return [
        ((-half, y, back), (half, root, front)),
        # On the plane of the sensor's back, so that its front stays behind the frame's.
        ((-half_width, root, back_mm), (half_width, end, back_mm + mount.flange_height_mm)),
    ]


def hole_axes(design: Design) -> list[tuple[Point, Point]]:
    """Return both ends of each through hole's axis: along z in a block, along y in a flange."""
    mount = design.mount
    (x0, y0, z0), (x1, y1, z1) = bars(design)[-1]
    x, y, z = (x0 + x1) / 2, (y0 + y1) / 2, (z0 + z1) / 2
    if mount.kind == "block":
        rows = (y - mount.hole_pitch_mm / 2, y + mount.hole_pitch_mm / 2)
        return [((x, row, z0), (x, row, z1)) for row in rows]
    if mount.kind == "franka":
        rows = (z - mount.flange_pitch_mm / 2, z + mount.flange_pitch_mm / 2)
        return [((x, y0, row), (x, y1, row)) for row in rows]
    if mount.kind == "flange":
        y = design.flange_middle_mm
        return [((x, y + v, z0), (x, y + v, z1)) for x, v in mount.pattern.centres_mm]
    return []


def build(design: Design) -> Workplane:
    """Return the mount in the sensor frame; it touches the shell's +y face without overlap."""
    cq = require()
    first, *rest = bars(design)
    body = cuboid(first)
    for box in rest:
        body = body.union(cuboid(box))
    body = body.cut(boss_room(design))
    for start, end in hole_axes(design):
        axis = cq.Vector(*end) - cq.Vector(*start)
        along = axis.normalized()
        radius = design.mount.hole_mm / 2
        drills = [(radius, axis.Length + 2)]
        if design.mount.kind == "franka":
            # From the shell's side, where the heads are.
            drills.append((design.mount.counterbore_mm / 2, design.mount.counterbore_depth_mm + 1))
        for radius_mm, long_mm in drills:
            base = cq.Vector(*start) - along
            body = body.cut(cq.Workplane(cq.Solid.makeCylinder(radius_mm, long_mm, base, along)))
    pattern = design.mount.pattern
    if design.mount.kind == "flange" and pattern.pin_mm:
        centre_mm = (pattern.pin_at_mm[0], design.flange_middle_mm)
        low, deep = design.z_back_mm - 1, design.mount.height_mm + 2
        body = body.cut(cylinders([centre_mm], pattern.pin_mm, low, deep))
    return body


def boss_room(design: Design) -> Workplane:
    """Return the cutter of the four corners below z_boss: boss + fit, inwards and outwards."""
    x, y = (side / 2 for side in design.frame_outer_mm)
    fit, room, low = design.cover.fit_mm, design.boss_room_mm, design.z_floor_mm - 1
    square = room + fit
    plan = require().Workplane().workplane(offset=low).pushPoints(
        [(sx * (x + fit - square / 2), sy * (y + fit - square / 2))
         for sx in (-1, 1) for sy in (-1, 1)]
    )  # fmt: skip
    return plan.rect(square, square).extrude(design.z_boss_mm - low)


def rules(d: Design) -> Iterator[Check]:
    """Rules of the mount on the shell, its holes, and space for heads and washers."""
    mount = d.mount
    if mount.kind == "flange":
        yield from _pattern_rules(d)
        return
    depth = "depth of the shell", d.shell_depth_mm
    yield at_most("height", "mount.height_mm", mount.height_mm, *depth)
    yield at_most("mount-width", "mount.width_mm", mount.width_mm, "outer x", d.frame_outer_mm[0])
    if mount.kind == "block":
        # A head or a washer beside the shell, two of them side by side, and on the bar.
        washer = f"mount: washer {mount.screw}", mount.thread.washer_mm
        two, two_mm = f"mount.hole_pitch_mm + washer {mount.screw}", mount.hole_pitch_mm + washer[1]
        yield at_most("mount-washers", two, two_mm, "mount.length_mm", mount.length_mm)
        yield at_most("mount-washer-pitch", *washer, "mount.hole_pitch_mm", mount.hole_pitch_mm)
        yield at_most("mount-washer-width", *washer, "mount.width_mm", mount.width_mm)
    if mount.kind == "franka":
        yield from _flange_rules(d)


def _pattern_rules(d: Design) -> Iterator[Check]:
    """Rules of a flange's size, the walls between its holes, its screws and its bending."""
    mount, pattern = d.mount, d.mount.pattern
    size, washer_mm = mount.pattern_size_mm, mount.thread.washer_mm
    holes = [(centre, mount.hole_mm, washer_mm) for centre in pattern.centres_mm]
    holes += [(pattern.pin_at_mm, pattern.pin_mm, pattern.pin_mm)] if pattern.pin_mm else []
    pairs = [(math.dist(a, b), r, s, v, w) for (a, r, v), (b, s, w) in combinations(holes, 2)]
    wall_mm = min(mm - (r + s) / 2 for mm, r, s, _, _ in pairs)
    gap_mm = min(mm - (v + w) / 2 for mm, _, _, v, w in pairs)
    (x0, _, z0), (x1, _, z1) = bars(d)[0]
    root_mm, width_mm = z1 - z0, x1 - x0
    # A cantilever from its screws, pressed in the middle of the face: 6 F l / (w h^2).
    lever_mm = d.flange_middle_mm + pattern.half_mm[1]
    stress_mpa = (
        6 * d.plate.force_n * lever_mm / (width_mm * root_mm**2) if root_mm > 0 else math.inf
    )
    heads_mm = d.flange_top_mm + mount.thread.washer_height_mm + mount.thread.thread_mm
    for id, name, value, limit_name, room in (
        ("width", "holes, washers and edges in x", size[0], "mount.width_mm", mount.width_mm),
        ("length", "holes, washers and edges in y", size[1], "mount.length_mm", mount.length_mm),
        ("walls", "shell.wall_mm", d.shell.wall_mm, "least wall between the holes", wall_mm),
        ("washers", "0", 0.0, "least gap between the washers", gap_mm),
        ("screw", "height_mm + washer + grip of 1 d",
         mount.height_mm + mount.thread.washer_height_mm + mount.thread.thread_mm,
         "longest screw on sale", FLANGE_SCREWS_MM[-1]),
        ("root", "cover.floor_mm + 3", d.cover.floor_mm + 3.0, "mount.height_mm", mount.height_mm),
        ("front", "front of the flange", d.flange_top_mm, "joint", d.z_joint_mm),
        ("heads", "front of the heads", heads_mm, "front of the frame", d.z_front_mm),
        ("stress", "stress at the root under plate.force_n, MPa", stress_mpa,
         "stress_limit_mpa", mount.stress_limit_mpa),
    ):  # fmt: skip
        rests_on = ("mount.stress_limit_mpa",)
        yield at_most(f"pattern-{id}", f"mount: {name}", value, limit_name, room, rests_on)


def _flange_rules(d: Design) -> Iterator[Check]:
    """Rules of the flange's counterbores, the arm between them, and inserting the screws."""
    mount = d.mount
    under_mm = mount.flange_mm - mount.counterbore_depth_mm
    # A cantilever from the flange, pressed in the middle of the face: 6 F l / (w h^2).
    lever_mm = d.frame_outer_mm[1] / 2 + mount.length_mm - mount.flange_mm
    stress_mpa = 6 * d.plate.force_n * lever_mm / (mount.width_mm * mount.arm_mm**2)
    for id, name, value, limit_name, room in (
        ("pitch", "flange_pitch_mm + counterbore_mm + 3",
         mount.flange_pitch_mm + mount.counterbore_mm + 3,
         "flange_height_mm", mount.flange_height_mm),
        ("width", "counterbore_mm + 3", mount.counterbore_mm + 3,
         "flange_width_mm", mount.flange_width_mm),
        ("length", "flange_mm + 2", mount.flange_mm + 2, "length_mm", mount.length_mm),
        ("height", "flange_height_mm", mount.flange_height_mm, "height of the sensor",
         -d.z_back_mm),
        ("outer", "flange_width_mm", mount.flange_width_mm, "outer x", d.frame_outer_mm[0]),
        # The heads lie above and below the arm, with 2 mm of flange under them.
        ("arm", "arm_mm + counterbore_mm + 0.4", mount.arm_mm + mount.counterbore_mm + 0.4,
         "flange_pitch_mm", mount.flange_pitch_mm),
        ("head-in-counterbore", f"head {mount.screw} + 0.5", mount.head_mm + 0.5,
         "counterbore_mm", mount.counterbore_mm),
        ("hole-under-head", "flange_hole_mm + 0.5", mount.flange_hole_mm + 0.5,
         f"head {mount.screw}", mount.head_mm),
        ("under-head", "counterbore_depth_mm + 2", mount.counterbore_depth_mm + 2.0,
         "flange_mm", mount.flange_mm),
        ("arm-stress", "stress in arm_mm under plate.force_n, MPa", stress_mpa,
         "stress_limit_mpa", mount.stress_limit_mpa),
        # A screw with 1.5 d of engagement goes in head last: the gap is as long as the screw.
        ("screw", f"flange under the head + 2.5 x {mount.screw}",
         under_mm + 2.5 * mount.thread.thread_mm,
         "gap between shell and flange", mount.length_mm - mount.flange_mm),
        ("arm-front", "front of the arm", d.flange_arm_z_mm[1], "joint", d.z_joint_mm),
    ):  # fmt: skip
        rests_on = (*FLANGE_KEYS, "mount.stress_limit_mpa")
        yield at_most(f"flange-{id}", f"mount: {name}", value, limit_name, room, rests_on)


def fits(d: Design) -> Iterator[PlayFit]:
    """Fits of the flange's two screws into a finger, whose own pitch is assumed exact."""
    mount, printer = d.mount, d.resin_printer
    if mount.kind == "flange":
        # Each hole and its tapped hole, whose pitch is exact.
        shank = Length(mount.thread.thread_mm), printer.pitch()
        holes, name = (printer.inner(mount.hole_mm),), f"{mount.pattern.thread} through the flange"
        yield PlayFit("screws-through-flange", name, "shell, robot", holes, shank)
    if mount.kind != "franka":
        return
    pitch = Length(0.0, printer.height_mm, ("mount.flange_pitch_mm",))
    screw = Length(mount.thread.thread_mm)
    hole = printer.tall(mount.hole_mm)
    name = f"{mount.screw} through the flange"
    yield PlayFit("screw-through-flange", name, "shell, finger", (hole,), (screw, pitch))


def lengths(d: Design) -> list[Span]:
    """Return the mount's dimensions for the shell's drawing."""
    mount, face = d.mount, d.frame_outer_mm[1] / 2
    end = face + mount.length_mm
    full_length = y_of(face, end, fitted=False)
    if mount.kind == "flange":  # the scheme locates its holes
        return [full_length, z_of(d.z_back_mm, d.flange_top_mm, fitted=False)]
    if mount.kind == "plate":  # as wide as the shell, whose face is gone
        return []
    if mount.kind == "block":
        middle, pitch = end - mount.length_mm / 2, mount.hole_pitch_mm / 2
        return [full_length, y_of(middle - pitch, middle + pitch, fitted=False)]
    middle, pitch = d.z_back_mm + mount.flange_height_mm / 2, mount.flange_pitch_mm / 2
    return [full_length, z_of(middle - pitch, middle + pitch, fitted=False)]
