"""The stage's tool holder: a flange with a D bore that orients an indenter's stem.

Section at y = 0:

    z = height    +-----------------------------+   flange, four screws and a pin into the adapter
                  +------+   +-------+   +------+
                         |   |       |   |
          set screw  ====|===|       |   |          the screw at -x presses the stem's flat
                         |   |       |   |          against the bore's flat at +x
    z = 0                +---+       +---+          mouth: bears on the indenter's back plate

Frame: the stem's axis is x = y = 0 and z points up, away from the tip. An indenter's flat faces +x,
as its tip's own x does, so that a star's point or an ellipsoid's long side lies along the stage's
x. The bore is deeper than the stem, so that the indenter alone determines the free length.

The ATI Nano17, the bench's force sensor, and the plate between it and the tool holder.

Section:  +--+  +--+---------+--+  +--+   z = thickness: the sensor's tool side stands here
          |  |  |  +-+     +-+  |  |  |   three screws M2 from below, heads sunk
          +--+--+----+-----+----+--+--+   z = 0: the tool holder's flange, four M3 and a pin

The sensor's bolt circle, screws and diameter are unverified: measure the lab's own sensor before
making the plate. Frame: as the tool holder's, z = 0 on its flange. The sensor is bought: a cylinder
of its published size represents it, z = 0 on the plate.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from deltact_fab.common import Check
from deltact_fab.sensor import Indenter

from ..bench_sections import FLANGE_SCREW, SENSOR_BOLT
from ..dimensions import Design
from ..drafting.dimensioning import SCREWS_CUT, Callouts, fmt
from ..kernel import Extent, Shape, around, cylinders, require
from ..part import BLACK_RGBA, BOUGHT_PROCESS, STEEL_RGBA, Part, PrintPose, Shift
from ..rule import Length, PlayFit, at_most, below
from ..standards import METRIC_THREADS, thread_text

SCREW_THREAD = thread_text("M3")
FLANGE_CORE = (
    "core of its screw (ISO 724)",
    FLANGE_SCREW.thread_mm - 1.2269 * METRIC_THREADS["M3"].pitch_mm,
)
"""No screw enters a narrower hole."""


def holder_box(design: Design) -> Extent:
    """Bounding box of flange and body."""
    radius = design.tool.flange_diameter_mm / 2
    return around(radius, radius, 0.0, design.tool.height_mm)


def holder_build(design: Design) -> Shape:
    """The holder as one solid, z from its mouth up."""
    cq = require()
    tool = design.tool
    high, low = tool.height_mm, tool.height_mm - tool.flange_mm
    axis = [(0.0, 0.0)]
    body = cylinders(axis, tool.body_mm, 0, high)
    body = body.union(cylinders(axis, tool.flange_diameter_mm, low, tool.flange_mm))
    across = 2 * tool.bore_mm + 2
    room = cq.Workplane(origin=(tool.flat_mm - across / 2, 0, 0)).rect(across, across)
    bore = cylinders(axis, 2 * tool.bore_mm, -1, tool.depth_mm + 1)
    body = body.cut(bore.intersect(room.extrude(2 * high, both=True)))
    for centres, diameter_mm in (
        (tool.screw_centres_mm, tool.screw_hole_mm),
        ([tool.pin_at_mm], tool.pin_mm + tool.pin_fit_mm),
    ):
        body = body.cut(cylinders(centres, diameter_mm, low - 1, tool.flange_mm + 2))
    clamp = cq.Workplane("YZ", origin=(0, 0, tool.clamp_z_mm)).circle(tool.clamp_mm / 2)
    return body.cut(clamp.extrude(-tool.body_mm)).val()


def holder_rules(d: Design) -> Iterator[Check]:
    """Rules of the space for stem, screws and their heads."""
    tool = d.tool
    yield below("stem", "indenter's stem", Indenter.stem_length_mm, "tool.depth_mm", tool.depth_mm)
    body, circle = tool.body_mm, tool.bolt_circle_mm
    heads, holes = body + FLANGE_SCREW.head_mm, circle + tool.screw_hole_mm + 3.0
    yield at_most("heads", "tool.body_mm + head M3", heads, "tool.bolt_circle_mm", circle)
    flange = "tool.flange_diameter_mm", tool.flange_diameter_mm
    yield at_most("holes-in-flange", "tool.bolt_circle_mm + hole + 3", holes, *flange)
    bore = "bore + 2 x 3 for the set screw's thread", 2 * tool.bore_mm + 6.0
    yield at_most("set-screw", *bore, "tool.body_mm", body)
    above, under = tool.clamp_z_mm + tool.clamp_mm / 2 + 1.5, tool.height_mm - tool.flange_mm
    hole = "tool.clamp_z_mm + hole / 2 + 1.5", above
    yield at_most("clamp", *hole, "underside of the flange", under)
    yield at_most("clamp-core", *FLANGE_CORE, "tool.clamp_mm", tool.clamp_mm)


def holder_fits(d: Design) -> Iterator[PlayFit]:
    """Fits of stem and flat in the D bore (a rotated stem stays out), and the flange's screws."""
    tool, printer = d.tool, d.resin_printer
    parts, stem = "tool-holder, indenters", Indenter.stem_diameter_mm
    bore = printer.inner(2 * tool.bore_mm)
    yield PlayFit("stem-in-bore", "stem in the bore", parts, (bore,), (printer.outer(stem),))
    flat = printer.inner(tool.bore_mm + tool.flat_mm)
    across = printer.outer(stem / 2 + Indenter.stem_flat_at_mm)
    yield PlayFit("flat-in-bore", "stem's flat in the bore", parts, (flat,), (across,))
    yield PlayFit("turned-stem", "rotated stem blocked", parts, (printer.outer(stem),), (flat,))
    clamp, screw = printer.inner(tool.clamp_mm), Length(FLANGE_SCREW.thread_mm)
    yield PlayFit("set-screw-bites", "set screw M3 bites", "tool-holder", (screw,), (clamp,))
    screws, hole = "tool-holder, nano17-adapter", printer.inner(tool.screw_hole_mm)
    yield PlayFit("screws", "M3 through the flange", screws, (hole,), (screw, printer.pitch()))
    hole, pin = printer.inner(tool.pin_mm + tool.pin_fit_mm), Length(tool.pin_mm)
    yield PlayFit("pin-in-flange", "pin in the flange", screws, (hole,), (pin, printer.pitch()))


