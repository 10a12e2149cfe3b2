"""Part 4, the light holder: a translucent ring round the lens, with a channel for the LED strip.

Half section at y = 0, the lens's axis on the left:

    z_light        +---+     +---+     a little below the acrylic: carries no press
                   |   |     |   |
                   | d |  c  | w |     d: diffuser, c: channel, open towards +z, w: outer wall
                   |   |     |   |
                   |   +-----+   |
                   |    floor    |
    z_board_front  +-------------+     stands on the camera's board
               light_bore    light_radius

A slot of slot_mm through the outer wall at -y, above the floor, lets the wires out on the side of
the camera's cable. The floor has reliefs for the heads of the camera's two screws and the lips of
the cover's pegs.
The paper gives the material and the LEDs (Imaging Subsystem), no dimensions.

The LED strip, flat as it is cut and soldered, before it goes into the channel: cuts of cut_mm
along x, evenly spaced on the channel's wall and joined by two wires; the LEDs of a cut, drawn
square, are pitch_mm apart. The wires leave at the -x end. Frame: z = 0 is the adhesive's side, z up
to the LEDs, x and y from the middle of the strip.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from deltact_fab.common import Check

from ..dimensions import Design
from ..drafting.dimensioning import SQUARE_EDGES, Callouts, z_of
from ..kernel import Extent, Shape, Workplane, around, cuboid, cylinders, require
from ..part import AMBER_RGBA, BOUGHT_PROCESS, WHITE_RGBA, Part, PrintPose
from ..rays import OPPOSITE_DEG
from ..rule import Length, PlayFit, at_most, below
from .camera import UPPER_HOLES

WIRE_SIZE = "0.08 mm²"
WIRE_OUTER = Length(1.2, 0.1)  # outer diameter with insulation (AWG 28, UL 1007)
WIRE_COLOURS = ("red", "black")  # plus, minus


def box(design: Design) -> Extent:
    """Bounding box of the ring."""
    radius = design.light_radius_mm
    return around(radius, radius, design.z_board_front_mm, design.z_light_mm)


def build(design: Design) -> Shape:
    """The ring as one solid in the sensor frame, z from the board's front to z_light."""
    light = design.light
    low_mm, high_mm = design.z_board_front_mm, design.z_light_mm
    floor_mm = low_mm + light.floor_mm

    def disc(radius_mm: float, from_mm: float) -> Workplane:
        return cylinders([(0, 0)], 2 * radius_mm, from_mm, high_mm + 1 - from_mm)

    ring = cylinders([(0, 0)], 2 * design.light_radius_mm, low_mm, high_mm - low_mm)
    ring = ring.cut(disc(design.light_bore_mm, low_mm - 1))
    channel = disc(design.strip_radius_mm, floor_mm).cut(disc(design.channel_inner_mm, floor_mm))
    # Its inner end is round, inside the channel: a straight end could cut the diffuser.
    half, outside = light.slot_mm / 2, design.light_radius_mm + 1
    slot = cuboid(((-half, -outside, floor_mm), (half, 0.0, high_mm + 1)))
    slot = slot.cut(disc((design.strip_radius_mm + design.channel_inner_mm) / 2, floor_mm))
    body = ring.cut(channel).cut(slot)
    for centres, relief_mm in (
        (design.camera_screw_centres_mm, design.head_relief_mm),
        (design.peg_centres_mm, design.peg_relief_mm),
    ):
        if centres:
            body = body.cut(cylinders(centres, 2 * relief_mm, low_mm - 1, light.floor_mm + 1))
    return body.val()


def rules(d: Design) -> Iterator[Check]:
    """Rules of the strip in its channel, and of the screw heads in the floor."""
    light = d.light
    round_mm = 2 * math.pi * max(d.strip_radius_mm, 0.0)
    yield at_most("led-count", "led_count x pitch", light.strip_mm, "2 pi strip radius", round_mm)
    spare = float(light.led_count % light.leds_per_cut)
    yield below("whole-cuts", "LEDs beyond whole cuts of leds_per_cut", spare, "1", 1.0)
    depth, keys = d.z_light_mm - d.z_board_front_mm - light.floor_mm, ("camera.lens_height_mm",)
    strip = "strip_width_mm", light.strip_width_mm
    yield at_most("strip", *strip, "depth of the channel", depth, keys)
    yield below("bore", "0", 0.0, "bore radius", d.light_bore_mm)
    head = d.holder.row.head_height_mm + light.head_room_mm
    yield at_most("head", f"{d.holder.screw} head + head_room_mm", head, "floor_mm", light.floor_mm)
    if d.light_bore_mm <= 0:
        return
    # A relief opens well to the outside or into the bore, or leaves a wall: no thread of floor.
    least_mm, bore_mm = min(light.wall_mm, light.diffuser_mm, light.floor_mm), d.light_bore_mm
    for id, name, centres, relief_mm in (
        ("screw", "a camera screw", d.camera_screw_centres_mm[:1], d.head_relief_mm),
        ("peg", "a peg", d.peg_centres_mm[:1], d.peg_relief_mm),
    ):
        for away_mm in (math.hypot(*centre) for centre in centres):
            for place, ring_mm, sign in (("outside", d.light_radius_mm, 1), ("bore", bore_mm, -1)):
                gap_mm = sign * (ring_mm - away_mm) - relief_mm
                need, room = ("least wall", least_mm), (f"relief of {name} to the {place}", gap_mm)
                if gap_mm <= 0:
                    # Angle of the floor's edge where the two circles cross, as walls are judged.
                    cosine = ring_mm**2 + relief_mm**2 - away_mm**2
                    cosine = min(max(sign * cosine / (2 * ring_mm * relief_mm), -1.0), 1.0)
                    angle = f"edge where the relief of {name} opens to the {place}, deg"
                    edge_deg = math.degrees(math.acos(cosine))
                    need, room = ("least angle of a wall", OPPOSITE_DEG), (angle, edge_deg)
                yield at_most(f"{id}-{place}", *need, *room, UPPER_HOLES)


