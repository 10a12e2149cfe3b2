"""What the camera sees and what lights it: distances from the solids, angles by Snell's law."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ...errors import RunFailed
from ...optics import half_angle_rad, reached_mm
from ..features import Round, near
from ..rays import first_hit
from .built import BuiltDesign
from .row import Row

BORDER_RAYS = 96


def _path_mm(built: BuiltDesign) -> tuple[float, float, float]:
    """Air, acrylic and gel between lens and face, along the axis, from the solids."""
    acrylic, skin = built.box("acrylic"), built.box("skin")
    return (
        acrylic[0][2] - built.box("camera")[1][2],
        acrylic[1][2] - acrylic[0][2],
        skin[1][2] - skin[0][2],
    )


def view(built: BuiltDesign) -> Iterator[Row]:
    """The half angle under which the view's edges and corners stand, against what the crop sees."""
    design = built.design
    path = _path_mm(built)
    view_x, view_y = design.optics.view_mm
    diagonal = math.hypot(view_x, view_y)
    crop_x, crop_y = design.camera.crop_half_mm
    focal_mm = design.camera.focal_length_mm
    keys = ("camera.focal_length_mm", "camera.lens_height_mm")
    for name, radius_mm, chip_mm in (
        ("x", view_x / 2, crop_x),
        ("y", view_y / 2, crop_y),
        # The picture of a corner lies on the diagonal: the side that it leaves first counts.
        ("corner", diagonal / 2, diagonal * min(crop_x / view_x, crop_y / view_y)),
    ):
        need, have = half_angle_rad(radius_mm, *path), chip_mm / focal_mm
        found = f"{radius_mm:.2f} mm off the axis cannot be seen at any angle"
        if math.isfinite(need):
            found = f"half angle {math.degrees(need):.1f} deg for {radius_mm:.2f} mm on the face"
        crop = f"{design.camera.crop_width_px} x {design.camera.crop_height_px}"
        limit = f"<= {math.degrees(have):.1f} deg at the {crop} crop"
        yield Row(f"view cone, {name}", "camera", found, limit, need <= have + 1e-9, keys)


def light_cone(built: BuiltDesign) -> Iterator[Row]:
    """Rays from the lens to the border of the view, through air, acrylic and gel: none is met."""
    design = built.design
    path = _path_mm(built)
    border = _border_mm(*design.optics.view_mm)
    radius = np.linalg.norm(border, axis=1)
    angle = np.array([half_angle_rad(float(r), *path) for r in radius])
    bore = min((c.radius_mm for c in _rings(built) if c.hole), default=0.0)
    limit = f"{BORDER_RAYS} of {BORDER_RAYS} rays reach the face"
    keys = ("camera.lens_height_mm",)
    if not np.isfinite(angle).all():
        lost = int((~np.isfinite(angle)).sum())
        found = f"{lost} of {BORDER_RAYS} are bent away before the face"
        yield Row("light cone", "light-holder", found, limit, False, keys)
        return
    way = border / radius[:, None]
    lens = built.box("camera")[1][2]
    heights = np.cumsum([lens, *path])
    # Radii at acrylic's back and front; what is left of the path is gel.
    at_radius = [
        np.zeros(len(way)),
        np.array([reached_mm(float(a), path[0], 0.0, 0.0) for a in angle]),
        np.array([reached_mm(float(a), path[0], path[1], 0.0) for a in angle]),
        radius,
    ]
    corners = np.concatenate([built.mesh(p.name).corners_mm for p in built.parts if p.in_view])
    met = np.zeros(len(way), bool)
    for k in range(3):
        start, end = (
            np.column_stack([way * at_radius[j][:, None], np.full(len(way), heights[j])])
            for j in (k, k + 1)
        )
        far, _ = first_hit(start, end - start, corners, 0.0)
        met |= far < 1.0
    reached = BORDER_RAYS - int(met.sum())
    found = (
        f"{reached} of {BORDER_RAYS} reach it; radius {at_radius[1].max():.2f} mm at the acrylic, "
        f"bore {bore:.2f} mm"
    )
    passed = reached == BORDER_RAYS and at_radius[1].max() <= bore
    yield Row("light cone", "light-holder", found, limit, bool(passed), keys)


def _border_mm(view_x: float, view_y: float) -> NDArray[np.float64]:
    """Points (BORDER_RAYS, 2) round the border of the view, its corners among them."""
    t = np.arange(BORDER_RAYS // 4) / (BORDER_RAYS // 4) * 2 - 1
    one = np.ones_like(t)
    sides = [(t, -one), (one, t), (-t, one), (-one, -t)]
    x, y = (np.concatenate([side[i] for side in sides]) for i in (0, 1))
    return np.column_stack([x * view_x / 2, y * view_y / 2])


def strip(built: BuiltDesign) -> Iterator[Row]:
    """The LED strip on the outer wall of its channel, lying on the channel's floor."""
    design = built.design
    walls = [c for c in _rings(built) if c.hole]
    if len(walls) < 2:
        raise RunFailed("light-holder has no channel about its axis")
    outer = max(walls, key=lambda c: c.radius_mm)
    round_mm = 2 * math.pi * outer.radius_mm
    light = design.light
    yield Row(
        "LED strip length",
        "light-holder",
        f"{light.led_count} x {light.pitch_mm:.2f} = {light.strip_mm:.1f} mm",
        f"<= {round_mm:.1f} mm round the channel",
        light.strip_mm <= round_mm + 1e-9,
    )
    depth_mm = max(c.high_mm[2] for c in walls) - outer.low_mm[2]
    yield Row(
        "LED strip width",
        "light-holder",
        f"{light.strip_width_mm:.2f} mm",
        f"<= {depth_mm:.2f} mm deep channel",
        light.strip_width_mm <= depth_mm + 1e-9,
        ("camera.lens_height_mm",),
    )


def _rings(built: BuiltDesign) -> list[Round]:
    """The light holder's cylinders about the lens's axis."""
    return near(built.cylinders("light-holder"), 0.0, 0.0, 0.1)
