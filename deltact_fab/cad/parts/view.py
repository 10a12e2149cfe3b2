"""Rules of what the camera sees."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from ...optics import half_angle_rad
from ..dimensions import Design
from ..rule import Quantity, Rule

GRAZING_DEG = 80.0  # there the first face of the acrylic alone reflects 39 % (Fresnel)


def rules(d: Design) -> Iterator[Rule]:
    """View and light cone through air, acrylic and gel."""
    vx, vy = d.optics.view_mm
    path = d.optics.air_gap_mm, d.optics.acrylic_mm, d.skin.thickness_mm
    half = {"x": vx / 2, "y": vy / 2, "corner": math.hypot(vx, vy) / 2}
    angle = {name: half_angle_rad(r, *path) for name, r in half.items()}
    f, (cx, cy) = d.camera.focal_length_mm, d.camera.crop_half_mm
    rests_on = ("camera.focal_length_mm", "camera.lens_height_mm")
    corner_x, corner_y = (s / 2 / half["corner"] for s in (vx, vy))
    for name, seen, room in (
        ("focal length x half angle in x", f * angle["x"], cx),
        ("focal length x half angle in y", f * angle["y"], cy),
        ("focal length x half angle to the corner, along x", f * angle["corner"] * corner_x, cx),
        ("focal length x half angle to the corner, along y", f * angle["corner"] * corner_y, cy),
    ):
        yield Quantity(f"{name} (mm on the chip)", seen).at_most("half the crop", room, rests_on)
    degrees = math.degrees(min(angle["corner"], math.pi))
    yield Quantity("half angle to the corner in degrees", degrees).at_most(
        "what enters the acrylic well", GRAZING_DEG, ("camera.lens_height_mm",)
    )
    widest = d.optics.air_gap_mm * math.tan(min(angle["corner"], math.pi / 2 - 1e-6))
    cone = Quantity("view cone at the acrylic", widest).at_most(
        "bore radius", d.light_bore_mm, ("camera.lens_height_mm",)
    )
    yield replace(cone, part="light-holder")
    for size, side, px, key in (
        (vx, d.skin.width_mm, "optics.image_width_px", "skin.width_mm"),
        (vy, d.skin.length_mm, "optics.image_height_px", "skin.length_mm"),
    ):
        view = Quantity(f"view ({px} x mm_per_px)", size)
        yield replace(view.at_most(key, side), part="skin")