def led_room_mm(d: Design) -> float:
    """Radial space of strip and LED = strip + LED + sagitta of the LED's chord: 2.11.

    An LED is flat: the strip behind it is a chord of led_width, whose middle lies the sagitta
    r - sqrt(r^2 - (w / 2)^2) inside the channel's wall. NaN if the LED is wider than the ring.
    """
    light, r = d.light, d.strip_radius_mm
    half = light.led_width_mm / 2
    sagitta = r - math.sqrt(r**2 - half**2) if r > half else math.nan
    return light.strip_thickness_mm + light.led_height_mm + sagitta


def fits(d: Design) -> Iterator[PlayFit]:
    """Fits in the shell, below the acrylic, around the lens, and with LEDs and wires."""
    part, printer, light, cam = "light-holder", d.resin_printer, d.light, d.camera
    ring = printer.outer(2 * d.light_radius_mm)
    # Between the ledges, and between the posts' corners.
    opening = printer.inner(2 * min(*d.ledge_half_mm, math.hypot(*d.post_edge_mm)))
    yield PlayFit("ring-in-shell", "ring in the shell", f"{part}, shell", (opening,), (ring,))
    relief = printer.inner(2 * d.peg_relief_mm)
    lips = printer.outer(d.cover.hole_mm + 2 * d.cover.lip_mm)
    reliefs = "lips in the ring's reliefs"
    yield PlayFit("lips-in-reliefs", reliefs, f"{part}, cover", (relief,), (lips, printer.pitch()))
    led = Length(led_room_mm(d), light.led_tolerance_mm)
    channel = printer.inner(light.channel_mm)
    yield PlayFit("led-in-channel", "LED in its channel", f"{part}, LED strip", (channel,), (led,))
    slot = printer.inner(light.slot_mm)
    wires = WIRE_OUTER, WIRE_OUTER
    yield PlayFit("wires", "two wires in the slot", f"{part}, wires", (slot,), wires)
    lens = Length(cam.lens_diameter_mm, cam.tolerance_mm, ("camera.lens_diameter_mm",))
    bore = printer.inner(2 * d.light_bore_mm)
    least_mm = 2 * light.lens_clearance_mm
    yield PlayFit("lens-in-bore", "lens in the bore", f"{part}, camera", (bore,), (lens,), least_mm)
    yield plate_bending_room(d)


def plate_bending_room(d: Design) -> PlayFit:
    """Play between ring and acrylic, for the plate to deflect under a press."""
    printer, cam = d.resin_printer, d.camera
    # Stack: ring on the board, board on its holder, holder on the cover's floor.
    stack = (
        printer.tall(d.holder.clearance_mm),
        Length(cam.board_mm, cam.tolerance_mm, ("camera.board_mm",)),
        printer.tall(d.z_light_mm - d.z_board_front_mm),
        d.laser.sheet(d.optics.acrylic_mm),
    )
    room = printer.tall(d.shell_depth_mm), printer.tall(d.optics.acrylic_mm)
    name, parts = "ring below the acrylic, z", "light-holder, acrylic"
    return PlayFit("below-acrylic", name, parts, room, stack)


def callouts(d: Design) -> Callouts:
    """Drawing content: ring from the board's side, section through channel and wire slot."""
    rounds = {
        2 * d.head_relief_mm: "for the camera's screws",
        2 * d.peg_relief_mm: "for the lips of the pegs",
    }
    radii = (d.light_radius_mm, d.strip_radius_mm, d.channel_inner_mm)
    notes = (
        "Translucent white; the inner wall is the diffuser: no polish, no paint.",
        f"Slot at -y through the outer wall only, down to the channel's floor. {SQUARE_EDGES}",
    )
    return Callouts(
        (z_of(d.z_board_front_mm, d.z_light_mm),), rounds, tuple(2 * r for r in radii), notes,
        cut_x_mm=0.0, flipped=True,
        rests_on=("camera.lens_diameter_mm", "camera.lens_height_mm", *UPPER_HOLES),
    )  # fmt: skip


