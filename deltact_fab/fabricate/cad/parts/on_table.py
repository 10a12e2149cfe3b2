"""The testing shell: the shell with two table tabs in place of the mount, one on each x side.

Seen along -y:

        +-------------------+
        |       shell       |
    +---+                   +---+     the tabs' undersides lie in the plane of the sensor's back:
    |tab|                   |tab|     they are screwed to the table with the cover on it
    +---+-------------------+---+

The plate on the stage's table that the testing shell stands on.

Seen along -z:  +--------------------------+
                | (=)                  (=) |    slots for the table's screws, along x
                |     o  +--------+  o     |
                |        | sensor |        |    threads for the testing shell's tabs
                |     o  +--------+  o     |
                | (=)                  (=) |
                +--------------------------+

Its edges are parallel to the sensor's x and y: they square it to the stage. Place and turn come
from examples/find_the_block.py, which touches the sensor's own frame: no block on the plate.
Frame: the sensor's; its top is the plane of the sensor's back.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from deltact_fab.common import Check, Point2

from ..dimensions import Design
from ..drafting.dimensioning import SQUARE_EDGES, Callouts, fmt, x_of
from ..kernel import Extent, Shape, Workplane, around, cuboid, cylinders, require
from ..part import BLACK_RGBA, MACHINED_PROCESS, STEEL_RGBA, Part, PrintPose
from ..rule import Length, PlayFit, at_most
from ..standards import METRIC_THREADS, thread_text
from . import shell
from .mount import boss_room


def testing_box(design: Design) -> Extent:
    """Bounding box of shell and tabs."""
    x, y = (side / 2 for side in design.frame_outer_mm)
    return around(x + design.table.tab_mm, y, design.z_back_mm, design.z_joint_mm)


def testing_build(design: Design) -> Shape:
    """The shell with two table tabs in place of the mount, one solid in the sensor frame."""
    return shell.body(design).union(_tab(design, -1)).union(_tab(design, 1)).val()


def _tab(design: Design, side: int) -> Workplane:
    """Return the tab at +x (side 1) or -x (-1); it touches the wall, clear of floor and bosses."""
    table, fit = design.table, design.cover.fit_mm
    face = design.frame_outer_mm[0] / 2
    half, back = table.width_mm / 2, design.z_back_mm

    def bar(inner: float, outer: float, y: float, low: float, high: float) -> Workplane:
        x = sorted((side * inner, side * outer))
        return cuboid(((x[0], -y, low), (x[1], y, high)))

    tab = bar(face, face + table.tab_mm, half, back, back + table.height_mm)
    tab = tab.cut(bar(face - 1, face + fit, half + 1, back - 1, design.z_floor_mm))
    tab = tab.cut(boss_room(design))
    centres = [(x, y) for x, y in tab_centres_mm(design) if x * side > 0]
    return tab.cut(cylinders(centres, table.hole_mm, back - 1, table.height_mm + 2))


def testing_rules(d: Design) -> Iterator[Check]:
    """Rules of the tabs around their holes, and higher than the cover."""
    table = d.table
    around = table.hole_mm + 2 * table.edge_mm
    yield at_most("hole-in-tab", "table: hole + 2 edge_mm", around, "tab_mm", table.tab_mm)
    along = table.hole_pitch_mm + around
    yield at_most("pitch", "table: pitch + hole + 2 edge_mm", along, "width_mm", table.width_mm)
    yield at_most("tab-width", "table: width_mm", table.width_mm, "outer y", d.frame_outer_mm[1])
    yield at_most("cover", "cover + 2", d.cover.floor_mm + 2.0, "table.height_mm", table.height_mm)
    stack = "cover and shell", d.z_joint_mm - d.z_back_mm
    yield at_most("height", "table.height_mm", table.height_mm, *stack)


def testing_fits(d: Design) -> Iterator[PlayFit]:
    """Fits of the cover between the tabs."""
    between = d.resin_printer.inner(d.frame_outer_mm[0] + 2 * d.cover.fit_mm)
    cover = d.resin_printer.outer(d.frame_outer_mm[0])
    parts = "testing-shell, cover"
    yield PlayFit("cover-between-tabs", "cover between the tabs", parts, (between,), (cover,))


def testing_callouts(d: Design) -> Callouts:
    """Drawing content: shell with its two table tabs."""
    notes = (
        f"Walls {fmt(d.shell.wall_mm)} all around. Tabs clear the cover by {fmt(d.cover.fit_mm)}.",
        f"Undersides of both tabs level and flat: they stand on the table. {SQUARE_EDGES}",
    )
    ox = d.frame_outer_mm[0] / 2
    lengths = (*shell.body_lengths(d), x_of(-ox, ox, fitted=False))
    return Callouts(
        lengths, fitted=(d.screw.row.clearance_mm,), notes=notes,
        cut_x_mm=0.0,
    )  # fmt: skip


STAGE_PLATE_KEYS = ("stage_plate.grid_mm", "stage_plate.slot_mm")


def slot_pitch_mm(design: Design) -> Point2:
    """Pitch of the slots: smallest multiples of the grid that clear the tabs: (100, 50)."""
    plate, table = design.stage_plate, design.table
    x = design.frame_outer_mm[0] + 2 * table.tab_mm + plate.slot_length_mm + plate.edge_mm
    y = table.width_mm + plate.slot_mm + plate.edge_mm
    grid = plate.grid_mm
    # Rounding errors must not add a grid step.
    return grid * math.ceil(x / grid - 1e-9), grid * math.ceil(y / grid - 1e-9)


def sides_mm(design: Design) -> Point2:
    """Sides of the plate = slots and testing shell + edge."""
    plate, (x, y) = design.stage_plate, slot_pitch_mm(design)
    inside = max(y + plate.slot_mm, design.frame_outer_mm[1])
    return x + plate.slot_length_mm + 2 * plate.edge_mm, inside + 2 * plate.edge_mm


def slot_centres_mm(design: Design) -> list[Point2]:
    """Middles of the four slots."""
    x, y = (pitch / 2 for pitch in slot_pitch_mm(design))
    return [(sx * x, sy * y) for sy in (-1, 1) for sx in (-1, 1)]


def tab_centres_mm(design: Design) -> list[Point2]:
    """Holes of the testing shell's tabs."""
    table = design.table
    x, y = (design.frame_outer_mm[0] + table.tab_mm) / 2, table.hole_pitch_mm / 2
    return [(sx * x, sy * y) for sy in (-1, 1) for sx in (-1, 1)]


