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
alone; the rest of the skin fills the frame's window. On both y sides of a seat is a notch, as deep
as the seat, for the blade that lifts the frame out. No wall has draft: the silicone is flexible.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from deltact_fab.common import Check, Point2

from ..dimensions import Design
from ..drafting.dimensioning import Callouts, Leader, fmt, x_of, y_of, z_of
from ..kernel import Extent, Shape, around, cuboid, require
from ..part import AMBER_RGBA, RESIN_MATERIAL, Part, PrintPose
from ..rule import PlayFit, at_most, below

# Used by the mold's drawing and the guide.
RELEASE_AGENT = "No release agent: it would lie between skin, film and coats."
# By hand, least and most of a floor: wet sanding and a coat of lacquer make no finer ones; rougher
# than SLA prints, or less flat than a print on edge, every skin is.
FLOOR_FLATNESS_MM, ROUGHNESS_UM = (0.02, 0.2), (0.1, 3.2)
# On edge: lying, each cavity would be a suction cup; upside down, its floor would need supports.
MOLD_POSE = PrintPose(face="edge at -y", tilt_deg=90)


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


def box(design: Design) -> Extent:
    """Bounding box of the block."""
    x, y, z = design.mold_outer_mm
    return around(x / 2, y / 2, 0.0, z)


def build(design: Design) -> Shape:
    """The mold as one solid in its own frame, z from 0 to its top."""
    cq = require()
    cutter = _cutter(design)
    cutters = [cutter.moved(cq.Location((*centre, 0.0))) for centre in centres_mm(design)]
    return cuboid(box(design)).val().cut(*cutters)


def _cutter(design: Design) -> Any:
    """Return the cutter of one skin and frame: cavity, seat, notches; 1 mm above the top."""
    mold, skin = design.mold, design.skin
    floor, top = mold.base_mm + skin.protrusion_mm, design.mold_outer_mm[2] + 1
    x, y = (side / 2 for side in seat_mm(design))
    cavity = cuboid(around(skin.width_mm / 2, skin.length_mm / 2, mold.base_mm, floor + 1))
    cavity = cavity.faces("<Z").edges().fillet(skin.edge_fillet_mm)
    notches = cuboid(around(mold.pry_width_mm / 2, y + mold.pry_mm, floor, top))
    return cavity.union(cuboid(around(x, y, floor, top))).union(notches).val()


def rules(d: Design) -> Iterator[Check]:
    """Rules of the seat's depth, the notches, and what a floor can be."""
    mold = d.mold
    for key, value, unit, (finest, coarsest) in (
        ("floor_flatness_mm", mold.floor_flatness_mm, "mm", FLOOR_FLATNESS_MM),
        ("floor_roughness_um", mold.floor_roughness_um, "um", ROUGHNESS_UM),
    ):
        yield at_most(f"{key}-least", f"finest with a coat, {unit}", finest, key, value)
        yield at_most(key, key, value, f"coarsest face, {unit}", coarsest)
    yield below("seat", "seat_mm", mold.seat_mm, "frame height", d.frame_height_mm)
    yield below("pry", "fit_mm + pry_mm", mold.fit_mm + mold.pry_mm, "web_mm / 2", mold.web_mm / 2)


def fits(d: Design) -> Iterator[PlayFit]:
    """Fits of the frame in its seat."""
    for i, axis in enumerate("xy"):
        seat = d.resin_printer.inner(seat_mm(d)[i])
        frame = d.resin_printer.outer(d.frame_outer_mm[i])
        name = f"frame in its seat, {axis}"
        yield PlayFit(f"seat-{axis}", name, "mold, skin-frame", (seat,), (frame,))


def callouts(d: Design) -> Callouts:
    """Drawing content: mold, section through one column of cavities."""
    mold, skin = d.mold, d.skin
    fx, fy = d.frame_outer_mm
    centres = centres_mm(d)
    (cx, cy), w, h = min(centres), skin.width_mm / 2, skin.length_mm / 2
    sx, sy = fx / 2 + mold.fit_mm, fy / 2 + mold.fit_mm
    pry, floor = mold.pry_width_mm / 2, mold.base_mm
    lengths = (
        x_of(cx - sx, cx + sx),
        y_of(cy - sy, cy + sy),
        x_of(cx - w, cx + w, fitted=False),
        y_of(cy - h, cy + h, fitted=False),
        x_of(cx - pry, cx + pry, fitted=False),
        y_of(cy - sy - mold.pry_mm, cy + sy + mold.pry_mm, fitted=False),
        z_of(floor, floor + skin.protrusion_mm),
    )
    flat, rough = fmt(mold.floor_flatness_mm), fmt(mold.floor_roughness_um)
    words = f"floor, the touched face, flat within {flat}, Ra {rough}"
    touched = Leader("left", (cx, cy + h / 2, floor), 0, words)
    notes = (
        f"{mold.columns} × {mold.rows} equal cavities. Floors smooth: they form the touched face. "
        + RELEASE_AGENT,
        "Floors as printed are rougher: lap each flat with 600 grit on a block, wet, then "
        "post-cure and coat; the coat must reach Ra. Cast a coupon first. Vertical corners sharp.",
    )
    rounds = {2 * skin.edge_fillet_mm: "all around the floors"}
    axes = sorted({(0, x) for x, _ in centres} | {(1, y) for _, y in centres})
    return Callouts(lengths, rounds, (), notes, (touched,), tuple(axes), cx)


PARTS = (
    Part(
        "mold",
        build,
        box,
        material=RESIN_MATERIAL,
        group="tools",
        colour=AMBER_RGBA,
        sections=("mold", "skin", "frame"),
        derived=("mold_outer_mm", "frame_outer_mm"),
        rules=rules,
        fits=fits,
        wall_keys=("shell.wall_mm",),
        callouts=callouts,
        pose=MOLD_POSE,
        note="casts {d.mold.columns} x {d.mold.rows} skins at a time",
        look_for="cavity floors glossy: every skin copies their defects",
    ),
)