def strip_box(design: Design) -> Extent:
    """Bounding box of strip and LEDs."""
    light = design.light
    high = light.strip_thickness_mm + light.led_height_mm
    x = max(cut_middles_mm(design)) + light.cut_mm / 2
    return around(x, light.strip_width_mm / 2, 0.0, high)


def cut_middles_mm(design: Design) -> list[float]:
    """x of each cut's middle: evenly spaced round the channel, the wire slot between two."""
    cuts = design.light.cuts
    return [(k - (cuts - 1) / 2) * design.cut_step_mm for k in range(cuts)]


def led_at_mm(design: Design) -> list[float]:
    """x of each LED's middle."""
    light = design.light
    shifts = [(k + 0.5) * light.pitch_mm - light.cut_mm / 2 for k in range(light.leds_per_cut)]
    return [x + shift for x in cut_middles_mm(design) for shift in shifts]


def strip_build(design: Design) -> Shape:
    """Strip, wires and LEDs as one solid in its own frame."""
    cq = require()
    light, (low, high) = design.light, strip_box(design)
    cuts = cq.Workplane().pushPoints([(x, 0.0) for x in cut_middles_mm(design)])
    body = cuts.rect(light.cut_mm, light.strip_width_mm).extrude(light.strip_thickness_mm)
    for side in (-1, 1):  # the wires, on the cuts' pads
        y = side * (light.strip_width_mm - WIRE_OUTER.mean_mm) / 2
        wire = cq.Workplane(origin=(0, y, 0)).rect(high[0] - low[0], WIRE_OUTER.mean_mm)
        body = body.union(wire.extrude(light.strip_thickness_mm))
    leds = cq.Workplane().pushPoints([(x, 0.0) for x in led_at_mm(design)])
    # From the strip's underside, so that the two overlap in a volume and not only a face.
    leds = leds.rect(light.led_width_mm, light.led_width_mm)
    return body.union(leds.extrude(light.strip_thickness_mm + light.led_height_mm)).val()


def strip_rules(d: Design) -> Iterator[Check]:
    """Rules of the LEDs' pitch and width on the strip."""
    light = d.light
    width = "led_width_mm", light.led_width_mm
    yield below("led-pitch", *width, "pitch = 1000 / leds_per_m", light.pitch_mm)
    yield at_most("led-on-strip", *width, "strip_width_mm", light.strip_width_mm)


def led_turns(d: Design) -> list[float]:
    """Angle of each LED about the lens's axis, from +x towards +y, in radians.

    The strip lies on the channel's outer wall, its gap in the middle of the wire slot at -y.
    """
    return [math.pi / 2 + x / d.strip_radius_mm for x in led_at_mm(d)]


PARTS = (
    Part(
        "light-holder",
        build,
        box,
        material="SLA resin, white, translucent",
        number=4,
        explode_mm=-28,
        colour=WHITE_RGBA,
        sections=("light", "shell", "holder", "camera"),
        derived=(
            "light_radius_mm", "strip_radius_mm", "channel_inner_mm", "light_bore_mm",
            "head_relief_mm", "peg_relief_mm", "peg_centres_mm", "camera_screw_centres_mm",
            "z_light_mm", "z_board_front_mm",
        ),
        rules=rules,
        fits=fits,
        wall_keys=("light.wall_mm", "light.diffuser_mm", "light.floor_mm"),
        in_view=True,
        callouts=callouts,
        pose=PrintPose(face="floor", tilt_deg=20, supports="under the floor only"),
        look_for="no resin left in the channel: blow it out before the post-cure; floor sanded",
    ),
    Part(
        "led-strip",
        strip_build,
        strip_box,
        material="LED strip, plain white, SMD 2835, uncoated (IP20), with its own resistors",
        process=BOUGHT_PROCESS,
        group="electronics",
        colour=AMBER_RGBA,
        sections=("light",),
        derived=("cut_step_mm",),
        rules=strip_rules,
        note="{d.light.supply_v:g} V DC, {d.light.leds_per_m:g} LEDs/m, {d.light.strip_w_per_m:g} "
        "W/m, {d.light.strip_width_mm:g} mm wide, LEDs at most {d.light.led_height_mm:g} mm high, "
        "cut every {d.light.leds_per_cut} LEDs = {d.light.cut_mm:.4g} mm: {d.light.cuts} cuts, "
        "{d.light.strip_mm:.4g} mm; order 1 m, the rest is spare",
        how="cut at the marks, joined by wire as in the wiring drawing",
        look_for="plus to plus; no solder above the LEDs",
    ),
)  # fmt: skip
