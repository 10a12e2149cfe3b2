"""Callouts of the mold and the coupon mold."""

from __future__ import annotations

import math

from ..dimensions import Design
from ..making.fabrication import RELEASE_AGENT
from .dimensioning import Axis, Cut, Item, Leader, shown
from .items import Callouts, holes, x_of, y_of, z_of


def mold(d: Design) -> Callouts:
    """The mold; section through one column of cavities."""
    mold, skin = d.mold, d.skin
    x, y, z = d.mold_outer_mm
    fx, fy = d.frame_outer_mm
    px, py = fx + mold.web_mm, fy + mold.web_mm
    # The first cavity is the one at the lower left.
    cx, cy = -px * (mold.columns - 1) / 2, -py * (mold.rows - 1) / 2
    sx, sy = fx / 2 + mold.fit_mm, fy / 2 + mold.fit_mm
    w, h = skin.width_mm / 2, skin.length_mm / 2
    seat = mold.base_mm + skin.protrusion_mm
    pry, last = mold.pry_width_mm / 2, cy + py * (mold.rows - 1)
    axes_x = [cx + px * i for i in range(mold.columns)]
    axes_y = [cy + py * i for i in range(mold.rows)]
    items: list[Item] = [
        x_of("top", -x / 2, x / 2, "bottom", -y / 2),
        y_of("top", -y / 2, y / 2, "left", -x / 2),
        x_of("top", cx - w, cx + w, "bottom", cy, mold.base_mm),
        x_of("top", cx - sx, cx + sx, "bottom", cy - sy),
        y_of("top", cy - h, cy + h, "left", cx, mold.base_mm),
        y_of("top", cy - sy, cy + sy, "left", cx - sx),
        x_of("top", cx - pry, cx + pry, "top", last + sy + mold.pry_mm),
        y_of("top", last + sy, last + sy + mold.pry_mm, "right", axes_x[-1] + pry),
        *(Axis("top", (a, -y / 2, z), (a, y / 2, z)) for a in axes_x),
        *(Axis("top", (-x / 2, a, z), (x / 2, a, z)) for a in axes_y),
        z_of("left", 0, z, "right", cx, -y / 2),
        z_of("left", 0, mold.base_mm, "right", cx, cy - h),
        z_of("left", seat, z, "left", cx, last + sy),
        z_of("left", mold.base_mm, seat, "left", cx, last + h),
    ]
    if mold.columns > 1:
        items.append(x_of("top", cx, cx + px, "top", 0, z))
    if mold.rows > 1:
        items.append(y_of("top", cy, cy + py, "right", 0, z))
    r, slant = skin.edge_fillet_mm, math.sqrt(0.5)
    items.append(
        Leader(
            "left",
            (cx, cy - h + r * (1 - slant), mold.base_mm + r * (1 - slant)),
            0,
            f"R{shown(r)} all around the floor",
        )
    )
    notes = (
        f"{mold.columns} × {mold.rows} cavities alike. Floors smooth: they form the touched face. "
        + RELEASE_AGENT,
        "Post-cure and coat the resin; cast a coupon first. Vertical corners sharp.",
    )
    return Callouts(tuple(items), notes, Cut(cx))


def coupon(d: Design) -> Callouts:
    """The wells; section through the first."""
    coupon = d.coupon
    pitch = coupon.diameter_mm + coupon.wall_mm
    first = -pitch * (coupon.wells - 1) / 2
    half = first - coupon.diameter_mm / 2 - coupon.wall_mm
    y = coupon.diameter_mm / 2 + coupon.wall_mm
    top = coupon.base_mm + coupon.depth_mm
    centres = [(first + pitch * i, 0.0) for i in range(coupon.wells)]
    items: list[Item] = [
        x_of("top", half, -half, "bottom", -y),
        y_of("top", -y, y, "left", half),
        *holes(centres, top, coupon.diameter_mm, f" depth {shown(coupon.depth_mm)}"),
        z_of("left", 0, top, "right", first, y),
        z_of("left", 0, coupon.base_mm, "left", first, -coupon.diameter_mm / 2),
    ]
    if coupon.wells > 1:
        items.append(x_of("top", first, first + pitch, "top", 0, top))
    notes = ("Same resin, same wash, cure and coat as the mold: it is there to test them.",)
    return Callouts(tuple(items), notes, Cut(first))
