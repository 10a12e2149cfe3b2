"""The acrylic plate under the press that it is made for; see `stiffness`."""

from __future__ import annotations

from collections.abc import Iterator

from ..parts.light_holder import below_plate
from ..stiffness import press
from .built import BuiltDesign
from .row import Row

DEFLECTION = "plate deflection"
NAMES = (DEFLECTION, "plate clear of the light", "plate stress")
GEL = "plate.spread_mm"
MODULUS = "plate.youngs_modulus_mpa"
LIMIT = "plate.stress_limit_mpa"


def rows(built: BuiltDesign) -> Iterator[Row]:
    """How far it yields, whether it then rests on the light holder, and the stress in it.

    The depth that a stage counts is short of what the plate yields; a light holder that bears a
    press carries it on into the camera's board.
    """
    plate, force_n = built.design.plate, built.design.plate.force_n
    found = press(built.design, force_n)
    limit_mm = plate.deflection_share * plate.depth_mm
    yield Row(
        DEFLECTION,
        "acrylic",
        f"{found.deflection_mm:.3f} mm under {force_n:g} N: "
        f"{100 * found.deflection_mm / plate.depth_mm:.1f} % of {plate.depth_mm:g} mm of depth",
        f"<= {limit_mm:.3g} mm, {100 * plate.deflection_share:g} % (plate.deflection_share)",
        found.deflection_mm <= limit_mm,
        (GEL, MODULUS),
    )
    room_mm = below_plate(built.design).range_mm[0]
    yield Row(
        NAMES[1],
        "acrylic, light-holder",
        f"{found.over_ring_mm:.3f} mm over the ring under {force_n:g} N, rests on it from "
        f"{force_n * max(room_mm, 0.0) / found.over_ring_mm:.0f} N",
        f"<= {room_mm:.3g} mm, the least play (light.axial_fit_mm)",
        found.over_ring_mm <= room_mm,
        (GEL, MODULUS),
    )
    yield Row(
        NAMES[2],
        "acrylic",
        f"{found.stress_mpa:.1f} MPa under {force_n:g} N, the limit from "
        f"{force_n * plate.stress_limit_mpa / found.stress_mpa:.0f} N",
        f"<= {plate.stress_limit_mpa:g} MPa (plate.stress_limit_mpa)",
        found.stress_mpa <= plate.stress_limit_mpa,
        (GEL, LIMIT),
    )
