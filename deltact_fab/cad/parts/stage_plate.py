"""The plate on the stage's table that the testing shell stands on.

Seen along -z:  +--------------------------+
                | (=)                  (=) |    slots for the table's screws, along x
                |     o  +--------+  o     |
                |        | sensor |        |    threads for the testing shell's tabs
                |     o  +--------+  o     |
                | (=)                  (=) |
                +--------------------------+

Its edges are parallel to the sensor's x and y: they square it to the stage. Place and turn come
from `rig register --jig`, which touches the sensor's own frame and needs no block on the plate.
Frame: the sensor's; its top is the plane of the sensor's back.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING

from ..checks import Expected
from ..drafting.dimensioning import Centres, Item, Leader, shown
from ..drafting.items import SQUARE_EDGES, Callouts, holes, x_of, y_of, z_of
from ..kernel import require
from ..part import STEEL, Part
from ..record import Point2, Record, check_limits, check_measured, number
from ..rule import Rule

if TYPE_CHECKING:
    from cadquery import Shape

    from ..dimensions import Design

KEYS = ("stage_plate.slot_pitch_x_mm", "stage_plate.slot_pitch_y_mm", "stage_plate.slot_mm")


@dataclass(frozen=True)
class StagePlateDimensions(Record):
    """The plate between the stage's table and the testing shell (measure your table)."""

    width_mm: float = number(130.0, "along x", 40, 500)
    length_mm: float = number(80.0, "along y", 30, 500)
    thickness_mm: float = number(6.0, "of the plate", 3, 30)
    thread_hole_mm: float = number(3.3, "tapping drill of the tabs' screws (M4)", 1, 10)
    slot_mm: float = number(6.6, "width of a slot (M6)", 2, 20, unverified=True)
    slot_travel_mm: float = number(10.0, "from end centre to end centre of a slot", 1, 100)
    slot_pitch_x_mm: float = number(100.0, "between slots along x", 10, 450, unverified=True)
    slot_pitch_y_mm: float = number(50.0, "between slots along y", 10, 450, unverified=True)
    measured: tuple[str, ...] = field(
        default=(), metadata={"meaning": "keys measured on the lab's own table"}
    )

    def __post_init__(self) -> None:
        check_limits(self)
        check_measured(self)

    @property
    def slot_centres_mm(self) -> list[Point2]:
        """Middles of the four slots."""
        x, y = self.slot_pitch_x_mm / 2, self.slot_pitch_y_mm / 2
        return [(sx * x, sy * y) for sy in (-1, 1) for sx in (-1, 1)]


def tab_centres_mm(design: Design) -> list[Point2]:
    """Holes of the testing shell's tabs."""
    table = design.table
    x, y = (design.frame_outer_mm[0] + table.tab_mm) / 2, table.hole_pitch_mm / 2
    return [(sx * x, sy * y) for sy in (-1, 1) for sx in (-1, 1)]


def expect(design: Design) -> Expected:
    """Closed forms of a plate with four holes and four slots."""
    plate = design.stage_plate
    x, y, z = plate.width_mm / 2, plate.length_mm / 2, design.z_back_mm
    slot_mm2 = plate.slot_mm * plate.slot_travel_mm + math.pi / 4 * plate.slot_mm**2
    open_mm2 = 4 * slot_mm2 + math.pi * plate.thread_hole_mm**2
    volume_mm3 = (4 * x * y - open_mm2) * plate.thickness_mm
    about = {k: v for k, v in asdict(plate).items() if k != "measured"}
    return Expected((volume_mm3, volume_mm3), ((-x, -y, z - plate.thickness_mm), (x, y, z)), about)


def build(design: Design) -> Shape:
    """The plate as one solid in the sensor frame."""
    cq = require()
    plate = design.stage_plate
    low, high = design.z_back_mm - plate.thickness_mm, plate.thickness_mm
    body = cq.Workplane(origin=(0, 0, low)).rect(plate.width_mm, plate.length_mm).extrude(high)
    drills = cq.Workplane(origin=(0, 0, low - 1)).pushPoints(tab_centres_mm(design))
    drills = drills.circle(plate.thread_hole_mm / 2)
    slots = cq.Workplane(origin=(0, 0, low - 1)).pushPoints(plate.slot_centres_mm)
    slots = slots.slot2D(plate.slot_travel_mm + plate.slot_mm, plate.slot_mm)
    return body.cut(drills.extrude(high + 2)).cut(slots.extrude(high + 2)).val()


