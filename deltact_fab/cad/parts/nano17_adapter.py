"""The ATI Nano17, the bench's force sensor, and the plate between it and the tool holder.

Section:  +--+  +--+---------+--+  +--+   z = thickness: the sensor's tool side stands here
          |  |  |  +-+     +-+  |  |  |   three screws M2 from below, heads sunk
          +--+--+----+-----+----+--+--+   z = 0: the tool holder's flange, four M3 and a pin

The sensor's bolt circle, screws and diameter are unverified: they are assumed, to be measured on
the lab's own sensor before the plate is made. Frame: as the tool holder's, z = 0 on its flange. The
sensor is bought: a cylinder of its published size keeps its room, z = 0 on the plate.
"""

from __future__ import annotations

from collections.abc import Iterator

from ..bench_sections import BOLT, SCREW
from ..dimensions import Design
from ..drafting.dimensioning import Callouts, Cut
from ..kernel import Shape, cylinders
from ..part import BLACK, BOUGHT, PRINT, RESIN, STEEL, Part, PrintPose, Shift
from ..rule import Length, PlayFit, Quantity, Rule
from ..solid_gate import Box, around

SIZE = ("adapter.sensor_mm", "adapter.sensor_height_mm")
KEYS = ("adapter.sensor_mm", "adapter.bolt_circle_mm", "adapter.bolt_turn_deg")


def box(design: Design) -> Box:
    """The disc."""
    radius = design.tool.flange_diameter_mm / 2
    return around(radius, radius, 0.0, design.adapter.thickness_mm)


def build(design: Design) -> Shape:
    """The plate as one solid."""
    plate, tool = design.adapter, design.tool
    high = plate.thickness_mm
    body = cylinders([(0, 0)], tool.flange_diameter_mm, 0, high)
    for centres, diameter, depth in (
        (tool.screw_centres_mm, plate.pilot_mm, high + 2),
        ([tool.pin_at_mm], tool.pin_mm, high + 2),
        (plate.bolt_centres_mm, plate.bolt_hole_mm, high + 2),
        (plate.bolt_centres_mm, plate.bolt_bore_mm, plate.bolt_bore_depth_mm + 1),
    ):
        body = body.cut(cylinders(centres, diameter, -1, depth))
    return body.val()


def rules(d: Design) -> Iterator[Rule]:
    """Room for the heads, on the sensor."""
    plate = d.adapter
    yield Quantity("bolt_bore_depth_mm + 2", plate.bolt_bore_depth_mm + 2.0).at_most(
        "adapter.thickness_mm", plate.thickness_mm
    )
    yield Quantity(
        "adapter.bolt_circle_mm + hole", plate.bolt_circle_mm + plate.bolt_hole_mm
    ).at_most("adapter.sensor_mm", plate.sensor_mm, KEYS)


def fits(d: Design) -> Iterator[PlayFit]:
    """Three screws into a sensor, whose own pattern counts as exact; the flange's four bite."""
    plate, printer = d.adapter, d.resin_printer
    hole, pilot = printer.inner(plate.bolt_hole_mm), printer.inner(plate.pilot_mm)
    body = (Length(BOLT.thread_mm, 0.0, KEYS), printer.pitch(0.0))
    yield PlayFit("M2 into the force sensor", "nano17-adapter", (hole,), body)
    bites = "M3 bites in its pilot"
    yield PlayFit(bites, "nano17-adapter", (Length(SCREW.thread_mm),), (pilot,))


def callouts(d: Design) -> Callouts:
    """Holes of both patterns; section through the first of the sensor's screws."""
    plate, tool = d.adapter, d.tool
    rounds = {
        plate.pilot_mm: "for M3",
        tool.pin_mm: "for the pin",
        plate.bolt_hole_mm: "for M2",
        plate.bolt_bore_mm: "for the heads, from the back",
    }
    notes = ("Measure the force sensor's own screws first: its pattern is assumed.",)
    return Callouts(rounds=rounds, notes=notes, cut=Cut(plate.bolt_centres_mm[0][0]), rests_on=KEYS)


def places(design: Design) -> list[Shift]:
    """On the tool holder's flange."""
    return [(0.0, 0.0, design.tool.height_mm)]


def sensor_box(design: Design) -> Box:
    """The force sensor's cylinder."""
    radius = design.adapter.sensor_mm / 2
    return around(radius, radius, 0.0, design.adapter.sensor_height_mm)


def build_sensor(design: Design) -> Shape:
    """The force sensor as one solid; cable and holes are left out."""
    return cylinders([(0, 0)], design.adapter.sensor_mm, 0, design.adapter.sensor_height_mm).val()


def sensor_places(design: Design) -> list[Shift]:
    """On the adapter."""
    return [(0.0, 0.0, design.tool.height_mm + design.adapter.thickness_mm)]


PARTS = (
    Part(
        "nano17-adapter",
        f"{RESIN}, black",
        PRINT,
        build,
        box,
        group="bench",
        explode_mm=80.0,
        colour=BLACK,
        places=places,
        sections=("adapter", "tool"),
        rules=rules,
        fits=fits,
        wall_keys=("shell.wall_mm",),
        callouts=callouts,
        note="three M2 (ISO 4762) into the force sensor; its bolt circle is assumed: measure yours",
        lies=PrintPose("+z", "force sensor's side"),
        look_for="flat on both sides; the force sensor's screws go in by hand",
    ),
    Part(
        "nano17",
        "ATI Nano17, six axes",
        BOUGHT,
        build_sensor,
        sensor_box,
        group="bench",
        explode_mm=100.0,
        colour=STEEL,
        places=sensor_places,
        sections=("adapter",),
        note="{d.adapter.sensor_mm:g} mm wide, {d.adapter.sensor_height_mm:g} mm high as published",
        look_for="measure its diameter, height and bolt circle before the adapter is printed",
    ),
)