def plate_box(design: Design) -> Extent:
    """Bounding box of the plate; its top is the sensor's back."""
    (x, y), z = sides_mm(design), design.z_back_mm
    return around(x / 2, y / 2, z - design.stage_plate.thickness_mm, z)


def plate_build(design: Design) -> Shape:
    """The plate as one solid in the sensor frame."""
    cq = require()
    plate = design.stage_plate
    low, high = design.z_back_mm - plate.thickness_mm, plate.thickness_mm
    drills = cylinders(tab_centres_mm(design), plate.thread_hole_mm, low - 1, high + 2)
    slots = cq.Workplane(origin=(0, 0, low - 1)).pushPoints(slot_centres_mm(design))
    slots = slots.slot2D(plate.slot_length_mm, plate.slot_mm)
    return cuboid(plate_box(design)).cut(drills).cut(slots.extrude(high + 2)).val()


DRILL_OVERSIZE_MM = 0.1
"""Largest oversize of a drilled or milled hole; by hand: larger asks for more play."""


def plate_rules(d: Design) -> Iterator[Check]:
    """Rule of the thread length of the tabs' screws: one diameter in aluminium."""
    screw_mm = METRIC_THREADS[d.table.screw].thread_mm
    thick = d.stage_plate.thickness_mm
    yield at_most("thread", f"thread {d.table.screw}", screw_mm, "stage_plate.thickness_mm", thick)


