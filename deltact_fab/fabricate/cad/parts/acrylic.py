"""Part 2, the acrylic plate behind the skin (paper, Tactile Subsystem: rectangle, 2 mm thick).

   +--------------------+          z = -thickness (ledge) to the joint, 2 mm
   |                    |   y
+--+                    +--+  ^    Its y edges lie between the frame's ledge and the shell's, its
|                          |  |    x edges on the shell's. The corners are notched around the
+--+                    +--+  +->  frame's posts; where the walls hold the posts it is the
   |                    |      x   paper's rectangle.
   +--------------------+
"""

from __future__ import annotations

from collections.abc import Iterator

from ..dimensions import Design
from ..drafting.dimensioning import Callouts, x_of, y_of, z_of
from ..kernel import Extent, Shape, around, prism, without_corners
from ..part import CLEAR_RGBA, LASER_CUT, Part
from ..rule import Length, PlayFit


def box(design: Design) -> Extent:
    """The plate's rectangle, from the joint to the frame's ledge."""
    return around(*design.acrylic_half_mm, design.z_joint_mm, design.z_ledge_mm)


def build(design: Design) -> Shape:
    """The plate as one solid in the sensor frame, z from the joint to the ledge."""
    (w, h), (x, y) = design.acrylic_half_mm, design.acrylic_notch_mm
    return prism(
        without_corners((w, h), (w - x, h - y)), design.z_joint_mm, design.optics.acrylic_mm
    ).val()


def fits(d: Design) -> Iterator[PlayFit]:
    """Fits in the frame's pocket, around its posts, and between the ledges of frame and shell."""
    parts, printer, laser = "acrylic, skin-frame", d.resin_printer, d.laser
    for i, axis in enumerate("xy"):
        pocket = printer.inner(2 * d.seat_half_mm[i])
        plate = laser.cut(2 * d.acrylic_half_mm[i])
        yield PlayFit(f"pocket-{axis}", f"plate in its pocket, {axis}", parts, (pocket,), (plate,))
    for i, axis in enumerate("xy"):
        if d.acrylic_notch_mm[i] > 0:
            posts = printer.inner(2 * d.post_edge_mm[i])
            neck = laser.cut(2 * (d.acrylic_half_mm[i] - d.acrylic_notch_mm[i]))
            name = f"plate between the posts, {axis}"
            yield PlayFit(f"neck-{axis}", name, parts, (posts,), (neck,))
    # A plate that is too thick holds the joint open; a bead of adhesive fills the rest.
    high = printer.tall(d.optics.acrylic_mm), printer.tall(d.shell.ledge_drop_mm)
    thick, name = laser.sheet(d.optics.acrylic_mm), "plate between the ledges, z"
    yield PlayFit("between-ledges", name, "acrylic, skin-frame, shell", high, (thick,))
    # A plate at one end of its pocket has the least support at the other.
    opening, pocket = printer.inner(d.skin.length_mm), printer.inner(2 * d.seat_half_mm[1])
    plate, name = laser.cut(2 * d.acrylic_half_mm[1]), "plate on the frame's ledge, y"
    halves = opening.half(), pocket.half()
    yield PlayFit("frame-ledge", name, parts, (plate,), halves, d.plate.ledge_mm)
    # The screws' clearance lets the shell shift against the frame.
    hole = printer.inner(d.screw.row.clearance_mm)
    shank = Length(-d.screw.row.thread_mm)
    for i, key in enumerate(("ledge_x_mm", "ledge_mm")):
        if getattr(d.shell, key) == 0:
            continue
        behind, pocket = printer.inner(2 * d.ledge_half_mm[i]), printer.inner(2 * d.seat_half_mm[i])
        plate, name = laser.cut(2 * d.acrylic_half_mm[i]), f"plate on the shell's ledge, {'xy'[i]}"
        overlap = behind.half(), pocket.half(), hole.half(), shank.half()
        id = f"shell-ledge-{'xy'[i]}"
        yield PlayFit(id, name, "acrylic, shell", (plate,), overlap, d.plate.ledge_mm)


def callouts(d: Design) -> Callouts:
    """Drawing content: outline, notches, thickness."""
    (x, y), (nx, ny) = d.acrylic_half_mm, d.acrylic_notch_mm
    lengths = [x_of(-x, x), y_of(-y, y), z_of(d.z_joint_mm, d.z_ledge_mm)]
    if nx > 0:
        lengths += [x_of(nx - x, x - nx), y_of(ny - y, y - ny)]
    notes = (
        "Cut from cast PMMA, clear on both faces; protective film stays on until bonding.",
        f"Plan dimensions are those of the finished plate. {d.laser.path}",
    )
    return Callouts(tuple(lengths), notes=notes)


def note(d: Design) -> str:
    """The size of the plate."""
    x, y = d.acrylic_half_mm
    size = f"{2 * x:g} x {2 * y:g} x {d.optics.acrylic_mm:g} mm"
    return f"{size}, notched corners" if any(d.acrylic_notch_mm) else size


PARTS = (
    Part(
        "acrylic",
        build,
        box,
        material="cast PMMA, clear",
        process=LASER_CUT,
        number=2,
        explode_mm=14,
        colour=CLEAR_RGBA,
        sections=("skin", "frame", "optics", "plate", "screw", "shell", "laser"),
        derived=("acrylic_half_mm", "acrylic_notch_mm", "z_ledge_mm", "z_joint_mm"),
        fits=fits,
        callouts=callouts,
        note=note,
        how="cut to the DXF, step C",
        look_for="the edges are clear and without cracks",
    ),
)
