"""The acrylic plate under the press that it is made for; see `stiffness`."""

from __future__ import annotations

from collections.abc import Iterator

from ..parts.light_holder import below_plate
from ..stiffness import press
from .built import BuiltDesign
from .row import Row, open_keys

GEL = "plate.spread_mm"
MODULUS = "plate.youngs_modulus_mpa"
LIMIT = "plate.stress_limit_mpa"


def deflection(built: BuiltDesign) -> Iterator[Row]:
    """By how much of the depth the plate yields: the depth that a stage counts is short of it."""
    design, plate = built.design, built.design.plate
    found_mm = press(design, plate.force_n).deflection_mm
    limit_mm = plate.deflection_share * plate.depth_mm
    yield Row(
        "plate deflection",
        "acrylic",
        f"{found_mm:.3f} mm under {plate.force_n:g} N: {100 * found_mm / plate.depth_mm:.1f} % of "
        f"{plate.depth_mm:g} mm of depth",
        f"<= {limit_mm:.3g} mm, {100 * plate.deflection_share:g} % (plate.deflection_share)",
        found_mm <= limit_mm,
        open_keys(design.unverified(), GEL, MODULUS),
    )


def clear(built: BuiltDesign) -> Iterator[Row]:
    """The light holder bears no press: it would carry it on into the camera's board."""
    design, force_n = built.design, built.design.plate.force_n
    found_mm, room_mm = press(design, force_n).over_light_mm, below_plate(design).range_mm[0]
    yield Row(
        "plate clear of the light",
        "acrylic, light-holder",
        f"{found_mm:.3f} mm over the ring under {force_n:g} N, rests on it from "
        f"{force_n * max(room_mm, 0.0) / found_mm:.0f} N",
        f"<= {room_mm:.3g} mm, the least play (light.axial_fit_mm)",
        found_mm <= room_mm,
        open_keys(design.unverified(), GEL, MODULUS),
    )


def stress(built: BuiltDesign) -> Iterator[Row]:
    """Bending stress under the press."""
    design, plate = built.design, built.design.plate
    found_mpa = press(design, plate.force_n).stress_mpa
    yield Row(
        "plate stress",
        "acrylic",
        f"{found_mpa:.1f} MPa under {plate.force_n:g} N, the limit from "
        f"{plate.force_n * plate.stress_limit_mpa / found_mpa:.0f} N",
        f"<= {plate.stress_limit_mpa:g} MPa (plate.stress_limit_mpa)",
        found_mpa <= plate.stress_limit_mpa,
        open_keys(design.unverified(), GEL, LIMIT),
    )
