"""Volumes of parts by closed forms: what every solid is held against, beside its own builder.

They read a design's numbers and derived lengths, as the builders do, so they judge the shapes that
a kernel makes of them and not the numbers.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltact_fab.fabricate.cad.build import build_part
from deltact_fab.fabricate.cad.dimensions import Design
from deltact_fab.fabricate.cad.kernel import VOLUME_TOLERANCE, SolidProperties
from deltact_fab.fabricate.cad.part import Part
from deltact_fab.fabricate.cad.parts import coupons, indenter, mount, on_table
from deltact_fab.sensor.shapes.prism import PrismTip
from deltact_fab.sensor.shapes.rigid import Tip
from deltact_fab.sensor.shapes.tips import EllipsoidTip, RidgeTip, SphereTip
from deltact_fab.sensor.shapes.turned import TurnedTip

Array = NDArray[np.float64]


def held(part: Part, design: Design) -> tuple[Any, SolidProperties]:
    """The part as build_part gives it, its volume held against its closed form."""
    solid, found = build_part(part, design)
    low, high = volume_mm3(part, design)
    slack = VOLUME_TOLERANCE * high
    assert low - slack <= found.volume_mm3 <= high + slack, (part.name, found.volume_mm3, low, high)
    return solid, found


def volume_mm3(part: Part, design: Design) -> tuple[float, float]:
    """Lowest and highest volume; equal where a closed form is exact."""
    if part.indenter is not None:
        return indenter_mm3(part.indenter)
    if part.name == "tool-holder":
        return tool_holder_mm3(design)
    if part.name in BOUGHT:
        return 0.0, math.inf
    return (FORMS[part.name](design),) * 2


def plain(d: float) -> float:
    """Area of a disc by its diameter."""
    return math.pi / 4 * d**2


def band_mm2(half_width_mm: float, radius_mm: float) -> float:
    """Area of the disc within |x| <= half_width, at most its radius."""
    h, r = min(half_width_mm, radius_mm), radius_mm
    return 2 * (h * math.sqrt(r**2 - h**2) + r**2 * math.asin(h / r))


def segment_mm2(from_mm: float, radius_mm: float) -> float:
    """Area of the disc beyond x = from_mm, which lies within the disc."""
    c, r = from_mm, radius_mm
    return r**2 * math.acos(c / r) - c * math.sqrt(r**2 - c**2)


def cone_segment_mm3(
    from_mm: float, low_radius_mm: float, high_radius_mm: float, height_mm: float
) -> float:
    """Volume beyond the plane x = from_mm of a cone's frustum whose axis is z, at x = 0.

    The segment's area, which is also a function of the radius alone, integrated along the height.
    """

    def integral(r: float) -> float:
        q = math.sqrt(r**2 - c**2)
        return r**3 / 3 * math.acos(c / r) - 2 / 3 * c * r * q + c**3 / 3 * math.log(r + q)

    c = from_mm
    rise = height_mm / (low_radius_mm - high_radius_mm)
    return rise * (integral(low_radius_mm) - integral(high_radius_mm))


def common_circles_mm2(a_mm: float, b_mm: float, apart_mm: float) -> float:
    """Area that two discs of radii a and b share, their centres apart_mm apart."""
    if apart_mm >= a_mm + b_mm:
        return 0.0
    small, large = sorted((a_mm, b_mm))
    if apart_mm <= large - small:
        return math.pi * small**2
    # Each disc gives the segment beyond the common chord, which may lie beyond its centre.
    chord = (apart_mm**2 + a_mm**2 - b_mm**2) / (2 * apart_mm)
    return segment_mm2(chord, a_mm) + segment_mm2(apart_mm - chord, b_mm)


def acrylic_mm3(d: Design) -> float:
    """(Rectangle - 4 notches) x thickness."""
    (w, h), (nx, ny) = d.acrylic_half_mm, d.acrylic_notch_mm
    return 4 * (w * h - nx * ny) * d.optics.acrylic_mm


def window_mm3(d: Design) -> float:
    """The frame's window in front of the ledge = (width x length - 4 post corners) x depth."""
    x_mm, y_mm = d.post_in_window_mm
    area_mm2 = d.skin.width_mm * d.skin.length_mm - 4 * x_mm * y_mm
    return area_mm2 * (d.skin.thickness_mm - d.skin.protrusion_mm)