def holder_callouts(d: Design) -> Callouts:
    """Drawing content: D bore, body, flange; section through the axis."""
    tool, radius = d.tool, Indenter.stem_diameter_mm / 2
    turn_deg = math.degrees(math.atan(0.05 / math.sqrt(radius**2 - Indenter.stem_flat_at_mm**2)))
    rounds = {
        2 * tool.bore_mm: "for the stem, flat at +x",
        tool.screw_hole_mm: "for M3",
        tool.pin_mm + tool.pin_fit_mm: f"clearance for the pin Ø{fmt(tool.pin_mm)} m6",
        tool.clamp_mm: f"{SCREW_THREAD}, pilot {{}} to the bore, set screw",
    }
    notes = (
        "The indenter's flat, which faces its tip's +x, lies on the bore's flat.",
        f"Flats out of parallel by 0.1 turn the tip by {turn_deg:.1f}°. {SCREWS_CUT}",
    )
    # Seen from the mouth: a section along y would cut the set screw's hole away.
    return Callouts(rounds=rounds, fitted=(2 * tool.bore_mm,), notes=notes, flipped=True)


REAMING_MM = 0.2  # by hand, of the pin's diameter: less leaves a printed hole's waves
SENSOR_SIZE_KEYS = ("adapter.sensor_mm", "adapter.sensor_height_mm")
ADAPTER_KEYS = ("adapter.sensor_mm", "adapter.bolt_circle_mm", "adapter.bolt_turn_deg")


def adapter_box(design: Design) -> Extent:
    """Bounding box of the disc."""
    radius = design.tool.flange_diameter_mm / 2
    return around(radius, radius, 0.0, design.adapter.thickness_mm)


def adapter_build(design: Design) -> Shape:
    """The plate as one solid."""
    plate, tool = design.adapter, design.tool
    high = plate.thickness_mm
    body = cylinders([(0, 0)], tool.flange_diameter_mm, 0, high)
    for centres, diameter, depth in (
        (tool.screw_centres_mm, plate.pilot_mm, high + 2),
        ([tool.pin_at_mm], tool.pin_mm - REAMING_MM, high + 2),
        (plate.bolt_centres_mm, plate.bolt_hole_mm, high + 2),
        (plate.bolt_centres_mm, plate.bolt_bore_mm, plate.bolt_bore_depth_mm + 1),
    ):
        body = body.cut(cylinders(centres, diameter, -1, depth))
    return body.val()


def adapter_rules(d: Design) -> Iterator[Check]:
    """Rules of the heads' depth, and of the bolt circle on the sensor."""
    plate = d.adapter
    deep, thick = plate.bolt_bore_depth_mm + 2.0, plate.thickness_mm
    yield at_most("bolt-bore-depth", "bolt_bore_depth_mm + 2", deep, "adapter.thickness_mm", thick)
    holes = "adapter.bolt_circle_mm + hole", plate.bolt_circle_mm + plate.bolt_hole_mm
    yield at_most("bolts-on-sensor", *holes, "adapter.sensor_mm", plate.sensor_mm, ADAPTER_KEYS)
    yield at_most("pilot-core", *FLANGE_CORE, "adapter.pilot_mm", plate.pilot_mm)


