"""The acrylic plate under the press that it is made for; see `stiffness`."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from ..parts.light_holder import below_plate
from ..stiffness import bend, plate_of, press
from .built import BuiltDesign
from .row import Row

DEFLECTION = "plate deflection"
GEL = "plate.spread_mm"
SOFT = (GEL, "plate.youngs_modulus_mpa", "plate.bead_modulus_mpa")


def rows(built: BuiltDesign) -> Iterator[Row]:
    """Its deflection, whether it then rests on the light holder, the stress in it, the load.

    The depth that a stage counts includes the plate's deflection; a light holder that bears a press
    passes it on to the camera's board. The gel spreads no press beyond its own face.
    """
    design, plate, force_n = built.design, built.design.plate, built.design.plate.force_n
    found = press(design, force_n)
    bare = replace(plate_of(design), bead_mm=0.0)
    of_plate_mm = force_n * bend(bare, plate.spread_mm).deflection_mm
    bead_mm = found.deflection_mm - of_plate_mm
    limit_mm = plate.deflection_share * plate.depth_mm
    room_mm = below_plate(design).range_mm[0]
    face_mm = min(design.skin.width_mm, design.skin.length_mm)

    over_mm = found.over_ring_mm
    rests_n = force_n * max(room_mm, 0.0) / over_mm if over_mm > 0 else math.inf

    def row(name: str, found: str, passed: bool, limit: str, *keys: str) -> Row:
        return Row(name, "acrylic", found, limit, passed, keys)

    yield row(
        DEFLECTION,
        f"{found.deflection_mm:.3f} mm under {force_n:g} N, {bead_mm:.3f} of it the bead: "
        f"{100 * found.deflection_mm / plate.depth_mm:.1f} % of {plate.depth_mm:g} mm of depth",
        found.deflection_mm <= limit_mm,
        f"<= {limit_mm:.3g} mm (plate.deflection_share of plate.depth_mm)",
        *SOFT,
    )
    yield row(
        "plate clear of the light",
        f"bends {found.over_ring_mm:.3f} mm over the ring under {force_n:g} N, rests on it from "
        f"{rests_n:.0f} N",
        found.over_ring_mm <= room_mm,
        f"<= {room_mm:.3g} mm, the least play (light.axial_fit_mm)",
        *SOFT,
    )
    yield row(
        "plate stress",
        f"{found.stress_mpa:.1f} MPa under {force_n:g} N, the limit from "
        f"{force_n * plate.stress_limit_mpa / found.stress_mpa:.0f} N",
        found.stress_mpa <= plate.stress_limit_mpa,
        f"<= {plate.stress_limit_mpa:g} MPa (plate.stress_limit_mpa)",
        GEL,
        "plate.stress_limit_mpa",
    )
    yield row(
        "plate load",
        f"{force_n:g} N spread on a disc of {plate.spread_mm:g} mm",
        plate.spread_mm <= face_mm,
        f"<= {face_mm:g} mm, the face's shorter side (plate.spread_mm)",
        GEL,
    )