def skin_frame_mm3(d: Design) -> float:
    """Block - window - the acrylic's pocket, less what the posts take of it - 4 pilots."""
    (x, y), (px, py), (outer_x, outer_y) = d.seat_half_mm, d.post_edge_mm, d.frame_outer_mm
    pocket_mm2 = 4 * (x * y - max(x - px, 0.0) * max(y - py, 0.0))
    pilots = 4 * plain(d.screw.row.pilot_mm) * d.screw.pilot_depth_mm
    pocket = pocket_mm2 * d.optics.acrylic_mm
    return outer_x * outer_y * d.frame_height_mm - pilots - window_mm3(d) - pocket


def bare_mm3(d: Design) -> float:
    """Tube + posts beyond the wall - holes - wall beside the bosses + ledges - cable notch."""
    shell, (outer_x, outer_y) = d.shell, d.frame_outer_mm
    (x, y), wall, room = d.cavity_half_mm, shell.wall_mm, d.boss_room_mm
    volume = (outer_x * outer_y - 4 * x * y) * d.shell_depth_mm
    post_mm2 = (d.post_mm - wall) ** 2 - plain(d.screw.row.clearance_mm)
    volume += 4 * post_mm2 * (d.z_joint_mm - d.z_boss_mm)
    volume -= 4 * (2 * room - wall) * wall * (d.z_boss_mm - d.z_floor_mm)
    (px, py), (ledge_x, ledge_y) = d.post_edge_mm, d.ledge_reach_mm
    carried_mm = shell.ledge_height_mm - shell.ledge_drop_mm
    volume += 4 * (px * ledge_y + py * ledge_x) * carried_mm
    return volume - shell.cable_width_mm * shell.cable_height_mm * wall


def mount_mm3(d: Design) -> float:
    """Cuboids - two holes and counterbores - what the cover's bosses take on both sides."""
    m, cuboids = d.mount, mount.bars(d)
    volume = sum(math.prod(b - a for a, b in zip(*box, strict=True)) for box in cuboids)
    volume -= plain(m.hole_mm) * sum(math.dist(*axis) for axis in mount.hole_axes(d))
    if m.kind == "franka":
        volume -= 2 * (plain(m.counterbore_mm) - plain(m.hole_mm)) * m.counterbore_depth_mm
    (_, _, low), (x, _, high) = cuboids[0]
    width_mm = max(x - (d.frame_outer_mm[0] / 2 - d.boss_room_mm), 0.0)
    return volume - 2 * width_mm * max(min(high, d.z_boss_mm) - low, 0.0) * d.cover.fit_mm


def testing_shell_mm3(d: Design) -> float:
    """Bare shell + two tabs = cuboids - holes - what clears the cover."""
    table, fit = d.table, d.cover.fit_mm
    beside_mm = max(table.width_mm / 2 - (d.frame_outer_mm[1] / 2 - d.boss_room_mm), 0.0)
    boss_mm = max(min(d.z_boss_mm, d.z_back_mm + table.height_mm) - d.z_floor_mm, 0.0)
    tab = (table.tab_mm * table.width_mm - 2 * plain(table.hole_mm)) * table.height_mm
    tab -= fit * (table.width_mm * d.cover.floor_mm + 2 * beside_mm * boss_mm)
    return bare_mm3(d) + 2 * tab


def camera_holder_mm3(d: Design) -> float:
    """(Arms + tongue - window - holes) x thickness."""
    half_x, arm, (tongue, top) = d.holder_half_x_mm, d.holder_arm_mm, d.holder_tongue_mm
    area_mm2 = 4 * half_x * arm + 2 * tongue * max(top - arm, 0.0)
    area_mm2 -= 2 * d.holder_window_half_mm * (arm + d.holder_window_top_mm)
    area_mm2 -= 4 * plain(d.cover.hole_mm) + 2 * plain(d.holder.row.pilot_mm)
    return area_mm2 * d.holder.clearance_mm