def plate_fits(d: Design) -> Iterator[PlayFit]:
    """Fits of screws in the slots, and of tapped threads: neither stripped nor too tight."""
    plate, part, screw = d.stage_plate, "stage-plate", d.table.screw
    mean_off = DRILL_OVERSIZE_MM / 2
    slot = Length(plate.slot_mm + mean_off, mean_off, STAGE_PLATE_KEYS)
    core = Length(plate.thread_hole_mm + mean_off, mean_off)
    yield PlayFit("screw-in-slot", "M6 through its slot", part, (slot,), (Length(6.0),))
    # ISO 724: the thread is 0.61 of its pitch deep; a tap for 60 to 85 % of that is stocked.
    major, depth = METRIC_THREADS[screw].thread_mm, 1.0825 * METRIC_THREADS[screw].pitch_mm
    half = (Length(major - 0.5 * depth),)
    yield PlayFit("holds", f"{screw} holds in its thread", part, half, (core,))
    yield PlayFit("tapped", f"{screw} can be tapped", part, (core,), (Length(major - depth),))


def plate_callouts(d: Design) -> Callouts:
    """Drawing content: outline, slots and threads."""
    slot, half = slot_pitch_mm(d)[0] / 2, d.stage_plate.slot_travel_mm / 2
    notes = (f"Edges square to one another within 0.1. {SQUARE_EDGES}",)
    rounds = {
        d.stage_plate.thread_hole_mm: f"{thread_text(d.table.screw)} – 6H, drill {{}}",
        d.stage_plate.slot_mm: "both ends of four slots along x",
    }
    travel = x_of(slot - half, slot + half, fitted=False)
    axes = ((0, -slot), (0, slot))
    return Callouts((travel,), rounds, notes=notes, axes=axes, rests_on=STAGE_PLATE_KEYS)


def plate_note(d: Design) -> str:
    """Hardware for the stage plate."""
    length = d.table.height_mm + d.stage_plate.thickness_mm
    x, y = (side / 2 for side in d.frame_outer_mm)
    return (
        f"four {d.table.screw} into its threads, {length:g} mm at most; four M6 into the table; "
        f"arguments of examples/find_the_block.py: {x:g} {y:g} {d.z_front_mm:g}"
    )


PARTS = (
    Part(
        "testing-shell",
        testing_build,
        testing_box,
        group="bench",
        colour=BLACK_RGBA,
        sections=("shell", "cover", "table", "screw", "skin", "frame"),
        derived=(
            "frame_outer_mm", "cavity_half_mm", "post_mm", "post_edge_mm", "boss_room_mm",
            "ledge_half_mm", "ledge_reach_mm", "screw_at_mm", "screw_centres_mm", "shell_depth_mm",
            "z_joint_mm", "z_boss_mm", "z_floor_mm", "z_back_mm",
        ),
        rules=testing_rules,
        fits=testing_fits,
        wall_keys=("shell.wall_mm",),
        callouts=testing_callouts,
        note="in place of the shell; {d.table.screw} screws into the table",
        pose=PrintPose(face="back", tilt_deg=45, supports="outside only"),
        look_for="as the shell; tabs flat on the table",
    ),
    Part(
        "stage-plate",
        plate_build,
        plate_box,
        material="aluminium, EN AW-6082",
        process=MACHINED_PROCESS,
        group="bench",
        explode_mm=-40.0,
        colour=STEEL_RGBA,
        sections=("stage_plate", "table", "frame"),
        derived=("frame_outer_mm", "z_front_mm", "z_back_mm"),
        rules=plate_rules,
        fits=plate_fits,
        callouts=plate_callouts,
        note=plate_note,
        how="milled or cut from sheet, four holes tapped",
        look_for="flat; the testing shell's tabs meet the threads",
    ),
)  # fmt: skip
