"""Checks of the camera's view: angles by Snell's law, thin-lens focus, rays among the solids."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Check, find_file, graded, read_toml
from deltact_fab.sensor import LayeredPath

from ..dimensions import Design
from ..features import rounds_near
from ..parts.camera import off_axis_mm
from ..rays import Triangles
from .built import BuiltDesign
from .row import margin_check

BORDER_RAYS = 96  # by hand: fewer miss a small obstacle, more take longer
# By hand: the first face of the acrylic alone reflects 39 % there (Fresnel).
GRAZING_RAD = math.radians(80.0)
LENS_KEYS = ("camera.focal_length_mm", "camera.lens_height_mm")
FOCUS_PRESS_MM = 3.0  # by hand, depth of a usual press: deeper asks for a smaller aperture
BLUR_PX = 2.0  # by hand: Nyquist limit of the pixels; less would not be resolved
# By hand: up to a tenth finer than the camera, the rectified image still has what the pixels saw;
# finer claims what no pixel resolves.
RAW_SHARE = 1.1
CELL_PX = 2.0  # Nyquist: two pixels a cell, or neighbours merge
LIGHT_UM = 0.55  # middle of the visible spectrum (CIE 1931, luminosity)
PATTERN_NAME = "recommended"  # of patterns/: the guide prints it
CORNER_BLUR_PX = 5.0  # by hand: a third of the 16 px of a 0.6 mm dot, whose centre is still found


def view(design: Design) -> Iterator[Check]:
    """Check view angles against crop and acrylic, the visible share of the face, and focus."""
    optics, camera, skin = design.optics, design.camera, design.skin
    path = LayeredPath(optics.air_gap_mm, optics.acrylic_mm, skin.thickness_mm)
    view_x, view_y = optics.view_mm
    diagonal = math.hypot(view_x, view_y)
    crop_x, crop_y = camera.crop_half_mm
    crop = f"at the {camera.crop_width_px} x {camera.crop_height_px} crop"
    grazing = "(reflectance 1/3)"
    # The image of a corner lies on the diagonal: the crop's nearer side limits it.
    corner_mm = diagonal * min(crop_x / view_x, crop_y / view_y)
    for id, name, radius_mm, have, condition in (
        ("view-cone.x", "view cone, x", view_x / 2, camera.angle_rad(crop_x), crop),
        ("view-cone.y", "view cone, y", view_y / 2, camera.angle_rad(crop_y), crop),
        ("view-cone.corner", "view cone, corner", diagonal / 2, camera.angle_rad(corner_mm), crop),
        ("view-enters-acrylic", "view enters the acrylic", diagonal / 2, GRAZING_RAD, grazing),
    ):
        need = path.half_angle_rad(radius_mm)
        value = f"{radius_mm:.2f} mm off the axis: not visible at any angle"
        if math.isfinite(need):
            value = f"half angle {math.degrees(need):.1f} deg at {radius_mm:.2f} mm on the face"
        limit = f"<= {math.degrees(have):.1f} deg {condition}"
        yield margin_check(id, name, "camera", value, limit, have - need, LENS_KEYS)
    share = view_x * view_y / (skin.width_mm * skin.length_mm)
    value = f"{view_x:.1f} x {view_y:.1f} mm, {100 * share:.1f} % of the face"
    limit = f">= {100 * optics.least_view_share:g} % (optics.least_view_share)"
    name, margin = "view of the face", share - optics.least_view_share
    yield margin_check("view-share", name, "camera, skin", value, limit, margin)
    pixel_mm = raw_mm_per_px(design)
    value = f"{pixel_mm:.4f} mm a raw pixel in the middle of the face"
    limit = f"<= {RAW_SHARE:g} x {optics.mm_per_px:g} mm (optics.mm_per_px)"
    margin = RAW_SHARE * optics.mm_per_px - pixel_mm
    yield margin_check("raw-pixel", "raw pixel", "camera", value, limit, margin, LENS_KEYS)
    if cell_mm := read_toml(find_file("patterns", PATTERN_NAME)).get("patch_mm"):
        value = f"{cell_mm / pixel_mm:.1f} raw pixels a cell of {cell_mm:g} mm ({PATTERN_NAME})"
        limit, margin = f">= {CELL_PX:g}", cell_mm - CELL_PX * pixel_mm
        yield margin_check("pattern-cell", "pattern", "camera", value, limit, margin, LENS_KEYS)
    airy_px = 1.22 * LIGHT_UM * camera.f_number / (camera.pixel_um * camera.binning)
    value = f"radius of the Airy disc {airy_px:.2f} px, f/{camera.f_number:g}"
    limit, margin = f"<= {BLUR_PX:g} px", BLUR_PX - airy_px
    yield margin_check("diffraction", "diffraction", "camera", value, limit, margin, LENS_KEYS)
    edge_deg = math.degrees(camera.angle_rad(max(crop_x, crop_y)))
    value, limit = f"{edge_deg:.0f} deg off the axis {crop}", "<= 180 deg: a lens images no more"
    yield margin_check("field", "field of the lens", "camera", value, limit, 180 - edge_deg)
    focus_mm = _object_mm(design, 0.0, 0.0)
    if camera.nearest_mm:
        value = f"centre of the face at {focus_mm:.1f} mm"
        limit = f">= {camera.nearest_mm:g} mm (camera.nearest_mm)"
        margin = focus_mm - camera.nearest_mm
        yield margin_check("focus.nearest", "focus, nearest", "camera", value, limit, margin)
    scale = blur_scale(design)
    # A thin gel is pressed less.
    press_mm = min(FOCUS_PRESS_MM, design.plate.depth_mm)
    for id, place, radius_mm, depth_mm, most_px in (
        ("focus.corner", "corner of the view", diagonal / 2, 0.0, CORNER_BLUR_PX),
        ("focus.pressed", f"middle, {press_mm:g} mm deep", 0.0, press_mm, BLUR_PX),
    ):
        object_mm = _object_mm(design, radius_mm, depth_mm)
        blur_px = scale * abs(1 / object_mm - 1 / focus_mm)
        value = (
            f"circle of confusion {blur_px:.2f} px at {object_mm:.1f} mm, focused on the centre of "
            f"the face at {focus_mm:.1f} mm, f/{camera.f_number:g}"
        )
        limit, keys = f"<= {most_px:g} px", ("camera.f_number", *LENS_KEYS)
        yield margin_check(id, f"focus, {place}", "camera", value, limit, most_px - blur_px, keys)


def raw_mm_per_px(design: Design) -> float:
    """Length on the middle of the face that one pixel of the raw image covers."""
    return _object_mm(design, 0.0, 0.0) / design.focal_px


def blur_scale(design: Design) -> float:
    """Return the blur in px per 1/mm between the inverse distances of object and focus.

    Of a thin lens that is focused on the centre of the face.
    """
    camera, focus_mm = design.camera, _object_mm(design, 0.0, 0.0)
    px_per_mm = 1000 / (camera.pixel_um * camera.binning)
    share = focus_mm / (focus_mm - camera.focal_length_mm)
    return camera.focal_length_mm**2 / camera.f_number * share * px_per_mm


def sharp_depth_mm(design: Design) -> float:
    """Return the depth of a press in the middle of the face that is imaged with BLUR_PX."""
    focus_mm = _object_mm(design, 0.0, 0.0)
    *_, (_, index) = LayeredPath(0.0, 0.0, 0.0).layers
    return index * (focus_mm - 1 / (1 / focus_mm + BLUR_PX / blur_scale(design)))


def _object_mm(design: Design, radius_mm: float, depth_mm: float) -> float:
    """Optical object distance of a point of the face, each medium divided by its index.

    A fisheye maps directions: it is assumed to focus on a sphere about its pupil, a rectilinear
    lens on a plane across its axis.
    """
    optics, gel_mm = design.optics, design.skin.thickness_mm - depth_mm
    path = LayeredPath(optics.air_gap_mm, optics.acrylic_mm, gel_mm)
    sine = math.sin(min(path.half_angle_rad(radius_mm), math.pi / 2))
    distance_mm = sum(mm / math.sqrt(n**2 - sine**2 + 1e-12) for mm, n in path.layers)
    flat = design.camera.projection == "rectilinear"
    return distance_mm * math.sqrt(1 - sine**2) if flat else distance_mm


def light_cone(model: BuiltDesign) -> Iterator[Check]:
    """Trace rays to the border of the view, with the lens at its largest offset."""
    design = model.design
    # Air, acrylic and gel along the axis, from the solids.
    lens, acrylic, skin = model.box("camera")[1][2], model.box("acrylic"), model.box("skin")
    path = acrylic[0][2] - lens, acrylic[1][2] - acrylic[0][2], skin[1][2] - skin[0][2]
    border = _border_mm(*design.optics.view_mm)
    radius = np.linalg.norm(border, axis=1)
    angle = np.array([LayeredPath(*path).half_angle_rad(float(r)) for r in radius])
    rings = rounds_near(model.cylinders("light-holder"), 0.0, 0.0, 0.1)
    bore = min((c.radius_mm for c in rings if c.hole), default=0.0)
    limit = f"{BORDER_RAYS}/{BORDER_RAYS} rays reach the face"
    keys = ("camera.lens_height_mm",)
    if not np.isfinite(angle).all():
        misses = int((~np.isfinite(angle)).sum())
        value = f"{misses}/{BORDER_RAYS} rays are refracted away before the face"
        yield Check("light-cone", "light cone", "light-holder", value, limit, "fail", keys)
        return
    direction = border / radius[:, None]
    heights = np.cumsum([lens, *path])
    # Radii at the lens, acrylic's back and front, and the face.
    depths = ((0.0, 0.0, 0.0), (path[0], 0.0, 0.0), (path[0], path[1], 0.0), path)
    at_radius = [np.array([LayeredPath(*mm).reach_mm(float(a)) for a in angle]) for mm in depths]
    offset = off_axis_mm(design)
    points = [
        np.column_stack([direction * r[:, None], np.full(len(direction), z)])
        for r, z in zip(at_radius, heights, strict=True)
    ]
    names = [part.name for part in model.parts if part.in_view]

    def reach() -> int:
        corners = np.concatenate([model.mesh(name).corners_mm for name in names])
        triangles = Triangles(corners)
        blocked = np.zeros(len(direction), bool)
        for k, x, y in product(range(3), (-offset, offset), (-offset, offset)):
            start, end = points[k : k + 2]
            distance, _ = triangles.first_hit(start + (x, y, 0.0), end - start, 0.0)
            blocked |= distance < 1.0
        return BORDER_RAYS - int(blocked.sum())

    reached = model.fact("light cone", names, reach, [offset, [p.tolist() for p in points]])
    value = (
        f"{reached}/{BORDER_RAYS} rays, lens offset {offset:.2f} mm in x and y; radius "
        f"{at_radius[1].max():.2f} mm at the acrylic, bore {bore:.2f} mm"
    )
    passed = reached == BORDER_RAYS and at_radius[1].max() + offset * math.sqrt(2) <= bore
    yield Check("light-cone", "light cone", "light-holder", value, limit, graded(passed), keys)


def _border_mm(view_x: float, view_y: float) -> NDArray[np.float64]:
    """Return points (BORDER_RAYS, 2) along the border of the view, corners included."""
    t = np.arange(BORDER_RAYS // 4) / (BORDER_RAYS // 4) * 2 - 1
    ones = np.ones_like(t)
    sides = [(t, -ones), (ones, t), (-t, ones), (-ones, -t)]
    x, y = (np.concatenate([side[i] for side in sides]) for i in (0, 1))
    return np.column_stack([x * view_x / 2, y * view_y / 2])