def cover_mm3(d: Design) -> float:
    """Floor + bosses - holes + legs; a leg = shaft, lip and lead-in, each beyond half the slot."""
    row, cover, (outer_x, outer_y) = d.screw.row, d.cover, d.frame_outer_mm
    volume = outer_x * outer_y * cover.floor_mm
    volume += 4 * d.post_mm**2 * (d.z_boss_mm - d.z_floor_mm)
    volume -= 4 * plain(row.bore_mm) * (d.z_head_mm - d.z_back_mm)
    volume -= 4 * plain(row.clearance_mm) * (d.z_boss_mm - d.z_head_mm)
    half_slot, peg, hole = cover.slot_mm / 2, cover.peg_mm / 2, cover.hole_mm / 2
    shaft = segment_mm2(half_slot, peg) - segment_mm2(half_slot + cover.leg_mm, peg)
    beyond, high = half_slot - cover.lip_mm, cover.lip_height_mm / 2
    leg = shaft * d.peg_leg_mm + segment_mm2(beyond, hole) * high
    leg += cone_segment_mm3(beyond, hole, peg - cover.lip_mm, high)
    return volume + 8 * leg


def light_holder_mm3(d: Design) -> float:
    """Ring - channel - slot - reliefs, also where one meets the ring's edge or misses it."""
    light, radius, strip = d.light, d.light_radius_mm, d.strip_radius_mm
    inner, bore = d.channel_inner_mm, d.light_bore_mm
    height_mm = d.z_light_mm - d.z_board_front_mm
    depth_mm = height_mm - light.floor_mm
    volume = math.pi * (radius**2 - bore**2) * height_mm
    volume -= math.pi * (strip**2 - inner**2) * depth_mm
    half = light.slot_mm / 2
    volume -= (band_mm2(half, radius) - band_mm2(half, strip)) / 2 * depth_mm
    reliefs = [(at, d.head_relief_mm) for at in d.camera_screw_centres_mm]
    reliefs += [(at, d.peg_relief_mm) for at in d.peg_centres_mm]
    for at, r in reliefs:
        away = math.hypot(*at)
        met_mm2 = common_circles_mm2(r, radius, away) - common_circles_mm2(r, bore, away)
        volume -= met_mm2 * light.floor_mm
    return volume


def cavity_mm3(d: Design) -> float:
    """One cavity of the mold = skin - the frame's window, which the frame brings along."""
    return d.skin_volume_mm3 - window_mm3(d)


def mold_mm3(d: Design) -> float:
    """Block - cavities, seats and notches."""
    m, (x, y) = d.mold, (side + 2 * d.mold.fit_mm for side in d.frame_outer_mm)
    cut = cavity_mm3(d) + (x * y + 2 * m.pry_width_mm * m.pry_mm) * m.seat_mm
    return math.prod(d.mold_outer_mm) - m.columns * m.rows * cut


def stage_plate_mm3(d: Design) -> float:
    """Plate - four slots - four threads."""
    plate = d.stage_plate
    slot_mm2 = plate.slot_mm * plate.slot_travel_mm + plain(plate.slot_mm)
    open_mm2 = 4 * slot_mm2 + 4 * plain(plate.thread_hole_mm)
    return (math.prod(on_table.sides_mm(d)) - open_mm2) * plate.thickness_mm


def adapter_mm3(d: Design) -> float:
    """A disc with holes."""
    plate, tool, high = d.adapter, d.tool, d.adapter.thickness_mm
    through = plain(tool.flange_diameter_mm) - 4 * plain(plate.pilot_mm) - plain(tool.pin_mm - 0.2)
    sunk = plate.bolt_bore_depth_mm
    bolt = plain(plate.bolt_hole_mm) * (high - sunk) + plain(plate.bolt_bore_mm) * sunk
    return through * high - 3 * bolt