def rules(d: Design) -> Iterator[Rule]:
    """Slots inside the plate and clear of the sensor."""
    part, plate = "stage-plate", d.stage_plate
    long = plate.slot_travel_mm + plate.slot_mm
    yield Rule(
        part,
        ("slot_pitch_x_mm + slot + 6", plate.slot_pitch_x_mm + long + 6.0),
        "<=",
        ("stage_plate.width_mm", plate.width_mm),
        KEYS,
    )
    yield Rule(
        part,
        ("slot_pitch_y_mm + slot + 6", plate.slot_pitch_y_mm + plate.slot_mm + 6.0),
        "<=",
        ("stage_plate.length_mm", plate.length_mm),
        KEYS,
    )
    # The slots' screws and washers stand beside the tabs.
    yield Rule(
        part,
        ("testing shell + slot + 6", d.frame_outer_mm[0] + 2 * d.table.tab_mm + long + 6.0),
        "<=",
        ("stage_plate.slot_pitch_x_mm", plate.slot_pitch_x_mm),
        KEYS,
    )
    yield Rule(
        part,
        ("outer y + 6", d.frame_outer_mm[1] + 6.0),
        "<=",
        ("stage_plate.length_mm", plate.length_mm),
    )


def callouts(d: Design) -> Callouts:
    """Outline, slots and threads."""
    plate = d.stage_plate
    x, y, top = plate.width_mm / 2, plate.length_mm / 2, d.z_back_mm
    sx, sy = plate.slot_pitch_x_mm / 2, plate.slot_pitch_y_mm / 2
    tx, ty = tab_centres_mm(d)[-1]
    half = plate.slot_travel_mm / 2
    items: list[Item] = [
        x_of("top", -x, x, "bottom", -y, top),
        y_of("top", -y, y, "left", -x, top),
        z_of("front", top - plate.thickness_mm, top, "right", x),
        x_of("top", -sx, sx, "top", sy, top),
        y_of("top", -sy, sy, "right", sx, top),
        x_of("top", -sx - half, -sx + half, "top", sy, top),
        x_of("top", -tx, tx, "bottom", -ty, top),
        y_of("top", -ty, ty, "right", tx, top),
        *holes(tab_centres_mm(d), top, plate.thread_hole_mm, f" tapped {d.table.screw}, through"),
        Centres("top", tuple((a, b, top) for a, b in plate.slot_centres_mm), plate.slot_mm / 2),
        Leader("top", (-sx - half, -sy, top), plate.slot_mm / 2,
               f"4× slot, {shown(plate.slot_mm)} wide, along x", "left"),
    ]  # fmt: skip
    fx, fy = (side / 2 for side in d.frame_outer_mm)
    notes = (
        f"Long edges square to the stage within 0.1. {SQUARE_EDGES}",
        f"rig register --jig: half_mm = [{fx:g}, {fy:g}], top_mm = {d.z_front_mm:g}.",
    )
    return Callouts(tuple(items), notes, rests_on=KEYS)


def note(d: Design) -> str:
    """What goes with it."""
    length = d.table.height_mm + d.stage_plate.thickness_mm
    return f"four {d.table.screw} into its threads, {length:g} mm at most; four M6 into the table"


PARTS = (
    Part(
        "stage-plate",
        "aluminium, EN AW-6082",
        "machined",
        build,
        expect,
        group="bench",
        explode_mm=-40.0,
        colour=STEEL,
        sections=("stage_plate", "table", "frame"),
        derived=("frame_outer_mm", "z_back_mm"),
        rules=rules,
        callouts=callouts,
        note=note,
        how="milled or cut from sheet, four holes tapped",
        look_for="flat; the testing shell's tabs meet the threads",
    ),
)