def adapter_fits(d: Design) -> Iterator[PlayFit]:
    """Fits of three screws into the sensor (exact pattern), and of the flange's four."""
    plate, printer = d.adapter, d.resin_printer
    hole, pilot = printer.inner(plate.bolt_hole_mm), printer.inner(plate.pilot_mm)
    body = (Length(SENSOR_BOLT.thread_mm, 0.0, ADAPTER_KEYS), printer.pitch(0.0))
    yield PlayFit("bolts-into-sensor", "M2 into the force sensor", "nano17-adapter", (hole,), body)
    bites, screw = "M3 bites in its pilot", Length(FLANGE_SCREW.thread_mm)
    yield PlayFit("screw-bites", bites, "nano17-adapter", (screw,), (pilot,))


def adapter_callouts(d: Design) -> Callouts:
    """Drawing content: both hole patterns, section through the first of the sensor's screws."""
    plate, tool = d.adapter, d.tool
    rounds = {
        plate.pilot_mm: f"{SCREW_THREAD}, pilot {{}}",
        tool.pin_mm - REAMING_MM: f"{{}}, ream Ø{fmt(tool.pin_mm)} H7 for the pin",
        plate.bolt_hole_mm: "for M2",
        plate.bolt_bore_mm: "for the heads, from the back",
    }
    notes = (
        f"{SCREWS_CUT} Pin Ø{fmt(tool.pin_mm)} m6 (ISO 2338), pressed in after reaming.",
        "Measure the force sensor's own screws first: its pattern is assumed.",
    )
    cut_x_mm = plate.bolt_centres_mm[0][0]
    return Callouts(rounds=rounds, notes=notes, cut_x_mm=cut_x_mm, rests_on=ADAPTER_KEYS)


def adapter_places(design: Design) -> list[Shift]:
    """Position on the tool holder's flange."""
    return [(0.0, 0.0, design.tool.height_mm)]


def sensor_box(design: Design) -> Extent:
    """Bounding box of the force sensor's cylinder."""
    radius = design.adapter.sensor_mm / 2
    return around(radius, radius, 0.0, design.adapter.sensor_height_mm)


def build_sensor(design: Design) -> Shape:
    """Build the force sensor as one solid, without cable and holes."""
    return cylinders([(0, 0)], design.adapter.sensor_mm, 0, design.adapter.sensor_height_mm).val()


def sensor_places(design: Design) -> list[Shift]:
    """Position on the adapter."""
    return [(0.0, 0.0, design.tool.height_mm + design.adapter.thickness_mm)]


PARTS = (
    Part(
        "tool-holder",
        holder_build,
        holder_box,
        group="bench",
        explode_mm=60.0,
        colour=BLACK_RGBA,
        sections=("tool",),
        rules=holder_rules,
        fits=holder_fits,
        wall_keys=("shell.wall_mm",),
        callouts=holder_callouts,
        note="set screw M3 x 6 (ISO 4026), four M3 x 10 (ISO 4762), pin {d.tool.pin_mm:g} m6 x 8 "
        "(ISO 2338)",
        pose=PrintPose("+z", "flange"),
        look_for="a stem slides in only with its flat at +x",
    ),
    Part(
        "nano17-adapter",
        adapter_build,
        adapter_box,
        group="bench",
        explode_mm=80.0,
        colour=BLACK_RGBA,
        places=adapter_places,
        sections=("adapter", "tool"),
        rules=adapter_rules,
        fits=adapter_fits,
        wall_keys=("shell.wall_mm",),
        callouts=adapter_callouts,
        note="three M2 (ISO 4762) into the force sensor; its bolt circle is assumed: measure yours",
        pose=PrintPose("+z", "force sensor's side"),
        how="the pin's hole reamed H7",
        look_for="flat on both sides; the force sensor's screws go in by hand",
    ),
    Part(
        "nano17",
        build_sensor,
        sensor_box,
        material="ATI Nano17, six axes",
        process=BOUGHT_PROCESS,
        group="bench",
        explode_mm=100.0,
        colour=STEEL_RGBA,
        places=sensor_places,
        sections=("adapter",),
        note="{d.adapter.sensor_mm:g} mm wide, {d.adapter.sensor_height_mm:g} mm high as published",
        look_for="measure its diameter, height and bolt circle before the adapter is printed",
    ),
)