def fit_coupon_mm3(d: Design) -> float:
    """Base - holes - slots + block + peg."""
    c = d.fit_coupon
    plan_mm2 = math.prod(c.outer_mm) - sum(plain(size) + size * c.slot_mm for size in c.sizes_mm)
    peg = plain(c.peg_mm) * c.peg_height_mm
    return plan_mm2 * c.base_mm + c.block_mm**2 * c.block_height_mm + peg


def coupon_mold_mm3(d: Design) -> float:
    """Block - wells."""
    c = d.coupon
    x, y, z = coupons.well_box(d)[1]
    return 4 * x * y * z - c.wells * plain(c.diameter_mm) * c.depth_mm


BOUGHT = {"camera", "camera-screw", "led-strip", "screw", "nano17"}
"""Drawn to see whether they fit: nobody makes their volume."""

FORMS: dict[str, Callable[[Design], float]] = {
    "skin": lambda d: d.skin_volume_mm3,
    "skin-frame": skin_frame_mm3,
    "transparent-base": skin_frame_mm3,
    "acrylic": acrylic_mm3,
    "shell": lambda d: bare_mm3(d) + mount_mm3(d),
    "testing-shell": testing_shell_mm3,
    "camera-holder": camera_holder_mm3,
    "light-holder": light_holder_mm3,
    "cover": cover_mm3,
    "mold": mold_mm3,
    "coupon-mold": coupon_mold_mm3,
    "fit-coupon": fit_coupon_mm3,
    "kerf-coupon": lambda d: d.kerf_coupon.length_mm * d.kerf_coupon.width_mm * d.optics.acrylic_mm,
    "stage-plate": stage_plate_mm3,
    "nano17-adapter": adapter_mm3,
}


def tool_holder_mm3(d: Design) -> tuple[float, float]:
    """Body + flange - D bore - holes - the set screw's hole, a cylinder across two others.

    Its chords times the way between the circles, by Gauss's rule. The kernel integrates over faces
    that end in the curve of two cylinders to some 1e-3.
    """
    tool, radius = d.tool, d.tool.clamp_mm / 2
    nodes, weights = np.polynomial.legendre.leggauss(60)
    angle = nodes * math.pi / 2
    y = radius * np.sin(angle)
    way = np.sqrt((tool.body_mm / 2) ** 2 - y**2) - np.sqrt(tool.bore_mm**2 - y**2)
    clamp = float(math.pi / 2 * np.sum(weights * 2 * radius**2 * np.cos(angle) ** 2 * way))
    volume = plain(tool.body_mm) * (tool.height_mm - tool.flange_mm) - clamp
    drilled_mm2 = 4 * plain(tool.screw_hole_mm) + plain(tool.pin_mm + tool.pin_fit_mm)
    volume += (plain(tool.flange_diameter_mm) - drilled_mm2) * tool.flange_mm
    bore_mm2 = math.pi * tool.bore_mm**2 - segment_mm2(tool.flat_mm, tool.bore_mm)
    volume -= bore_mm2 * tool.depth_mm
    return volume - 1e-3 * clamp, volume + 1e-3 * clamp


def indenter_mm3(dims: Any) -> tuple[float, float]:
    """Plate + stem + tips; tips that may share a volume give bounds: one of them, and the sum."""
    shape, plate_z = dims.indenter, dims.indenter.reach_mm
    x, y = indenter.plate_half_mm(dims)
    plate_mm2 = 4 * x * y - (4 - math.pi) * indenter.corner_mm(dims) ** 2
    if radius := indenter.round_plate_mm(dims):
        plate_mm2 = math.pi * radius**2
    stem_mm2 = plain(shape.stem_diameter_mm)
    stem_mm2 -= segment_mm2(shape.stem_flat_at_mm, shape.stem_diameter_mm / 2)
    solid = plate_mm2 * dims.body.plate_mm + stem_mm2 * shape.stem_length_mm
    tips = [tip_mm3(t, plate_z) for t in shape.tips]
    disjoint = all(_apart(a, b) for a, b in itertools.combinations(shape.tips, 2))
    return solid + (sum(tips) if disjoint else max(tips)), solid + sum(tips)


def _apart(a: Tip, b: Tip) -> bool:
    """Whether two tips surely share no volume; spheres by their distance, others by their boxes."""
    dx, dy = abs(a.x_mm - b.x_mm), abs(a.y_mm - b.y_mm)
    if isinstance(a, SphereTip) and isinstance(b, SphereTip):
        return math.hypot(dx, dy) >= a.radius_mm + b.radius_mm
    return dx >= a.half_mm[0] + b.half_mm[0] or dy >= a.half_mm[1] + b.half_mm[1]


def tip_mm3(tip: Tip, length_mm: float) -> float:
    """Volume of a tip and its shank up to z = length_mm."""
    match tip:
        case SphereTip():  # half a ball, a cylinder
            return math.pi * tip.radius_mm**2 * (length_mm - tip.radius_mm / 3)
        case EllipsoidTip():
            return math.pi * tip.a_mm * tip.b_mm * (length_mm - tip.b_mm / 3)
        case RidgeTip():
            return _ridge_mm3(tip, length_mm)
        case PrismTip():
            # What the rounded edge takes, over curves parallel to the outline: at inset t they
            # are shorter by 2 pi t.
            x, y, dx, dy = along(*tip.outline())
            area, perimeter = float(np.sum(x * dy - y * dx)) / 2, float(np.sum(np.hypot(dx, dy)))
            rho = tip.edge_mm
            first = rho**2 * (1 - math.pi / 4)
            second = rho * first - rho**3 / 6
            return area * length_mm - perimeter * first + 2 * math.pi * second
        case TurnedTip():  # shells over the underside
            d, z, step, _ = along(*tip.profile())
            return float(np.sum(2 * math.pi * d * (length_mm - z) * step))


def _ridge_mm3(tip: RidgeTip, length_mm: float) -> float:
    """Extruded middle, turned ends."""
    r, n, w = tip.radius_mm, tip.nose_half_mm, tip.half_width_mm
    alpha = math.radians(tip.flank_deg)
    run, rise = w - n, tip.equator_mm - tip.nose_height_mm
    # Below the underside, over one half of the profile: nose, then flank.
    area = r * n - (n * r * math.sin(alpha) + r**2 * (math.pi / 2 - alpha)) / 2
    area += run * (tip.nose_height_mm + rise / 2)
    turned = r * n**2 - 2 / 3 * (r**3 - (r * math.sin(alpha)) ** 3)
    turned += tip.nose_height_mm * (w**2 - n**2) + rise * run * (n + 2 / 3 * run)
    return 2 * (w * length_mm - area) * tip.length_mm + math.pi * (w**2 * length_mm - turned)


def along(
    start: tuple[float, float], drawn: Sequence[tuple[str, Any]]
) -> tuple[Array, Array, Array, Array]:
    """Points (n,) and (n,) along lines and three-point arcs, and their steps, by Gauss's rule."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    t, w = (nodes + 1) / 2, weights / 2
    found, at = [], complex(*start)
    for kind, points in drawn:
        middle, end = complex(*points[0]), complex(*points[-1])
        if kind == "line":
            p, step = at + t * (end - at), np.full_like(t, 1) * (end - at)
        else:
            # Centre of the circle through three points.
            a, b = middle - at, end - at
            centre = at + (a * abs(b) ** 2 - b * abs(a) ** 2) / (a.conjugate() * b).imag * 0.5j
            ways = (middle - centre) / (at - centre), (end - centre) / (middle - centre)
            turn = float(sum(map(np.angle, ways)))
            p = centre + (at - centre) * np.exp(1j * turn * t)
            step = 1j * turn * (p - centre)
        found.append((p.real, p.imag, w * step.real, w * step.imag))
        at = end
    x, y, dx, dy = (np.concatenate(part) for part in zip(*found, strict=True))
    return x, y, dx, dy
